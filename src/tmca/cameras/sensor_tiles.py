"""Scenes with depth on a sensor in tiles, and what each of them sees: images of any size in bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from tmca.errors import SettingError, check_shape
from tmca.operators.spectral_depth import coded_exposure, composited, framed, layered

if TYPE_CHECKING:
    from tmca.cameras.spectral_depth import SpectralDepthCamera

Size = tuple[int, int]
TILE, TOGETHER = (256, 256), 2**29
"""Pixels of a tile of the sensor, and bytes of transfer functions above which it is imaged in tiles."""


@dataclass(frozen=True)
class SensorTile:
    """A rectangle of the sensor, with the margin from which light is blurred into it.

    Args:
        rows, columns: of the sensor.
        seen: rows and columns of the scene whose light reaches it.
        padding: pixels left, right, above and below at which there is no scene.
        margin: (above and below, left and right), pixels.
    """

    rows: slice
    columns: slice
    seen: tuple[slice, slice]
    padding: tuple[int, int, int, int]
    margin: Size

    def cut(self, scene: Tensor) -> Tensor:
        """What is seen of (..., H, W)."""
        return scene[..., self.seen[0], self.seen[1]]

    def padded(self, part: Tensor) -> Tensor:
        """What was cut, dark where there is no scene: all tiles and margins are of one size."""
        return torch.nn.functional.pad(part, self.padding) if any(self.padding) else part

    def inside(self, image: Tensor) -> Tensor:
        """The tile of what was cut, padded and blurred."""
        (above, left), height, width = self.margin, self.rows.stop - self.rows.start, self.columns.stop
        return image[..., above : above + height, left : left + width - self.columns.start]


def bounded_tiles(size: Size, window: Size, spectra: int) -> tuple[list[SensorTile], Size]:
    """Tiles of a sensor (H, W) seen through windows (h, w) of blur, and the frame in which they are blurred.

    One tile, the whole sensor, where so many transfer functions of it do not take much memory.
    """
    height, width = frame = framed(size, window)
    if 8 * spectra * height * (width // 2 + 1) <= TOGETHER:
        return sensor_tiles(size, size, (0, 0)), frame
    return sensor_tiles(size, TILE, (window[0] // 2, window[1] // 2)), framed(TILE, window)


def sensor_tiles(size: Size, tile: Size, margin: Size) -> list[SensorTile]:
    """Tiles that cover a sensor of (H, W) pixels, row by row; the last ones of a row or column may be smaller."""
    rows, columns = (_cuts(*axis) for axis in zip(size, tile, margin, strict=True))
    return [
        SensorTile(row[0], column[0], (row[1], column[1]), (*column[2], *row[2]), margin)
        for row, column in product(rows, columns)
    ]


def _cuts(length: int, step: int, margin: int) -> list[tuple[slice, slice, Size]]:
    """Places of tiles along an axis, what they see, and what is missing before and after it."""
    cuts = []
    for start in range(0, length, step):
        first, last = start - margin, start + step + margin
        seen, missing = slice(max(0, first), min(length, last)), (max(0, -first), max(0, last - length))
        cuts.append((slice(start, min(start + step, length)), seen, missing))
    return cuts


def check_holds(size: Size, window: Size) -> None:
    """Raises SettingError where a frame is narrower than its point spread functions."""
    if min(size) < max(window):
        expected = f"at least {max(window)}, the width of the point spread functions"
        raise SettingError("size", f"{size[0]}×{size[1]} pixels", expected, "take a larger crop or patch")


def exposed_in_tiles(
    camera: SpectralDepthCamera, scene: Tensor, depth: Tensor, progress: Callable[[float], None] | None = None
) -> Tensor:
    """Exact snapshot (B, C, H, W) of a spectral-depth camera; arguments as those of its ``forward``."""
    slots = (camera.slots,) if scene.ndim == 5 and scene.shape[1] == camera.slots else ()
    check_shape("scene", scene, ("batch", *slots, *camera.scene_shape), "give the camera its size and bands")
    check_shape("depth", depth, ("batch", *(slots if depth.ndim == 5 else ()), 1, *camera.size), "give metres")
    tiles, frame = bounded_tiles(camera.size, camera.bench.window, camera.slots * camera.planes.count * camera.bands)
    transfer, snapshot = camera.transfer(frame), scene.new_empty(0)
    for count, tile in enumerate(tiles):
        part = _exposed(camera, scene, depth, transfer, frame, tile)
        if len(tiles) == 1:
            return part
        snapshot = snapshot if count else part.new_empty(*part.shape[:2], *camera.size)
        snapshot[..., tile.rows, tile.columns] = part
        if progress is not None:
            progress((count + 1) / len(tiles))
    return snapshot


def _exposed(
    camera: SpectralDepthCamera, scene: Tensor, depth: Tensor, transfer: Tensor, frame: Size, tile: SensorTile
) -> Tensor:
    """(B, C, h, w) exact snapshot of a tile."""
    light, places = tile.padded(tile.cut(scene)), tile.cut(depth)
    moments = [slice(None)] if depth.ndim == 4 else [slice(k, k + 1) for k in range(camera.slots)]
    seen, form = [], layered if camera.image_formation == "linear" else composited
    for slots in moments:
        moving = light if depth.ndim == 4 else light[:, slots]
        weights = camera.planes.weights(places if depth.ndim == 4 else places[:, slots.start]).to(scene)
        seen.append(form(moving, tile.padded(weights), transfer[slots], frame))
    inside = tile.inside(seen[0] if len(seen) == 1 else torch.cat(seen, 1))
    return coded_exposure(inside, *camera.codes_over(tile.rows, tile.columns), camera.exposure)
