"""The fringes to project, and the camera's frames of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.attributes import Attributes, read_json
from tmca.data import atomic_path, write_json
from tmca.errors import DataError, SettingError, check_choice, check_range
from tmca.lab.frames import Frames, read_frames, write_frames

MANIFEST = "fringes.json"
_FORMAT = "tmca fringes 1"
_LEVELS = 255
_MOST_STEPS, _WIDEST = 1024, 2**15
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
        check_choice("across", self.across, ("x", "y"))
        if self.steps < 3:
            raise SettingError("steps", str(self.steps), "3 or more", "three shifts are the fewest that tell a phase")
        check_range("steps", self.steps, high=_MOST_STEPS)
        check_range("projector", max(self.size), high=_WIDEST, unit="pixels")
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
    lines = np.round(plan.profiles().reshape(-1, plan.extent) * _LEVELS).astype(np.uint8)
    across = lines[:, None] if plan.across == "x" else lines[:, :, None]
    with atomic_path(folder, overwrite=overwrite) as temporary:
        write_frames(temporary, dict(zip(plan.names, np.broadcast_to(across, (len(lines), *plan.size)), strict=True)))
        frames = [f"{name}.png" for name in plan.names]
        write_json({"format": _FORMAT, **asdict(plan), "frames": frames}, temporary / MANIFEST)
    return Path(folder)


class _Manifest(Attributes):
    """What ``fringes.json`` says."""

    format: Literal["tmca fringes 1"]
    size: tuple[int, int]
    fringes: tuple[int, ...]
    steps: int
    across: str


def load_plan(path: str | Path) -> FringePlan:
    """The plan of a manifest, or of the folder it lies in.

    Raises:
        DataError: missing, no JSON, or no manifest of fringes.
        SettingError: an impossible plan.
    """
    file = Path(path) / MANIFEST if Path(path).is_dir() else Path(path)
    about = read_json(file, _Manifest, "a manifest of fringes, which tmca scan fringes writes").model_dump()
    try:
        return FringePlan(**{name: value for name, value in about.items() if name != "format"})
    except SettingError as error:
        raise SettingError(f"{file}: {error.where}", error.found, error.expected, error.remedy) from error


_SATURATED = 0.5
"""Share of the pixels beyond which saturation refuses a capture."""


@dataclass(frozen=True)
class Capture:
    """``values`` ``(F, N, H, W)`` digital numbers, ``saturated`` ``(H, W)`` in any frame."""

    source: Path
    values: NDArray[np.float32]
    saturated: NDArray[np.bool_]
    step: float


def read_capture(path: str | Path, plan: FringePlan, saturation: float | None = None) -> Capture:
    """Read what the camera saw of a plan's fringes.

    Frames are known by the plan's names (``fringe_0016_02.png``); where none has such a name they count in the order of
    their own names, or of the stack.

    Args:
        path: folder of frames or stack, as for `tmca.lab.frames.read_frames`.
        plan: what was projected.
        saturation: see `tmca.lab.frames.read_frames`.

    Raises:
        DataError: missing frames, too many of them, or more than half of the pixels saturated.
    """
    frames = read_frames(path, saturation)
    chosen = _in_order(frames, plan)
    values, saturated = frames.values[chosen], frames.saturated[chosen]
    share = saturated.any(axis=0).mean()
    if share > _SATURATED:
        worst = frames.names[chosen[int(saturated.mean(axis=(1, 2)).argmax())]]
        found = f"{share:.0%} of the pixels saturated (most in {worst})"
        raise DataError(path, found, f"{_SATURATED:.0%} at most", "expose for less time")
    shape = (len(plan.fringes), plan.steps, *values.shape[1:])
    return Capture(Path(path), values.reshape(shape), np.asarray(saturated.any(axis=0)), frames.step)


def _in_order(frames: Frames, plan: FringePlan) -> list[int]:
    """Index of each of the plan's frames."""
    there, wanted = {name.lower(): i for i, name in enumerate(frames.names)}, plan.names
    if any(name in there for name in wanted):
        gone = [name for name in wanted if name not in there]
        if gone:
            found = f"no {', '.join(gone[:3])}{' …' if len(gone) > 3 else ''} ({len(gone)} of {len(wanted)} missing)"
            raise DataError(frames.source, found, f"all {len(wanted)} frames of the plan", "capture them again")
        return [there[name] for name in wanted]
    if len(frames.names) != len(wanted):
        expected = f"{len(wanted)}: {len(plan.fringes)} frequencies of {plan.steps} steps"
        remedy = f"name them {wanted[0]} … {wanted[-1]}, or pass the manifest they were projected from"
        raise DataError(frames.source, f"{len(frames.names)} frames", expected, remedy)
    return list(range(len(wanted)))
