"""Judging one period of a tiled code: every pixel of it is judged with its neighbours around."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Protocol

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.design.block_mse import BlockMse
from tmca.priors.blocks import BlockModel


def phases(model: BlockModel, period: tuple[int, int], shift: tuple[int, int] = (0, 0)) -> list[tuple[int, int]]:
    """Corners (top, left) of blocks whose judged columns cover one period, moved by ``shift``."""
    first, last = model.judged
    rows, columns = range(0, period[0], model.block[1]), range(0, period[1], last - first)
    return [(top + shift[0], left - first + shift[1]) for top in rows for left in columns]


def even_shifts(model: BlockModel, count: int) -> list[tuple[int, int]]:
    """Shifts (rows, columns) that share out a block evenly."""
    first, last = model.judged
    return [(i * model.block[1] // count, i * (last - first) // count) for i in range(count)]


def even_places(model: BlockModel, period: tuple[int, int], count: int) -> list[tuple[int, int]]:
    """Corners of the blocks of all even shifts over one period."""
    return [place for shift in even_shifts(model, count) for place in phases(model, period, shift)]


def count_places(model: BlockModel, period: tuple[int, int], count: int) -> int:
    """How many corners ``even_places`` gives, without a list of them."""
    first, last = model.judged
    return count * ceil(period[0] / model.block[1]) * ceil(period[1] / (last - first))


def windows(code: Tensor, block: tuple[int, int, int], places: list[tuple[int, int]]) -> Tensor:
    """(P, taps, h, w) windows of a code (taps, period rows, period columns) that repeats itself for ever."""
    (_, h, w), (_, height, width) = block, code.shape
    top, left = torch.tensor(places).unbind(1)
    rows = (top[:, None] + torch.arange(h)) % height
    columns = (left[:, None] + torch.arange(w)) % width
    return code[:, rows[:, :, None], columns[:, None, :]].transpose(0, 1)


class CodeError(Protocol):
    """Expected mean squared error of a tiled code, whatever scenes are expected."""

    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """Of one period of a code, differentiable; see ``TileMse``."""

    def whole(self, camera: CodedCamera, shifts: int = 4) -> float:
        """Of a camera of one period."""


@dataclass(frozen=True)
class TileMse:
    """Expected mean squared error of a tiled code.

    Args:
        error: of single blocks.
        most: blocks whose error is computed at once.
    """

    error: BlockMse
    most: int = 16

    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """Scalar, in squared irradiance, of one period (taps, rows, columns) of a code; differentiable.

        Args:
            shift: of the blocks over the period.
        """
        model = self.error.model
        places = phases(model, (code.shape[1], code.shape[2]), shift)
        total = code.new_zeros((), dtype=torch.float64)
        for start in range(0, len(places), self.most):
            total = total + self.error(windows(code, model.block, places[start : start + self.most])).sum()
        return total / len(places)

    @torch.no_grad()
    def whole(self, camera: CodedCamera, shifts: int = 4) -> float:
        """The error of a camera of one period, mean over shifts of the blocks that share it out evenly."""
        code = camera.taps().code
        return float(torch.stack([self(code, shift) for shift in even_shifts(self.error.model, shifts)]).mean())
