"""Is a recovery the optimum of the sum of atomic norms? A dual polynomial says so, without a semidefinite programme.

The dual variable has to give ``f(xᵢ) = weight · wᵢ/‖wᵢ‖`` with a stationary norm at every atom and ``‖f‖ ≤ weight``
everywhere (thesis proposition 1, with injectivity on the support). The first two are linear; the bound is imposed at
the points where it is broken, again and again (exchange method), by second-order cones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import Channel, each_atom, paths
from tmca.dbd.model import Complex, Real

TOLERANCE = 1e-6
"""By how much ``‖f‖`` may exceed its bound."""
_EXCESS = 1e-5
"""Share of the bounds that no dual variable keeps by accident of the cone solver's rounding."""
_LARGEST = 700
"""Samples up to which the exchange method is tried; beyond, only the dual variable of least norm."""
_TOUCHES = 1e-5
_CUTS = 400
_ROUNDS = 25
_GRID = 8
_PEAKS = 40


@dataclass(frozen=True)
class Certificate:
    """Whether there is a dual variable that proves an optimum.

    Args:
        status: ``certified``; ``refuted``, no dual variable exists, the recovery is not the atomic-norm optimum;
            ``undecided``.
        level: largest ``‖f‖ / weight`` of the dual variable, on a grid of 8 points a cell and Newton steps from there.
        reason: in words.
        q: the dual variable ``(A, P, M)``.
        unique: whether no other measure is as good: the atoms at all points where the polynomials touch their bounds
            are independent.
    """

    status: str
    level: float
    reason: str
    q: Complex | None = field(default=None, repr=False)
    unique: bool = False

    @property
    def certified(self) -> bool | None:
        """True, False, or None for undecided."""
        return {"certified": True, "refuted": False}.get(self.status)


def certificate(channels: Sequence[Channel]) -> Certificate:
    """Looks for a dual certificate of lifted channels that fit the samples."""
    if not any(paths(channels)):
        return Certificate("undecided", np.inf, "no atoms")
    start, free, conflict = _interpolating(channels)
    if conflict > 1e-8:
        return Certificate("refuted", np.inf, "no polynomial takes these values at these atoms")
    coordinates: Real = np.zeros(free.shape[1])
    cuts: list[tuple[Atoms, Real]] = []
    samples = start.size // 2
    for _ in range(_ROUNDS):
        both = start + free @ coordinates
        q = (both[:samples] + 1j * both[samples:]).reshape(channels[0].atoms.shape)
        broken, level = _broken(channels, q)
        if not broken:
            return _certified(channels, level, q)
        if samples > _LARGEST:
            reason = f"the dual polynomial of least norm exceeds its bound and {samples} samples are many"
            return Certificate("undecided", level, reason, q)
        cuts = (cuts + broken)[-_CUTS:]
        solution, status, reason = _within(start, free, cuts)
        if solution is None:
            return Certificate(status, level, reason, q)
        coordinates = solution
    return Certificate("undecided", level, f"{_ROUNDS} rounds were not enough", q)


def _broken(channels: Sequence[Channel], q: Complex) -> tuple[list[tuple[Atoms, Real]], float]:
    """Where the polynomials of a dual variable exceed their bounds, and the largest share of a bound."""
    broken, level = [], 0.0
    for one in channels:
        points, levels = Polynomial(one.atoms, q).peaks(0.5, _GRID, _PEAKS)
        level = max(level, float(levels.max(initial=0.0)))
        broken += [(one.atoms, x) for x in points[levels > 1 + TOLERANCE]]
    return broken, level


def _certified(channels: Sequence[Channel], level: float, q: Complex) -> Certificate:
    """With whether the optimum is the only one: every other one is of atoms where this polynomial touches too."""
    touching = [one.with_peaks(q, 1 - _TOUCHES, _PEAKS, _GRID) for one in channels]
    matrix = np.hstack([one.linear() for one in touching])
    unique = bool(np.linalg.matrix_rank(matrix, 1e-7 * np.linalg.norm(matrix)) == matrix.shape[1])
    reason = "a dual polynomial exists" if unique else "there may be other optima"
    return Certificate("certified", level, reason, q, unique)


