"""What changes of a few weights do to the expected error of a block, without a new factorisation for each.

A changed pixel of a code changes the weights of r of the m measurements. Then ``G`` and ``M`` of ``block_mse`` change
in r rows and columns, and ``tr G⁻¹ M`` follows by the Woodbury identity with matrices of size 2r.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.design.block_mse import BlockMse, Products


@dataclass(frozen=True)
class BlockState:
    """One block under its present weights.

    Args:
        error: of such blocks.
        weights: (m, T), float64.
        products: of these weights, a batch of one.
    """

    error: BlockMse
    weights: Tensor
    products: Products

    @classmethod
    def of(cls, error: BlockMse, weights: Tensor) -> BlockState:
        """The state of a block under weights (m, T)."""
        weights = weights.double()
        return cls(error, weights, Products.of(error, weights[None]))

    @property
    def value(self) -> float:
        """Mean squared error over the judged pixels."""
        return self.error.variance - float(self.products.error_removed[0])

    def after(self, changes: Tensor) -> Tensor:
        """(B,) errors under ``weights + changes[b]``, changes (B, m, T), each of them alone."""
        rows, kept = _changed_rows(changes)
        inverse, reached = self.products.inverse[0], self.products.reached[0]
        ahead, among = self._forms(self.error.covariance, self.products.covariant, rows, kept)
        ahead_reach, among_reach = self._forms(self.error.reach, self.products.reaching, rows, kept)
        among = among + torch.diag_embed(self._noise_change(rows, kept))
        touched = inverse[:, rows].movedim(0, 1)  # (B, m, r): G⁻¹E
        low = torch.cat([touched, inverse @ ahead.mT], -1)  # G⁻¹U with U = [E, Fᵀ]
        own = low.gather(1, rows[:, :, None].expand(-1, -1, low.shape[2]))  # Eᵀ G⁻¹ U
        bridge = torch.cat([own, ahead @ low], 1) + _middle(among)
        turned = own.mT @ (ahead_reach @ low)
        moved = low.mT @ (reached @ low) + turned + turned.mT + own.mT @ among_reach @ own
        gained = 2 * (ahead_reach * touched.mT).sum((1, 2))
        gained = gained + (among_reach * own[..., : rows.shape[1]]).sum((1, 2))
        lost = torch.linalg.solve(bridge, moved).diagonal(dim1=1, dim2=2).sum(1)
        return self.error.variance - (self.products.error_removed[0] + gained - lost)

    def _forms(self, form: Tensor, half: Tensor, rows: Tensor, changes: Tensor) -> tuple[Tensor, Tensor]:
        """(B, r, m) form between changed and present weights, (B, r, r) between changed and changed ones."""
        near = half[:, 0, rows]  # (m, B, r, T)
        ahead = torch.einsum("mbrt,brt->brm", near, changes)
        pairs = form[rows[:, :, None], :, rows[:, None, :], :]  # (B, r, r, T, T)
        return ahead, torch.einsum("brt,brstu,bsu->brs", changes, pairs, changes)

    def _noise_change(self, rows: Tensor, changes: Tensor) -> Tensor:
        """(B, r) change of the shot noise of the changed measurements."""
        mean = self.error.mean
        before = (self.weights * mean).sum(-1)[rows]
        after = before + (changes * mean[rows]).sum(-1)
        return self.error.shot * (after.clamp_min(0) - before.clamp_min(0))


def _changed_rows(changes: Tensor) -> tuple[Tensor, Tensor]:
    """(B, r) rows that change, filled up with others, and (B, r, T) what they change by."""
    touched = (changes != 0).any(-1)
    count = max(1, int(touched.sum(1).max()))
    rows = touched.to(torch.uint8).sort(dim=1, descending=True, stable=True).indices[:, :count]
    return rows, changes.gather(1, rows[:, :, None].expand(-1, -1, changes.shape[2]))


def _middle(among: Tensor) -> Tensor:
    """Inverse of ``[[H, 1], [1, 0]]``: ``[[0, 1], [1, -H]]``."""
    one = torch.eye(among.shape[1], dtype=among.dtype).expand_as(among)
    return torch.cat([torch.cat([torch.zeros_like(among), one], 2), torch.cat([one, -among], 2)], 1)
