"""Overlapping patches merged into one image, row by row, by the median or the mean of all that cover a pixel."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.priors.blocks import BlockGrid

MERGES = ("median", "mean")


class Overlaps:
    """Collects one row of patches after the other; rows of the image that no later patch covers leave at once.

    Patches that may overlap are kept in layers of their own, so the memory is that of the patches which cover one
    row of the image, whatever its height.

    Args:
        grid: of the patches.
        batch: B.
        merge: ``"median"`` or ``"mean"``.
        like: tensor whose type and device the image gets.

    Raises:
        SettingError: another merge.
    """

    def __init__(self, grid: BlockGrid, batch: int, merge: str, like: Tensor) -> None:
        if merge not in MERGES:
            raise SettingError("merge", repr(merge), f"one of {', '.join(MERGES)}")
        self.grid, self.merge = grid, merge
        channels, h, w = grid.model.block
        self.layers = (_layers(grid.tops, h), _layers(grid.lefts, w))
        width = max(grid.lefts) + w
        self.held = like.new_full((*self.layers, batch, channels, h, width), inf)
        self.row = 0

    def add(self, patches: Tensor) -> Tensor:
        """Lay the next row of patches (P, B, L, h, w); returns (B, L, rows, W) finished rows of the image.

        Raises:
            ShapeError: another number of patches than the grid has in a row, or of another shape.
        """
        _, _, batch, channels, h, _ = self.held.shape
        wanted = (len(self.grid.lefts), batch, channels, h, self.grid.model.block[2])
        if tuple(patches.shape) != wanted:
            raise ShapeError("patches", f"{tuple(patches.shape)}", f"{wanted}")
        slot = self.row % self.layers[0]
        for i, (left, patch) in enumerate(zip(self.grid.lefts, patches, strict=True)):
            self.held[slot, i % self.layers[1], ..., left : left + patch.shape[-1]] = patch
        return self._finished()

    def _finished(self) -> Tensor:
        """Merge and drop the rows above the next row of patches."""
        tops, height = self.grid.tops, self.grid.frame[0]
        self.row += 1
        last = self.row == len(tops)
        ready = (height if last else tops[self.row]) - tops[self.row - 1]
        image = merged(self.held[..., :ready, : self.grid.frame[1]].flatten(0, 1), self.merge)
        self.held = self.held.roll(-ready, -2)
        self.held[..., -ready:, :] = inf
        return image


def merged(covers: Tensor, merge: str) -> Tensor:
    """(...) median or mean over the finite values along the first axis of covers (N, ...); ``inf`` marks gaps."""
    there = covers.isfinite()
    count = there.sum(0)
    if merge == "mean":
        return torch.where(there, covers, 0).sum(0) / count
    ranked = covers.sort(0).values
    lower, upper = (ranked.gather(0, (rank // 2)[None])[0] for rank in (count - 1, count))
    return (lower + upper) / 2


def _layers(starts: tuple[int, ...], length: int) -> int:
    """Layers so that patches of a length, dealt out in turn, never overlap in a layer."""
    for layers in range(1, len(starts)):
        if all(late - early >= length for early, late in zip(starts, starts[layers:], strict=False)):
            return layers
    return len(starts)


def rows_of(grid: BlockGrid) -> Iterator[list[tuple[int, int]]]:
    """The grid's positions, row by row."""
    for top in grid.tops:
        yield [(top, left) for left in grid.lefts]
