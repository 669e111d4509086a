"""Sparse recovery of many small signals at once: orthogonal matching pursuit, and the LASSO by ADMM.

Signals come in G groups of P that share a matrix: patches behind the same part of a tiled code. Where each signal
has a matrix of its own, P = 1.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from tmca.decoders.least_squares import check_iteration
from tmca.errors import check_range, check_shape

_RELAXATION, _CHECK_EVERY = 1.8, 5
_IMBALANCE, _RESCALE, _REBALANCINGS = 5.0, 2.0, 20
_TINY = {torch.float32: 1e-5, torch.float64: 1e-11}


def batch_omp(
    matrices: Tensor, measured: Tensor, sparsity: int, tolerance: float | Tensor = 0.0, forced: int = 0
) -> Tensor:
    """Codes (G, P, K) of at most ``sparsity`` entries by orthogonal matching pursuit (Pati et al. 1993).

    Every step takes the column that correlates best with what is left, whatever its norm, and fits all columns
    taken so far anew, by an orthonormal basis that grows with them. A signal stops at its tolerance.

    Args:
        matrices: (G, m, K).
        measured: (G, P, m).
        sparsity: largest number of entries, ``forced`` ones included.
        tolerance: squared norm of the residual at which a signal is done; one, or (G, P).
        forced: the first so many columns are taken before any other.

    Raises:
        ShapeError, SettingError: matrices and signals that do not fit each other, or a number out of range.
    """
    _check_shapes(matrices, measured)
    check_range("forced", forced, 0)
    check_range("sparsity", sparsity, max(1, forced), min(matrices.shape[1:]))
    limit = torch.as_tensor(tolerance).to(measured).expand(measured.shape[:2])
    check_range("tolerance", float(limit.min()), 0)
    pursuit = _Pursuit(matrices, measured, sparsity)
    floor = (_TINY[measured.dtype] ** 2) * measured.square().sum(-1)
    for step in range(sparsity):
        energy = pursuit.residual.square().sum(-1)
        going = (energy > floor) if step < forced else (energy > limit.maximum(floor))
        if not going.any():
            break
        pursuit.take(pursuit.best() if step >= forced else torch.full_like(pursuit.chosen[..., 0], step), going)
    return pursuit.codes()


class _Pursuit:
    """Signals under pursuit: the columns taken, their orthonormal basis and triangle, and what is left."""

    def __init__(self, matrices: Tensor, measured: Tensor, sparsity: int) -> None:
        groups, signals, m = measured.shape
        self.matrices, self.residual = matrices, measured.clone()
        self.lengths = torch.linalg.vector_norm(matrices, dim=1)
        # a column that measures (next to) nothing is never taken
        self.inverse = torch.where(self.lengths > 1e-12 * self.lengths.amax(), 1 / self.lengths, 0).nan_to_num(posinf=0)
        self.basis = measured.new_zeros(groups, signals, sparsity, m)
        self.triangle = torch.eye(sparsity).to(measured).repeat(groups, signals, 1, 1)
        self.chosen = torch.zeros(groups, signals, sparsity, dtype=torch.long, device=measured.device)
        self.shares = measured.new_zeros(groups, signals, sparsity)
        self.free = torch.ones(groups, signals, matrices.shape[-1], dtype=torch.bool, device=measured.device)
        self.count = 0

    def best(self) -> Tensor:
        """(G, P) the free column that correlates best with the residual."""
        correlation = (self.residual @ self.matrices).abs_().mul_(self.inverse[:, None])
        return torch.where(self.free, correlation, -1).argmax(-1)

    def take(self, column: Tensor, going: Tensor) -> None:
        """Add a column (G, P) to the signals that go on; one that lies in the span of the others adds nothing."""
        step, groups = self.count, torch.arange(len(column), device=column.device)[:, None]
        unit = self.matrices.mT[groups, column] * self.inverse[groups, column][..., None]
        part, left = torch.zeros_like(self.shares[..., :step]), unit
        for _ in range(2):  # twice is enough (Kahan)
            along = (self.basis[..., :step, :] @ left[..., None])[..., 0]
            left = left - (along[..., None, :] @ self.basis[..., :step, :])[..., 0, :]
            part = part + along
        length = torch.linalg.vector_norm(left, dim=-1)
        useful = going & (length > 10 * _TINY[unit.dtype])
        fresh = torch.where(useful[..., None], left / length.clamp_min(1e-30)[..., None], 0)
        share = (fresh * self.residual).sum(-1)
        self.residual = self.residual - share[..., None] * fresh
        self.basis[..., step, :], self.shares[..., step], self.chosen[..., step] = fresh, share, column
        self.triangle[..., :step, step] = torch.where(useful[..., None], part, 0)
        self.triangle[..., step, step] = torch.where(useful, length, 1)
        self.free.scatter_(-1, column[..., None], False)
        self.count += 1

    def codes(self) -> Tensor:
        """(G, P, K) coefficients of the columns taken."""
        n = self.count
        solved = torch.linalg.solve_triangular(self.triangle[..., :n, :n], self.shares[..., :n, None], upper=True)
        scaled = solved[..., 0] * self.inverse[:, None].expand(self.free.shape).gather(-1, self.chosen[..., :n])
        return torch.zeros_like(self.free, dtype=scaled.dtype).scatter_add_(-1, self.chosen[..., :n], scaled)


class LassoResult(NamedTuple):
    """Codes (G, P, K), with exact zeros, and whether the residuals of all signals are within the tolerance."""

    codes: Tensor
    iterations: int
    converged: bool


def lasso_admm(
    matrices: Tensor,
    measured: Tensor,
    weight: float | Tensor,
    free: int = 0,
    *,
    max_iterations: int = 500,
    tolerance: float = 1e-3,
) -> LassoResult:
    """``argmin_x ½‖A x − y‖² + weight Σ_k |x_k|`` for every signal, by ADMM (Boyd et al. 2011).

    The quadratic step needs ``(A Aᵀ + ρ I)⁻¹``: measurements are few, so A Aᵀ is diagonalised once, and every signal
    then balances its penalty ρ for free. Columns without a penalty are solved for and eliminated.

    Args:
        matrices: (G, m, K).
        measured: (G, P, m).
        weight: ≥ 0; one, or one per column that is not free.
        free: number of leading columns without a penalty; they have to be independent.
        max_iterations: done at most.
        tolerance: of the relative primal and dual residuals, for every signal.

    Raises:
        ShapeError, SettingError: tensors that do not fit each other, or a number out of range.
    """
    _check_shapes(matrices, measured)
    check_iteration(max_iterations, tolerance)
    check_range("free", free, 0, min(matrices.shape[1], matrices.shape[2] - 1))
    weights = torch.as_tensor(weight).to(matrices)
    if weights.ndim:
        check_shape("weight", weights, (matrices.shape[2] - free,))
    for extreme in weights.aminmax():
        check_range("weight", float(extreme), 0)
    if not free:
        return _iterate(_Split(matrices, measured, weights), max_iterations, tolerance)
    basis, triangle = torch.linalg.qr(matrices[..., :free])
    others, across = matrices[..., free:], basis.mT @ matrices[..., free:]
    inside = measured @ basis
    result = _iterate(_Split(others - basis @ across, measured - inside @ basis.mT, weights), max_iterations, tolerance)
    first = torch.linalg.solve_triangular(triangle, (inside - result.codes @ across.mT).mT, upper=True).mT
    return result._replace(codes=torch.cat([first, result.codes], -1))


def _iterate(split: _Split, max_iterations: int, tolerance: float) -> LassoResult:
    for iteration in range(1, max_iterations + 1):
        before = split.z
        split.step()
        if iteration % _CHECK_EVERY and iteration < max_iterations:
            continue
        primal, dual = split.residuals(before)
        if max(float(primal.max()), float(dual.max())) <= tolerance:
            return LassoResult(split.z, iteration, True)
        if iteration <= _CHECK_EVERY * _REBALANCINGS and 2 * iteration <= max_iterations:
            split.balance(primal, dual)
    return LassoResult(split.z, max_iterations, False)


class _Split:
    """ADMM on x = z in the coordinates of the measurements in which A Aᵀ is diagonal."""

    def __init__(self, matrices: Tensor, measured: Tensor, weights: Tensor) -> None:
        gram = (matrices @ matrices.mT).double()
        energies, rotation = torch.linalg.eigh(gram)
        rotation = rotation.to(matrices.dtype)
        self.matrices = rotation.mT @ matrices
        self.measured = measured @ rotation
        self.energies = energies.clamp_min(0).to(matrices.dtype)[:, None]
        self.weights = weights
        self.z = measured.new_zeros(*measured.shape[:2], matrices.shape[-1])
        self.x, self.dual = self.z, torch.zeros_like(self.z)
        typical = self.energies.sum((1, 2), keepdim=True) / matrices.shape[-1]
        self.rho = typical.clamp_min(1e-12).repeat(1, measured.shape[1], 1)

    def step(self) -> None:
        point = self.z - self.dual
        misfit = torch.baddbmm(self.measured, point, self.matrices.mT, beta=-1).div_(self.energies + self.rho)
        self.x = torch.baddbmm(point, misfit, self.matrices, alpha=-1)
        relaxed = torch.lerp(self.z, self.x, _RELAXATION).add_(self.dual)
        limit = self.weights / self.rho
        self.dual = relaxed.clamp(-limit, limit)
        self.z = relaxed.sub_(self.dual)

    def residuals(self, before: Tensor) -> tuple[Tensor, Tensor]:
        """(G, P) relative primal and dual residuals."""
        size = _length(self.z).maximum(_length(self.x)).clamp_min(1e-30)
        return _length(self.x - self.z) / size, _length(self.z - before) / size.maximum(_length(self.dual))

    def balance(self, primal: Tensor, dual: Tensor) -> None:
        """Signals whose residuals differ much change their penalty."""
        factor = torch.where(primal > _IMBALANCE * dual, _RESCALE, 1.0).to(self.rho)
        factor = torch.where(dual > _IMBALANCE * primal, 1 / _RESCALE, factor)[..., None]
        self.rho = self.rho * factor
        self.dual = self.dual / factor


def _length(values: Tensor) -> Tensor:
    return torch.linalg.vector_norm(values, dim=-1)


def _check_shapes(matrices: Tensor, measured: Tensor) -> None:
    check_shape("matrices", matrices, ("G", "m", "K"))
    check_shape("measured", measured, (len(matrices), "P", matrices.shape[1]))
