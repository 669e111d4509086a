"""Taps: the common form of every collapsed coded camera.

A tap takes one channel of the scene (a band, a view), weighs it pixel by pixel and lays it on the snapshot some
columns further on. CASSI has a tap per band (two where the dispersion is fractional), the dual disperser and the
light-field camera one tap per channel with no offset.
"""

from __future__ import annotations

from dataclasses import dataclass

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


def sum_by_channel(code: Tensor, channels: tuple[int, ...], scene_channels: int) -> Tensor:
    """(t, H, W) codes of taps → (L, H, W), summed over the taps that read the same channel."""
    total = code.new_zeros(scene_channels, *code.shape[1:])
    return total.index_add(0, torch.tensor(channels, device=code.device), code)
