"""Taps: the common form of every collapsed coded camera.

A tap takes one channel of the scene (a band, a view), weighs it pixel by pixel and lays it on the snapshot some
columns further on. CASSI has a tap per band (two where the dispersion is fractional), the dual disperser and the
light-field camera one tap per channel with no offset.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from tmca.errors import ShapeError


@dataclass(frozen=True)
class Taps:
    """``y[m, n + offsets[t]] += code[t, m, n] * scene[channels[t], m, n]`` for every tap t.

    Args:
        code: (taps, H, W) weight of each tap, the time-multiplexed code with the sensor response folded in.
        channels: scene channel that each tap reads.
        offsets: column of the snapshot on which each tap's column 0 falls, ≥ 0, in pixels.
        scene_channels: number of channels L of the scene.
        snapshot_width: columns W' of the snapshot.
    """

    code: Tensor
    channels: tuple[int, ...]
    offsets: tuple[int, ...]
    scene_channels: int
    snapshot_width: int

    def __post_init__(self) -> None:
        taps, _, width = self.code.shape
        if not taps == len(self.channels) == len(self.offsets):
            raise ShapeError(
                "taps",
                f"{taps} codes, {len(self.channels)} channels, {len(self.offsets)} offsets",
                "one of each per tap",
            )
        if min(self.offsets) < 0 or max(self.offsets) + width > self.snapshot_width:
            raise ShapeError(
                "taps",
                f"offsets {min(self.offsets)}…{max(self.offsets)}, width {width}, snapshot of {self.snapshot_width}",
                "every tap inside the snapshot",
            )

    @property
    def scene_shape(self) -> tuple[int, int, int]:
        """(L, H, W) of the scene."""
        return (self.scene_channels, self.code.shape[1], self.code.shape[2])

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(1, H, W') of the snapshot."""
        return (1, self.code.shape[1], self.snapshot_width)

    def window(self, top: int, left: int, height: int, width: int) -> Taps:
        """The same camera behind a part of its codes: a scene of (height, width), dark around.

        Args:
            top, left: first row and column of the part, scene pixels.
            height, width: its size, pixels.

        Raises:
            ShapeError: it reaches beyond the codes.
        """
        rows, columns = self.code.shape[1:]
        if min(top, left) < 0 or top + height > rows or left + width > columns or min(height, width) < 1:
            raise ShapeError(
                "window", f"{height}×{width} pixels at row {top}, column {left}", f"a part of {rows}×{columns}"
            )
        part = self.code[:, top : top + height, left : left + width]
        return replace(self, code=part, snapshot_width=width + self.snapshot_width - columns)


def sum_by_channel(code: Tensor, channels: tuple[int, ...], scene_channels: int) -> Tensor:
    """(t, H, W) codes of taps → (L, H, W), summed over the taps that read the same channel."""
    total = code.new_zeros(scene_channels, *code.shape[1:])
    return total.index_add(0, torch.tensor(channels, device=code.device), code)
