"""The patch LMMSE of one camera with its blend multiplied out: a next frame is a product for every cell.

A cell is as large as the step from block to block. What the blocks over it say of it, weighted and blended, is one
matrix from the measurements around it, the same for all cells that see equal parts of the code. Neither what the
prior's mean adds nor the deviation depends on the frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import prod

import torch
from torch import Tensor

from tmca.operators.block_layout import Places
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.priors.gaussian_posterior import GaussianSolver

MOST_BYTES = 2**31
"""Of the matrices of blocks and cells, which are there at once, or of the factors of all blocks."""


@dataclass(frozen=True)
class BlockMatrices:
    """What equal blocks make of their measurements.

    Args:
        gain: (L, h, w, R, h, columns) that measurements are multiplied by, weighted for the blend.
        dark: (L, h, w) estimate where measurements are zero, weighted.
        variance: (L, h, w) of the error, weighted in the valid columns and zero outside.
    """

    gain: Tensor
    dark: Tensor
    variance: Tensor

    @classmethod
    def of(cls, solver: GaussianSolver, windows: Tensor, weights: Tensor, valid: Tensor) -> BlockMatrices:
        """Those of blocks under code windows (1, taps, h, w)."""
        model = solver.model
        sides = (*model.block, model.buckets, model.block[1], model.columns)
        gain, dark, variance = solver.posterior(windows).linear(0)
        weighted = (gain * weights.flatten()[:, None]).reshape(sides)
        return cls(weighted, weights * dark.reshape(model.block), valid * variance.reshape(model.block))


@dataclass(frozen=True)
class EqualCells:
    """Equal cells of a frame.

    Args:
        pixels: (P, height·width) flat indices of the pixels of each.
        down, across: (P,) first row and column of its measurements in the padded snapshot.
        box: numbers of rows and columns of these.
        matrix: (R·rows·columns, L·height·width) from the measurements to the estimate, of the bank's type or bfloat16.
    """

    pixels: Tensor
    down: Tensor
    across: Tensor
    box: tuple[int, int]
    matrix: Tensor

    def seen(self, padded: Tensor) -> Tensor:
        """(B, P, R·rows·columns) measurements of each in padded snapshots (B, R, rows, columns)."""
        windows = padded.unfold(2, self.box[0], 1).unfold(3, self.box[1], 1)
        return windows[:, :, self.down, self.across].transpose(1, 2).flatten(2)

    def values(self, padded: Tensor) -> Tensor:
        """(B, P, L, height·width) of what padded snapshots say."""
        estimate = self.seen(padded).to(self.matrix.dtype) @ self.matrix
        return estimate.to(padded.dtype).unflatten(-1, (-1, self.pixels.shape[1]))


Covering = tuple[tuple[int, int, int], ...]
"""The blocks over a cell: (top, left) from its corner, and the group that they belong to."""
Classes = dict[tuple[Covering, tuple[int, int]], list[tuple[int, int]]]
"""Corners of equal cells by the blocks over them and their (height, width)."""


@dataclass(frozen=True)
class Bank:
    """The cells of a frame.

    Args:
        grid: where blocks lie.
        cells: that cover the frame.
        offset: (1, L, H, W) estimate where all measurements are zero.
        deviation: (1, L, H, W) predicted standard deviation.
    """

    grid: BlockGrid
    cells: list[EqualCells]
    offset: Tensor
    deviation: Tensor

    @classmethod
    def of(
        cls, grid: BlockGrid, code: Tensor, groups: Sequence[Places], window: Tensor, solver: GaussianSolver
    ) -> Bank | None:
        """The bank of a prior, a camera and its noise, as ``solver`` has them; None where its matrices take more than
        ``MOST_BYTES``.

        Args:
            grid, code, groups: see `tmca.operators.block_layout.BlockLayout`.
            window: (L, h, w) weights of the places in a block.
        """
        classes = _classes(grid, groups)
        if _bytes(grid.model, len(groups), classes, solver.dtype) > MOST_BYTES:
            return None
        weights = window.to(solver.dtype)
        valid, (first, last) = torch.zeros_like(weights), grid.model.valid
        valid[..., first:last] = weights[..., first:last]
        blocks = [BlockMatrices.of(solver, grid.code_windows(code, [places[0]]), weights, valid) for places in groups]
        solved = (
            _solved_cells(grid, corners, covering, sides, blocks, (weights, valid))
            for (covering, sides), corners in classes.items()
        )
        cells, offsets, deviations = zip(*solved, strict=True)
        return cls(grid, [*cells], _frame(cells, offsets, grid.frame), _frame(cells, deviations, grid.frame))

    def estimate(self, snapshot: Tensor, progress: Callable[[float], None] | None = None) -> Tensor:
        """(B, L, H, W) scenes behind snapshots (B, R, H, W')."""
        padded = self.grid.pad_snapshot(snapshot.to(self.deviation.dtype))
        values = [cell.values(padded) for cell in self.cells]
        if progress:
            progress(1.0)
        return _laid(self.cells, values, self.grid.frame).add_(self.offset)


def _bytes(model: BlockModel, blocks: int, classes: Classes, dtype: torch.dtype) -> int:
    """That the matrices of blocks and cells take."""
    entries = blocks * model.measurements * prod(model.block)
    for covering, sides in classes:
        _, _, rows, columns = _box(covering, model)
        entries += model.buckets * rows * columns * model.block[0] * prod(sides)
    return entries * dtype.itemsize


def _classes(grid: BlockGrid, groups: Sequence[Places]) -> Classes:
    """Corners of cells by the blocks over them and their (height, width)."""
    (height, width), (_, h, w) = grid.frame, grid.model.block
    group_of = {place: group for group, places in enumerate(groups) for place in places}
    down, across = _step(grid.tops, height), _step(grid.lefts, width)
    classes: Classes = {}
    for top in range(0, height, down):
        for left in range(0, width, across):
            sides = (min(down, height - top), min(across, width - left))
            over = tuple(
                (y - top, x - left, group_of[y, x])
                for y in grid.tops if y - sides[0] < top < y + h
                for x in grid.lefts if x - sides[1] < left < x + w
            )  # fmt: skip
            classes.setdefault((over, sides), []).append((top, left))
    return classes


def _step(starts: Sequence[int], length: int) -> int:
    """From block to block; the whole length where there is one alone."""
    return starts[1] - starts[0] if len(starts) > 1 else length


def _solved_cells(
    grid: BlockGrid, corners: Places, covering: Covering, sides: tuple[int, int], blocks: Sequence[BlockMatrices],
    weights: tuple[Tensor, Tensor],
) -> tuple[EqualCells, Tensor, Tensor]:  # fmt: skip
    """Equal cells by the blocks over them, and (L, height, width) their estimate where measurements are zero and the
    deviation of any; ``weights`` (L, h, w) of a block, and of its valid columns."""
    channels, _, _, buckets, h, columns = blocks[0].gain.shape
    top, left, rows, across = _box(covering, grid.model)
    matrix = weights[0].new_zeros(channels, *sides, buckets, rows, across)
    dark, variance, weight, valid = weights[0].new_zeros(4, channels, *sides)
    for y, x, group in covering:
        block, (there, here) = blocks[group], _overlap((y, x), sides, weights[0].shape[1:])
        measured = (..., slice(y - top, y - top + h), slice(x - left, x - left + columns))
        matrix[:, *there][measured] += block.gain[:, *here]
        parts = (block.dark, block.variance, *weights)
        for total, one in zip((dark, variance, weight, valid), parts, strict=True):
            total[(..., *there)] += one[(..., *here)]
    matrix /= weight[..., None, None, None]
    first = left + grid.padding[0] + grid.model.origin + grid.model.span
    (height, width), device = sides, matrix.device
    inside = torch.arange(height)[:, None] * grid.frame[1] + torch.arange(width)
    places = torch.tensor(corners)
    pixels = (places[:, 0] * grid.frame[1] + places[:, 1])[:, None] + inside.flatten()
    cells = EqualCells(
        pixels.to(device), (places[:, 0] + top).to(device), (places[:, 1] + first).to(device), (rows, across),
        matrix.flatten(3).flatten(0, 2).mT.contiguous(),
    )  # fmt: skip
    return cells, dark / weight, (variance / valid).sqrt()


def _box(covering: Covering, model: BlockModel) -> tuple[int, int, int, int]:
    """(top, left) of the measurements of some blocks, from the cell's corner, and their numbers of rows and columns."""
    tops, lefts = [y for y, _, _ in covering], [x for _, x, _ in covering]
    rows, columns = max(tops) - min(tops) + model.block[1], max(lefts) - min(lefts) + model.columns
    return min(tops), min(lefts), rows, columns


def _overlap(
    corner: tuple[int, int], sides: tuple[int, int], block: Sequence[int]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Where a block whose corner lies so from a cell's overlaps it: rows and columns of the cell, of the block."""
    there = [slice(max(0, at), min(side, at + own)) for at, side, own in zip(corner, sides, block, strict=True)]
    here = [slice(one.start - at, one.stop - at) for one, at in zip(there, corner, strict=True)]
    return (there[0], there[1]), (here[0], here[1])


def _frame(cells: Sequence[EqualCells], parts: Sequence[Tensor], frame: tuple[int, int]) -> Tensor:
    """(1, L, H, W) of what is the same (L, height, width) in equal cells."""
    pairs = zip(cells, parts, strict=True)
    return _laid(cells, [one.flatten(1).expand(1, len(cell.pixels), -1, -1) for cell, one in pairs], frame)


def _laid(cells: Sequence[EqualCells], values: Sequence[Tensor], frame: tuple[int, int]) -> Tensor:
    """(B, L, H, W) frames of what cells hold at their P places, (B, P, L, height·width)."""
    batch, _, channels = values[0].shape[:3]
    whole = values[0].new_empty(batch, channels, *frame)
    for cell, one in zip(cells, values, strict=True):
        whole.flatten(2)[:, :, cell.pixels.flatten()] = one.transpose(1, 2).flatten(2)
    return whole
