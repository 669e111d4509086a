"""Random patches of training scenes, read lazily, each a function of the run's seed, the step and its index alone."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import moving_scene
from tmca.data import atomic_path, make_folder
from tmca.data.formats.stored import whole_file
from tmca.data.spectral_depth import drawn_nearness
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

_KINDS: tuple[Literal["plane", "slanted", "pieces", "smooth"], ...] = ("plane", "slanted", "pieces", "smooth")
_LEAST_RANGE = 0.3
"""Share of the depth range that a redrawn patch covers at least."""
Load = Callable[[str], "xr.DataArray | xr.Dataset"]
"""From the name of a scene to the scene at the camera's bands or views."""
Channels = Callable[[str], NDArray[np.float32]]
"""From the name of a scene to its channels (L, H, W)."""


class Patch(NamedTuple):
    """One training example.

    Args:
        scene: (L, h, w) relative irradiance, or (K, L, h, w) where it moves within the exposure.
        truth: (L, h, w) what the decoder shall estimate: the scene in the middle of the exposure.
        origin: which scene and where, for messages.
    """

    scene: Tensor
    truth: Tensor
    origin: str


class CubeStore:
    """Cubes as float32 arrays on disk, mapped into memory: a patch reads its own bytes only.

    Args:
        scenes: names that ``load`` understands.
        load: reads the channels (L, H, W) of one.
        folder: of the arrays, which may be deleted at any time.
    """

    def __init__(self, scenes: Sequence[str], load: Channels, folder: str | Path) -> None:
        self.scenes, self.load, self.folder = tuple(scenes), load, make_folder(folder)
        self._mapped = lru_cache(maxsize=256)(self._map)

    def __len__(self) -> int:
        return len(self.scenes)

    def cube(self, index: int) -> NDArray[np.float32]:
        """(L, H, W) of one scene, read when it is touched.

        Raises:
            DataError: the scene cannot be read.
        """
        return self._mapped(index)

    def _map(self, index: int) -> NDArray[np.float32]:
        name = self.scenes[index]
        file = self.folder / f"{Path(name).stem}-{_identity(name)}.npy"
        return cached_array(file, lambda: np.ascontiguousarray(self.load(name), dtype=np.float32))


