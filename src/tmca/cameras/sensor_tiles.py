"""A sensor in tiles, and what of the scene each of them sees: images of any size in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import torch
from torch import Tensor

from tmca.operators.spectral_depth import framed

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
