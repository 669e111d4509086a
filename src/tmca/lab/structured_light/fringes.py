"""The fringes to project: phase-shifted cosines at several frequencies, as pictures and a manifest."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.data import atomic_path, write_json
from tmca.errors import DataError, SettingError

MANIFEST = "fringes.json"
_FORMAT = "tmca fringes 1"
_LEVELS = 255
Across = Literal["x", "y"]


@dataclass(frozen=True)
class FringePlan:
    """Which fringes are projected.

    Frame (f, n) is ``½ + ½ cos(2π fringes_f (u + ½)/extent - 2π n/steps)`` over the projector's pixel u, which counts
    from 0 along x (upright fringes) or y.

    Args:
        size: (height, width) of the projector in pixels.
        fringes: how many over the projector's extent, ascending. With 1, or numbers whose differences lead to 1
            (59, 64, 70), the phase is absolute.
        steps: phase shifts of each, 3 or more.
        across: the axis along which the phase grows: ``"x"`` for a projector beside the camera, ``"y"`` for one above.

    Raises:
        SettingError: too few steps, fringes too fine for the projector, or not ascending.
    """

    size: tuple[int, int] = (800, 1280)
    fringes: tuple[int, ...] = (1, 4, 16, 64)
    steps: int = 4
    across: Across = "x"

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", tuple(int(n) for n in self.size))
        object.__setattr__(self, "fringes", tuple(self.fringes))
        if len(self.size) != 2 or min(self.size) < 8:
            raise SettingError("projector", str(self.size), "(height, width) of 8 pixels or more")
        if self.across not in ("x", "y"):
            raise SettingError("across", repr(self.across), "'x' or 'y'")
        if self.steps < 3:
            raise SettingError("steps", str(self.steps), "3 or more", "three shifts are the fewest that tell a phase")
        if not self.fringes or self.fringes[0] < 1 or sorted(set(self.fringes)) != list(self.fringes):
            raise SettingError("fringes", str(self.fringes), "ascending whole numbers from 1")
        if self.fringes[-1] * 4 > self.extent:
            raise SettingError("fringes", str(self.fringes[-1]), f"{self.extent // 4} at most: 4 projector pixels each")

    @property
    def extent(self) -> int:
        """Projector pixels along the axis on which the phase grows."""
        return self.size[1] if self.across == "x" else self.size[0]

    @property
    def names(self) -> tuple[str, ...]:
        """A name per frame, frequencies from coarse to fine and the steps of each."""
        return tuple(f"fringe_{f:04d}_{n:02d}" for f in self.fringes for n in range(self.steps))

    def profiles(self) -> NDArray[np.float64]:
        """``(F, N, extent)`` in [0, 1]: each frame along its axis, as whole 8-bit levels."""
        place = (np.arange(self.extent) + 0.5) / self.extent
        turn = 2 * np.pi * np.asarray(self.fringes)[:, None, None] * place
        shift = 2 * np.pi * np.arange(self.steps)[:, None] / self.steps
        return np.round((0.5 + 0.5 * np.cos(turn - shift)) * _LEVELS) / _LEVELS

    def position(self, phase: NDArray[Any]) -> NDArray[np.float64]:
        """Projector pixel of the absolute phase of the finest fringes, radians."""
        return np.asarray(phase * self.extent / (2 * np.pi * self.fringes[-1]) - 0.5, dtype=np.float64)


def write_fringes(plan: FringePlan, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write an 8-bit PNG per frame and ``fringes.json``, which names them in order; whole or not at all.

    Raises:
        OutputError: see `tmca.data.atomic_path`.
    """
    from PIL import Image

    with atomic_path(folder, overwrite=overwrite) as temporary:
        temporary.mkdir()
        for name, profile in zip(plan.names, plan.profiles().reshape(-1, plan.extent), strict=True):
            line = np.round(profile * _LEVELS).astype(np.uint8)
            picture = np.broadcast_to(line if plan.across == "x" else line[:, None], plan.size)
            Image.fromarray(np.ascontiguousarray(picture)).save(temporary / f"{name}.png")
        frames = [f"{name}.png" for name in plan.names]
        write_json({"format": _FORMAT, **asdict(plan), "frames": frames}, temporary / MANIFEST)
    return Path(folder)


def load_plan(path: str | Path) -> FringePlan:
    """The plan of a manifest, or of the folder it lies in.

    Raises:
        DataError: missing, no JSON, or no manifest of fringes.
        SettingError: an impossible plan.
    """
    file = Path(path) / MANIFEST if Path(path).is_dir() else Path(path)
    about = read_json(file, "a manifest of fringes", "write it with tmca scan fringes")
    if about.get("format") != _FORMAT:
        raise DataError(file, f"the format {about.get('format')!r}", repr(_FORMAT), "write it with tmca scan fringes")
    try:
        size, fringes = tuple(about["size"]), tuple(int(f) for f in about["fringes"])
        return FringePlan(size, fringes, int(about["steps"]), about["across"])
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, SettingError):
            raise
        raise DataError(file, f"no usable {error}", "size, fringes, steps, across") from error


def read_json(file: Path, expected: str, remedy: str = "check the path") -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        DataError: missing, unreadable, or no object.
    """
    try:
        about = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DataError(file, "no such file", expected, remedy) from error
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise DataError(file, f"no readable JSON ({error})", expected, remedy) from error
    if not isinstance(about, dict):
        raise DataError(file, f"JSON of type {type(about).__name__}", expected, remedy)
    return about
