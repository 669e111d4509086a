"""Blocks laid over the code of a camera: which of them see equal parts of it, and the sum of their values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b

import torch
from torch import Tensor

from tmca.errors import check_range
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.operators.taps import Taps

Places = list[tuple[int, int]]
"""(top, left) of blocks."""


@dataclass(frozen=True)
class BlockLayout:
    """Where blocks lie over the padded code (taps, H, W) of a camera."""

    grid: BlockGrid
    code: Tensor

    @classmethod
    def of(cls, model: BlockModel, taps: Taps, stride: tuple[int, int], differentiable: bool = False) -> BlockLayout:
        check_range("stride", min(stride), 1)
        stride = (min(stride[0], model.block[1]), stride[1])
        grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), stride)
        code = grid.pad_code(taps.code if differentiable else taps.code.detach())
        return cls(grid, code)

    @cached_property
    def groups(self) -> list[Places]:
        """Positions of blocks that see equal windows of the code."""
        return equal_windows(self.grid, self.code)


def usual_stride(model: BlockModel, code: Tensor) -> tuple[int, int]:
    """Rows and columns from block to block, so that blocks overlap: two thirds of their rows (three of four), and
    their valid columns but no more than two thirds of all; for tiled codes the next smaller divisors of the period
    that are not below half of that."""
    (_, rows, columns), (first, last) = model.block, model.valid
    most = max(1, 2 * rows // 3, min(rows, 4) - 1), min(last - first, max(1, 2 * columns // 3))
    down, across = (_dividing(step, _period(code.detach(), axis)) for axis, step in enumerate(most, start=1))
    return down, across


def _dividing(most: int, period: int | None) -> int:
    """The largest step, from half of ``most`` to it, that divides a period or is a multiple of it."""
    steps = range(-(-most // 2), most + 1)
    return max((step for step in steps if period and 0 in (period % step, step % period)), default=most)


def _period(code: Tensor, axis: int) -> int | None:
    """Smallest step along an axis under which the code repeats itself at least twice."""
    length = code.shape[axis]
    for step in range(1, length // 2 + 1):
        early, late = code.narrow(axis, 0, length - step), code.narrow(axis, step, length - step)
        if torch.equal(early[:, :1], late[:, :1]) and torch.equal(early, late):
            return step
    return None


def equal_windows(grid: BlockGrid, code: Tensor, places: Places | None = None) -> list[Places]:
    """The grid's positions, or some of them, grouped by equal windows of the padded code."""
    groups: dict[bytes, Places] = {}
    for place in grid.positions if places is None else places:
        window = grid.code_windows(code.detach(), [place]).contiguous().cpu().numpy()
        groups.setdefault(blake2b(window.data, digest_size=16).digest(), []).append(place)
    return list(groups.values())


def evenly_chosen(places: Places, count: int = 8) -> Places:
    """A few of the positions, evenly through the list."""
    return [places[i] for i in torch.linspace(0, len(places) - 1, min(count, len(places))).long().tolist()]


class Canvas:
    """Sums of what blocks say about the padded frame, weighted by a window (L, h, w)."""

    def __init__(self, grid: BlockGrid, batch: int, window: Tensor) -> None:
        left, right, above, below = grid.padding
        height, width = grid.frame
        self.window, self.frame = window, (..., slice(above, above + height), slice(left, left + width))
        self.weight = window.new_zeros(len(window), height + above + below, width + left + right)
        self.total = self.weight.new_zeros(batch, *self.weight.shape)

    def add(self, top: int, left: int, values: Tensor) -> None:
        """Lay one block's values (B, L·h·w) with its corner at (top, left) of the padded frame."""
        _, h, w = self.window.shape
        area = (..., slice(top, top + h), slice(left, left + w))
        self.total[area] += self.window * values.unflatten(-1, self.window.shape)
        self.weight[area] += self.window

    def mean(self) -> Tensor:
        """(B, L, H, W) weighted mean on the frame."""
        return self.total[self.frame] / self.weight[self.frame]