def cached_array(file: Path, compute: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """An array in a ``.npy`` file, mapped into memory; computed and written where there is none.

    Raises:
        DataError: a file that cannot be read.
    """
    if not file.exists():
        values = np.ascontiguousarray(compute())
        with atomic_path(file, overwrite=True) as temporary, temporary.open("wb") as handle:
            # np.save cuts a small array without an error on a full disk
            np.lib.format.write_array_header_1_0(handle, np.lib.format.header_data_from_array_1_0(values))
            handle.write(values.data)
    with whole_file(file, "cached array", "delete it"):
        values = np.load(file, mmap_mode="r", allow_pickle=False)
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu" or not values.size:
        raise DataError(file, "no array of numbers", "the cached copy of one", "delete it")
    return values


def _identity(name: str) -> str:
    """Digest of a scene's place, size and time of change: an altered file is read anew."""
    path = Path(name)
    parts = [str(path.resolve()), *((path.stat().st_size, path.stat().st_mtime_ns) if path.exists() else ())]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class PatchSource:
    """Square patches: a random scene, place, turn, mirror image and brightness, motion within the exposure, or depth.

    With ``redrawn`` the last channel is inverse depth as a share of the camera's range, 0 = far, 1 = near, NaN where it
    is unknown. A patch keeps its scene's depth, moved and squeezed within the range at random, or is put at drawn
    depths: real textures at every distance.

    Args:
        store: of the scenes.
        patch: side, pixels.
        seed: of the run.
        brightness: stops by which a patch is made darker at most, or brighter by one; never above 1.
        tint: standard deviation of a random smooth change of the spectrum, natural logarithm.
        motion: largest displacement between the ends of the exposure, pixels.
        slots: K, for moving scenes.
        views: (V, U) where the channels are views, row by row, which turn and are mirrored with the pixels.
        redrawn: share of the patches at drawn depths; None for scenes without depth.
    """

    store: CubeStore
    patch: int
    seed: int
    brightness: float = 0.0
    tint: float = 0.0
    motion: float = 0.0
    slots: int = 1
    views: tuple[int, int] | None = None
    redrawn: float | None = None

    def __call__(self, step: int, index: int) -> Patch:
        """The patch with this index in the batch of this step.

        Raises:
            DataError: a scene that cannot be read, or is smaller than a patch.
        """
        rng = np.random.default_rng((self.seed, step, index))
        which = int(rng.integers(len(self.store)))
        scene, margin = self.store.cube(which), int(np.ceil(self.motion / 2)) + 1 if self.motion else 0
        side = self.patch + 2 * margin
        if min(scene.shape[1:]) < side:
            name, size = self.store.scenes[which], f"{scene.shape[1]}×{scene.shape[2]} pixels"
            raise DataError(name, size, f"at least {side}×{side}", "use smaller patches or leave the scene out")
        top, left = (int(rng.integers(length - side + 1)) for length in scene.shape[1:])
        part = scene[:, top : top + side, left : left + side]
        part = turned(part, int(rng.integers(4)), bool(rng.integers(2)), self.views)
        values = torch.from_numpy(self._varied(part, rng))
        origin = f"{self.store.scenes[which]} at row {top}, column {left}"
        if not self.motion:
            return Patch(values, values, origin)
        velocity = rng.uniform(-1, 1, 2) * self.motion
        moving = moving_scene(values, (float(velocity[0]), float(velocity[1])), self.slots)
        inner = slice(margin, margin + self.patch)
        return Patch(moving[..., inner, inner].contiguous(), values[:, inner, inner].contiguous(), origin)

    def _varied(self, part: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        """A patch in other light, and at other depths."""
        if self.redrawn is None:
            return in_other_light(part, rng, self.brightness, self.tint)
        cube = in_other_light(part[:-1], rng, self.brightness, self.tint)
        return np.concatenate((cube, moved_depth(part[-1], rng, self.redrawn)[None]), dtype=np.float32)


def in_other_light(
    patch: NDArray[np.float32], rng: np.random.Generator, stops: float, tint: float
) -> NDArray[np.float32]:
    """A patch (L, h, w) of another brightness and colour, never above 1; arguments as in `PatchSource`."""
    if tint:
        patch = patch * _spectral_gain(len(patch), rng, tint)[:, None, None]
    gain = 2.0 ** rng.uniform(-stops, min(stops, 1.0))
    top = float(patch.max())
    return np.ascontiguousarray(patch * np.float32(min(gain, 1 / top) if top > 0 else 1.0))


def moved_depth(nearness: NDArray[np.float32], rng: np.random.Generator, redrawn: float) -> NDArray[np.float64]:
    """Shares of the range (h, w), moved and squeezed within it, or drawn anew as often as ``redrawn`` says."""
    extent = rng.uniform(_LEAST_RANGE, 1)
    begin = rng.uniform(0, 1 - extent)
    if rng.random() >= redrawn and np.isfinite(nearness).any():
        return begin + extent * nearness.astype(np.float64)
    kind = _KINDS[rng.integers(len(_KINDS))]
    drawn = drawn_nearness((nearness.shape[0], nearness.shape[1]), rng, kind)
    return drawn if kind == "plane" else begin + extent * drawn


def turned(
    patch: NDArray[np.float32], quarters: int, mirror: bool, views: tuple[int, int] | None = None
) -> NDArray[np.float32]:
    """A patch (L, h, w) after quarter turns and a mirror image; half turns only where the grid of views is oblong."""
    if views is None:
        around = np.rot90(patch, quarters, axes=(1, 2))
        return around[:, :, ::-1] if mirror else around
    quarters = quarters if views[0] == views[1] else quarters // 2 * 2
    grid = np.rot90(np.rot90(patch.reshape(*views, *patch.shape[1:]), quarters, axes=(0, 1)), quarters, axes=(2, 3))
    grid = grid[:, ::-1, :, ::-1] if mirror else grid
    return grid.reshape(len(patch), *grid.shape[2:])


def _spectral_gain(bands: int, rng: np.random.Generator, spread: float) -> NDArray[np.float32]:
    """(L,) a smooth positive curve: the exponential of a few cosines with falling amplitudes."""
    place = (np.arange(bands) + 0.5) / bands
    orders = np.arange(1, 5)
    curve = (rng.standard_normal(4) / orders) @ np.cos(np.pi * orders[:, None] * place)
    return np.exp(spread * curve).astype(np.float32)
