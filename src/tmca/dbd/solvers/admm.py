"""The dual semidefinite programme by the alternating direction method of multipliers, on complex Hermitian matrices.

``max Re⟨q, y⟩ − level/2 ‖q‖²`` subject to one inequality per source (:mod:`tmca.dbd.solvers.gram`). The steps in q
and in the Gram matrices are closed; the projection is the cost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.problem import Problem
from tmca.dbd.solvers.cone import positive_part
from tmca.dbd.solvers.gram import Gram, grams
from tmca.errors import SettingError

_CHECK = 25
_RELAXATION = 1.6


@dataclass
class DualSolution:
    """The dual variable and how far the iterations came.

    Args:
        q: ``(A, P, M)``.
        value: ``Re⟨q, y⟩``.
        iterations: used.
        residual: the larger of the relative primal and dual residuals.
        converged: whether it fell below the tolerance.
        stopped: whether ``stop`` ended the iterations.
        state: pass as ``warm`` to go on.
    """

    q: Complex = field(repr=False)
    value: float
    iterations: int
    residual: float
    converged: bool
    stopped: bool
    state: State = field(repr=False)


@dataclass
class State:
    """Slack and scaled multiplier of every inequality, the step length and the last q."""

    slack: list[Complex]
    multiplier: list[Complex]
    step: float
    q: Complex


def solve_dual(
    problem: Problem,
    *,
    gram: str = "separate",
    level: float = 0.0,
    iterations: int = 6000,
    tolerance: float = 1e-5,
    warm: State | None = None,
    stop: Callable[[Complex], bool] | None = None,
    progress: Callable[..., None] | None = None,
) -> DualSolution:
    """Runs the iterations.

    Args:
        problem: samples and sources.
        gram: ``separate``, or ``shared`` for the thesis' one Gram matrix for all sources, a restriction.
        level: of regularisation; 0 fits the samples exactly.
        iterations: at most.
        tolerance: of the relative residuals.
        warm: the state of an earlier run of this size.
        stop: asked every 25 iterations with q ``(A, P, M)``; True ends early.
        progress: told the share of the iterations and, as ``detail``, the residual.
    """
    parts, y = grams(problem), problem.y.reshape(-1)
    state = replace(warm) if warm else _start(parts, y)
    power = np.asarray(sum(part.power() for part in parts)) if level else _heard(parts, y)
    stopped = False
    negative = [0] * len(parts)
    affine: list[Complex] = []
    worst, done = np.inf, 0
    for done in range(1, iterations + 1):
        affine = _nearest(parts, state, y, power, level, gram)
        before = state.slack
        state.slack, state.multiplier, negative = _projected(affine, state, negative)
        if progress is not None:
            progress(done / iterations, detail=f"residual {worst:.1e}, at most {iterations} iterations")
        if done % _CHECK:
            continue
        primal, dual = _residuals(affine, before, state)
        worst = max(primal, dual)
        stopped = stop is not None and stop(state.q.reshape(problem.shape))
        if worst < tolerance or stopped:
            break
        if done < 0.6 * iterations:
            _balance(state, primal, dual)
    value, q = float(np.real(np.vdot(state.q, y))), state.q.reshape(problem.shape)
    return DualSolution(q, value, done, float(worst), bool(worst < tolerance), stopped, state)


def _heard(parts: list[Gram], y: Complex) -> Real:
    """The power of all sources in every sample; infinite, so that q is zero, in silent samples that nobody fills."""
    power = np.asarray(sum(part.power() for part in parts))
    silent = power == 0
    if np.any(np.abs(y[silent]) > 1e-9 * np.abs(y).max()):
        found = f"{int(np.sum(silent))} samples that no basis reaches"
        raise SettingError("y", found, "zeros there, or noise that is known", "leave these samples out, or give sigma")
    return np.where(silent, np.inf, power)


def _start(parts: list[Gram], y: Complex) -> State:
    slack = []
    for part in parts:
        diagonal = np.full(part.order, part.bound**2)
        diagonal[: part.size] = 1 / part.size
        slack.append(np.diag(diagonal).astype(complex))
    return State(slack, [np.zeros_like(one) for one in slack], 0.05, np.zeros_like(y))


def _nearest(parts: list[Gram], state: State, y: Complex, power: Real, level: float, gram: str) -> list[Complex]:
    """The closed step in q, and the matrices with its coefficients."""
    pairs = zip(state.slack, state.multiplier, strict=True)
    sums: list[Complex] = [slack + multiplier for slack, multiplier in pairs]
    pulled = sum(part.adjoint(one[part.size :, : part.size]) for part, one in zip(parts, sums, strict=True))
    state.q = (y / (2 * state.step) + pulled) / (power + level / (2 * state.step))
    return _affine(parts, sums, state.q, gram)


def _affine(parts: list[Gram], sums: list[Complex], q: Complex, gram: str) -> list[Complex]:
    """The matrices with unit traces and with the coefficients of q that are nearest to the sums."""
    corners = [one[: part.size, : part.size] for part, one in zip(parts, sums, strict=True)]
    if gram == "shared":
        corners = [np.mean(corners, axis=0)] * len(parts)
    found = []
    for part, corner in zip(parts, corners, strict=True):
        matrix = np.zeros((part.order, part.order), complex)
        coefficients = part.coefficients(q)
        matrix[: part.size, : part.size] = part.unit_traces(corner)
        matrix[part.size :, : part.size] = coefficients
        matrix[: part.size, part.size :] = coefficients.conj().T
        matrix[part.size :, part.size :] = part.bound**2 * np.eye(part.unknowns)
        found.append(matrix)
    return found


def _projected(
    affine: list[Complex], state: State, negative: list[int]
) -> tuple[list[Complex], list[Complex], list[int]]:
    slacks: list[Complex] = []
    multipliers: list[Complex] = []
    counts = []
    for matrix, slack, multiplier, count in zip(affine, state.slack, state.multiplier, negative, strict=True):
        relaxed = _RELAXATION * matrix + (1 - _RELAXATION) * slack
        target = relaxed - multiplier
        target = 0.5 * (target + target.conj().T)
        projected, count = positive_part(target, count <= len(target) // 2)
        slacks.append(projected)
        multipliers.append(multiplier + projected - relaxed)
        counts.append(count)
    return slacks, multipliers, counts


def _residuals(affine: list[Complex], before: list[Complex], state: State) -> tuple[float, float]:
    def norm(matrices: list[Complex]) -> float:
        return float(np.sqrt(sum(np.linalg.norm(one) ** 2 for one in matrices)))

    primal = norm([slack - matrix for slack, matrix in zip(state.slack, affine, strict=True)])
    dual = state.step * norm([slack - old for slack, old in zip(state.slack, before, strict=True)])
    return primal / (1 + norm(state.slack)), dual / (1 + state.step * norm(state.multiplier))


def _balance(state: State, primal: float, dual: float) -> None:
    """Keeps the two residuals within a factor of five."""
    if primal > 5 * dual:
        scale = 2.0
    elif dual > 5 * primal:
        scale = 0.5
    else:
        return
    state.step *= scale
    state.multiplier = [one / scale for one in state.multiplier]
