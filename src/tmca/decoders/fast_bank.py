"""Smaller banks, which decode a next frame sooner: without what hardly matters to a cell, and in half precision."""

from __future__ import annotations

from dataclasses import replace
from math import prod

import torch
from torch import Tensor

from tmca.decoders.bank import Bank, EqualCells
from tmca.devices import computes_half

LEFT_OUT, ROUNDED = 0.2, 0.0046
"""Sum of the squares of gains that are left out, and of what bfloat16 rounds (0.02 dB), over the predicted squared
error."""
_ROUNDING = 2.0**-14 / 24
"""Mean square of what rounding to bfloat16 changes, relative to that of numbers: between those that are uniform up to a
limit (1/28) and normal ones (1/22)."""
Sides = tuple[int, int, int, int]
"""First row, row behind the last, first column, column behind the last."""


def faster(bank: Bank, expected: Tensor) -> Bank:
    """The `smaller` bank, `halved` on processors that compute so; arguments as theirs."""
    return computable(smaller(bank, expected), expected)


def smaller(bank: Bank, expected: Tensor) -> Bank:
    """The bank without measurements that hardly matter to a cell: a next frame in two thirds of the time.

    They lie at the rim of what the blocks over a cell see. Fewer directions across the channels would save as much
    again, but cost 0.8 dB on scenes whose spectra are unlike the prior's.

    Args:
        bank: of all measurements.
        expected: (1, R, H, W') snapshot that the prior expects: of it both banks say the same.
    """
    squares = sum(float(cell.matrix.square().sum()) * len(cell.pixels) for cell in bank.cells)
    if not squares:
        return bank
    share = LEFT_OUT * float(bank.deviation.square().sum()) / squares
    return _with_cells(bank, [_cut(cell, share) for cell in bank.cells], expected)


def halved(bank: Bank, expected: Tensor) -> Bank:
    """The bank with matrices in bfloat16, unless what that rounds is more than ``ROUNDED`` of the predicted error.

    Args:
        bank: in float32 or float64.
        expected: see `smaller`.
    """
    if rounded(bank, expected) > ROUNDED * float(bank.deviation.square().sum()):
        return bank
    return _with_cells(bank, _of_type(bank.cells, torch.bfloat16), expected)


def rounded(bank: Bank, snapshot: Tensor) -> float:
    """Predicted sum of squares of what bfloat16 changes in the estimate of a snapshot: it rounds matrices, measurements
    and products."""
    padded, total = bank.grid.pad_snapshot(snapshot.to(bank.offset.dtype)), 0.0
    for cell in bank.cells:
        seen = cell.seen(padded)
        total += 2 * float((seen.square().sum((0, 1)) * cell.matrix.square().sum(1)).sum())
        total += float((seen @ cell.matrix).square().sum())
    return _ROUNDING * total


def computable(bank: Bank, expected: Tensor) -> Bank:
    """The bank with matrices of the type that its device computes with best, whatever another machine stored."""
    of_type, device = {cell.matrix.dtype for cell in bank.cells}, bank.offset.device
    if device.type != "cpu" or not computes_half(device):
        return replace(bank, cells=_of_type(bank.cells, bank.offset.dtype))
    return bank if torch.bfloat16 in of_type else halved(bank, expected)


def _of_type(cells: list[EqualCells], dtype: torch.dtype) -> list[EqualCells]:
    return [replace(cell, matrix=cell.matrix.to(dtype)) for cell in cells]


def _with_cells(bank: Bank, cells: list[EqualCells], expected: Tensor) -> Bank:
    """A bank of other cells that says the same of the expected snapshot."""
    linear = replace(bank, cells=cells, offset=torch.zeros_like(bank.offset))
    return replace(linear, offset=bank.estimate(expected) - linear.estimate(expected))


def _cut(cell: EqualCells, share: float) -> EqualCells:
    """Cells without a share of the sum of squares of their matrix."""
    gains = cell.matrix.unflatten(0, (-1, *cell.box))
    top, bottom, left, right = _core(gains.square().sum((0, 3)), share)
    gains = gains[:, top:bottom, left:right]
    box = (bottom - top, right - left)
    return EqualCells(cell.pixels, cell.down + top, cell.across + left, box, gains.flatten(0, 2).contiguous())


def _core(squares: Tensor, share: float) -> Sides:
    """The part of a table that is left when its outer rows and columns are taken away, the weakest by area first."""
    area = squares.double().cpu()
    sides, budget = (0, area.shape[0], 0, area.shape[1]), share * float(area.sum())
    while True:
        strengths = [(float(area[_part(edge)].mean()), edge, inner) for edge, inner in _edges(sides)]
        _, edge, inner = min(strengths, key=lambda one: one[0])
        budget -= float(area[_part(edge)].sum())
        if budget < 0 or prod(area[_part(inner)].shape) == 0:
            return sides
        sides = inner


def _edges(sides: Sides) -> list[tuple[Sides, Sides]]:
    """The outer rows and columns of a part, each with what is left without it."""
    top, bottom, left, right = sides
    return [
        ((top, top + 1, left, right), (top + 1, bottom, left, right)),
        ((bottom - 1, bottom, left, right), (top, bottom - 1, left, right)),
        ((top, bottom, left, left + 1), (top, bottom, left + 1, right)),
        ((top, bottom, right - 1, right), (top, bottom, left, right - 1)),
    ]


def _part(sides: Sides) -> tuple[slice, slice]:
    return slice(sides[0], sides[1]), slice(sides[2], sides[3])
