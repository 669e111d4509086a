"""Cholesky factors held in half of their room."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class FoldedFactors:
    """P lower triangular factors (m, m), with the last half's triangle transposed above the first half's.

    Args:
        triangles: (P, h + 1, h), transposed: of h = ⌈m/2⌉ rows and as many columns, and the other m - h.
        across: (P, h, m - h) the square that both halves share, transposed.
    """

    triangles: Tensor
    across: Tensor

    @classmethod
    def room(cls, count: int, side: int) -> FoldedFactors:
        """Room for so many factors (m, m), float64."""
        half = -(-side // 2)
        triangles = torch.empty(count, half + 1, half, dtype=torch.float64)
        return cls(triangles, triangles.new_empty(count, half, side - half))

    def part(self, places: slice) -> FoldedFactors:
        """Some of the factors, or of the room, without a copy."""
        return FoldedFactors(self.triangles[places], self.across[places])

    def fill(self, factors: Tensor) -> None:
        """Copy factors (P, m, m) into the room, which has as many places."""
        upper, (half, rest) = factors.mT, self.across.shape[1:]
        torch.triu(upper[:, :half, :half], out=self.triangles[:, :half])
        self.triangles[:, half] = 0
        self.triangles[:, 1 : rest + 1, :rest] += factors[:, half:, half:].tril()
        self.across.copy_(upper[:, :half, half:])

    @staticmethod
    def bytes_of(count: int, side: int) -> int:
        """That so many factors (m, m) take."""
        half = -(-side // 2)
        return count * half * (side + 1) * torch.float64.itemsize

    def solve(self, one: int, values: Tensor) -> Tensor:
        """(N, m) solutions x of L Lᵀ x = y for one factor L and values y (N, m)."""
        first, last, across = self._parts(one)
        start = _substituted(first, values[:, : len(first)].mT, upper=False)
        rest = _substituted(last.mT, values[:, len(first) :].mT - across @ start, upper=False)
        rest = _substituted(last, rest, upper=True)
        start = _substituted(first.mT, start - across.mT @ rest, upper=True)
        return torch.cat([start, rest]).mT

    def whole(self, one: int) -> Tensor:
        """(m, m) one of the factors."""
        first, last, across = self._parts(one)
        above = torch.cat([first.tril(), torch.zeros_like(across.mT)], 1)
        return torch.cat([above, torch.cat([across, last.triu().mT], 1)])

    def _parts(self, one: int) -> tuple[Tensor, Tensor, Tensor]:
        """The first half's triangle, below the last half's transposed one, that itself, and the square they share."""
        square, across = self.triangles[one], self.across[one].mT
        half, rest = square.shape[1], len(across)
        return square[:half].mT, square[1 : rest + 1, :rest].mT, across


def _substituted(triangle: Tensor, values: Tensor, upper: bool) -> Tensor:
    return torch.linalg.solve_triangular(triangle, values, upper=upper)