def _interpolating(channels: Sequence[Channel]) -> tuple[Real, Real, float]:
    """The least-norm dual variable with the right values and no slope at the atoms, the others' space, the misfit."""
    rows, values = [], []
    for atoms, point, weight in each_atom(channels):
        direction = weight / np.linalg.norm(weight)
        rows.append(_real_rows(atoms, point))
        values.append(atoms.source.weight * np.concatenate([direction.real, direction.imag]))
        slopes = atoms.slopes(point[None], direction)
        rows.append(np.hstack([slopes.real.T, slopes.imag.T]))
        values.append(np.zeros(slopes.shape[1]))
    matrix, wanted = np.vstack(rows), np.concatenate(values)
    left, sizes, right = np.linalg.svd(matrix)
    rank = int(np.sum(sizes > 1e-10 * sizes[0]))
    start = right[:rank].T @ ((left[:, :rank].T @ wanted) / sizes[:rank])
    return start, right[rank:].T, float(np.linalg.norm(matrix @ start - wanted))


def _real_rows(atoms: Atoms, point: Real) -> Real:
    """``f`` at a point as a real matrix on (real q, imaginary q)."""
    adjoint = atoms.matrix(point).conj().T
    return np.vstack([np.hstack([adjoint.real, -adjoint.imag]), np.hstack([adjoint.imag, adjoint.real])])


def _within(start: Real, free: Real, cuts: list[tuple[Atoms, Real]]) -> tuple[Real | None, str, str]:
    """Coordinates of the least dual variable within its bounds at the cuts; or None, what that means and why."""
    size, excess, bounds = free.shape[1], 0.0, [atoms.source.weight for atoms, _ in cuts]
    rows = [_real_rows(atoms, point) for atoms, point in cuts]
    blocks = [np.vstack([np.zeros((1, size)), -one @ free]) for one in rows]
    offsets = [np.append(bound, one @ start) for one, bound in zip(rows, bounds, strict=True)]
    solution, status = _solved(np.ones(size), np.zeros(size), np.vstack(blocks), offsets)
    if solution is None and "Infeasible" not in status:
        # the least norm stalls where bounds can just or just not be kept; by the least share they can be exceeded
        slack = [np.append(-bound, np.zeros(len(block) - 1)) for block, bound in zip(blocks, bounds, strict=True)]
        exceeded = [np.column_stack(pair) for pair in zip(blocks, slack, strict=True)]
        last = np.append(np.zeros(size), 1.0)
        quadratic = np.append(np.full(size, 1e-10), 0.0)
        solution, status = _solved(quadratic, last, np.vstack([-last, *exceeded]), [np.zeros(1), *offsets])
        if solution is not None:
            solution, excess = solution[:-1], float(solution[-1])
    if excess > _EXCESS or "Infeasible" in status:
        return None, "refuted", "no dual polynomial stays below its bound"
    return solution, "undecided", f"the cone solver said {status}"


def _solved(quadratic: Real, linear: Real, rows: Real, offsets: list[Real]) -> tuple[Real | None, str]:
    """``min ½ xᵀ diag(quadratic) x + linearᵀ x`` with ``offsets − rows x`` in cones of the offsets' sizes."""
    import clarabel
    from scipy.sparse import csc_matrix, diags

    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_iter = False, 60
    cones = [clarabel.NonnegativeConeT(1) if len(one) == 1 else clarabel.SecondOrderConeT(len(one)) for one in offsets]
    problem = (diags(quadratic, format="csc"), linear, csc_matrix(rows), np.concatenate(offsets))
    solution = clarabel.DefaultSolver(*problem, cones, settings).solve()
    status = str(solution.status)
    return (np.array(solution.x) if "Solved" in status else None), status
