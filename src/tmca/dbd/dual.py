"""The dual semidefinite programme: its matrix inequalities, and two solvers of one interface.

``max Re⟨q, y⟩ − level/2 ‖q‖²`` subject to one inequality per source: ``‖f‖ ≤ weight`` everywhere holds if
``[[K, Hᴴ], [H, weight² I]] ⪰ 0`` with the traces of a unit polynomial in K (thesis equations 79 to 81; every source has
a Gram matrix of its own, and block messages a lossless one in the delay alone). The alternating direction method of
multipliers works on complex Hermitian matrices: its steps in q and in the Gram matrices are closed, the projection is
the cost. CVXPY is an oracle for small sizes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np

from tmca.dbd.model import Complex, Problem, Real, Source, Whole
from tmca.errors import SettingError, TmcaError

_CHECK = 25
_RELAXATION = 1.6


@dataclass
class DualSolution:
    """The dual variable and how far a solver came.

    Args:
        q: ``(A, P, M)``.
        value: ``Re⟨q, y⟩``, less ``level/2 ‖q‖²``.
        iterations: used.
        residual: the larger of the relative primal and dual residuals.
        converged: whether it fell below the tolerance.
        stopped: whether ``stop`` ended the iterations.
    """

    q: Complex = field(repr=False)
    value: float
    iterations: int = 0
    residual: float = 0.0
    converged: bool = True
    stopped: bool = False


class Gram:
    """One source's inequality: its index arithmetic, and its matrices while the multipliers' method iterates.

    Args:
        source: the transmitter.
        shape: antennas, pulses, frequencies.
    """

    def __init__(self, source: Source, shape: tuple[int, int, int]) -> None:
        from scipy.sparse import csr_array

        antenna, pulse, frequency = np.indices(shape).reshape(3, -1)
        lattice = shape if source.sees_doppler else (shape[0], 1, shape[2])
        self.size, self.unknowns, self.bound = int(np.prod(lattice)), source.unknowns, source.weight
        place = np.ravel_multi_index((antenna, pulse * source.sees_doppler, frequency), lattice)
        rows = source.message[pulse, None] * source.subspace + np.arange(source.subspace)
        samples = np.repeat(np.arange(place.size), source.subspace)
        values = np.conj(source.rows[pulse, frequency]).reshape(-1)
        shape_ = (self.unknowns * self.size, place.size)
        self.entries = csr_array((values, ((rows * self.size + place[:, None]).reshape(-1), samples)), shape=shape_)
        """The coefficients of the polynomial, flattened, for each unit vector in the place of q."""

        self.lags = _lags(lattice)
        self.lag_sizes = np.bincount(self.lags.reshape(-1)).astype(float)
        """Numbers of the steps between two places, and how many pairs are each step apart."""

        diagonal = np.repeat([1 / self.size, self.bound**2], [self.size, self.unknowns])
        self.slack: Complex = np.diag(diagonal).astype(complex)
        self.affine = self.before = self.slack
        self.multiplier: Complex = np.zeros_like(self.slack)
        self.negative = 0

    def coefficients(self, q: Complex) -> Complex:
        """H, ``(G J, lattice)``, for a dual variable ``(A P M,)``."""
        return (self.entries @ q).reshape(self.unknowns, self.size)

    def adjoint(self, matrix: Complex) -> Complex:
        """Of :meth:`coefficients`: ``(A P M,)``."""
        return self.entries.T.conj() @ matrix.reshape(-1)

    def power(self) -> Real:
        """The diagonal of ``adjoint(coefficients)``."""
        return np.asarray((abs(self.entries) ** 2).sum(axis=0))

    def unit_traces(self, matrix: Complex) -> Complex:
        """The nearest matrix whose diagonals sum to zero, but the main one to one (thesis equation 80)."""
        flat, numbers, count = matrix.reshape(-1), self.lags.reshape(-1), len(self.lag_sizes)
        sums = np.bincount(numbers, flat.real, count) + 1j * np.bincount(numbers, flat.imag, count)
        sums[self.lags[0, 0]] -= 1
        return matrix - (sums / self.lag_sizes)[self.lags]

    def iterate(self, corner: Complex, q: Complex) -> None:
        """The nearest matrix with unit traces and the coefficients of q, its positive part, and the multiplier."""
        matrix = np.diag(np.full(self.size + self.unknowns, self.bound**2, complex))  # np.block would take longer
        matrix[: self.size, : self.size] = self.unit_traces(corner)
        matrix[self.size :, : self.size] = coefficients = self.coefficients(q)
        matrix[: self.size, self.size :] = coefficients.conj().T
        relaxed = _RELAXATION * matrix + (1 - _RELAXATION) * self.slack
        target = relaxed - self.multiplier
        target = 0.5 * (target + target.conj().T)
        self.affine, self.before = matrix, self.slack
        self.slack, self.negative = positive_part(target, self.negative <= len(target) // 2)
        self.multiplier = self.multiplier + self.slack - relaxed


def _lags(lattice: tuple[int, ...]) -> Whole:
    """``(size, size)``, a number for the step from every place of a lattice to every other."""
    places = np.indices(lattice).reshape(3, -1)
    lags = np.zeros((places.shape[1], places.shape[1]), np.int64)
    for one, extent in zip(places, lattice, strict=True):
        lags = lags * (2 * extent - 1) + (one[None, :] - one[:, None] + extent - 1)
    return lags


def positive_part(matrix: Complex, few_negative: bool) -> tuple[Complex, int]:
    """The nearest positive semidefinite matrix, and how many eigenvalues were negative.

    Args:
        matrix: Hermitian ``(n, n)``.
        few_negative: whether the negative eigenvalues are expected to be the fewer.
    """
    from scipy.linalg import eigh

    limits = (-np.inf, 0.0) if few_negative else (0.0, np.inf)
    values, vectors = eigh(matrix, subset_by_value=limits, driver="evr", check_finite=False)
    part = (vectors * values) @ vectors.conj().T
    return (matrix - part, len(values)) if few_negative else (part, len(matrix) - len(values))


def solve_admm(
    problem: Problem,
    *,
    gram: str = "separate",
    level: float = 0.0,
    iterations: int = 6000,
    tolerance: float = 1e-5,
    stop: Callable[[Complex], bool] | None = None,
    progress: Callable[..., None] | None = None,
) -> DualSolution:
    """The dual by the alternating direction method of multipliers.

    Args:
        problem: samples and sources.
        gram: ``separate``, or ``shared`` for the thesis' one Gram matrix for all sources, a restriction.
        level: of regularisation; 0 fits the samples exactly.
        iterations: at most.
        tolerance: of the relative residuals.
        stop: asked every 25 iterations with q ``(A, P, M)``; True ends early.
        progress: called with the share of the iterations and, as ``detail``, the residual.
    """
    parts = [Gram(source, problem.shape) for source in problem.sources]
    y, step, worst, stopped = problem.y.reshape(-1), 0.05, np.inf, False
    power = _power(parts, y, level)
    for done in range(1, iterations + 1):
        q = _iterated(parts, y / (2 * step), power + level / (2 * step), gram)
        if progress is not None:
            progress(done / iterations, detail=f"residual {worst:.1e}, at most {iterations} iterations")
        if done % _CHECK:
            continue
        primal, dual = _residuals(parts, step)
        worst = max(primal, dual)
        stopped = stop is not None and stop(q.reshape(problem.shape))
        if worst < tolerance or stopped:
            break
        if done < 0.6 * iterations:
            step = _balanced(parts, step, primal, dual)
    value = float(np.real(np.vdot(q, y)) - level / 2 * np.linalg.norm(q) ** 2)
    return DualSolution(q.reshape(problem.shape), value, done, float(worst), bool(worst < tolerance), stopped)


def _iterated(parts: list[Gram], pull: Complex, power: Real, gram: str) -> Complex:
    """One iteration of every source's matrices from the best dual variable for those there are, which is returned."""
    sums = [one.slack + one.multiplier for one in parts]
    pulled = sum(one.adjoint(total[one.size :, : one.size]) for one, total in zip(parts, sums, strict=True))
    q = (pull + pulled) / power
    corners = [total[: one.size, : one.size] for one, total in zip(parts, sums, strict=True)]
    if gram == "shared":
        corners = [np.mean(corners, axis=0)] * len(parts)
    for one, corner in zip(parts, corners, strict=True):
        one.iterate(corner, q)
    return q


def _balanced(parts: list[Gram], step: float, primal: float, dual: float) -> float:
    """The step, and with it the multipliers, that keep the two residuals within a factor of five."""
    factor = 2.0 if primal > 5 * dual else 0.5 if dual > 5 * primal else 1.0
    for one in parts:
        one.multiplier = one.multiplier / factor
    return step * factor


def _power(parts: list[Gram], y: Complex, level: float) -> Real:
    """The power of all sources in every sample; infinite, so that q is zero, in silent samples that nobody fills."""
    power = np.sum([part.power() for part in parts], axis=0)
    silent = power == 0
    if level or not np.any(silent):
        return power
    if np.any(np.abs(y[silent]) > 1e-9 * np.abs(y).max()):
        unreached = f"{int(np.sum(silent))} samples that no basis reaches"
        remedy = "leave these samples out, or give sigma"
        raise SettingError("y", unreached, "zeros there, or noise that is known", remedy)
    return np.where(silent, np.inf, power)


def _residuals(parts: list[Gram], step: float) -> tuple[float, float]:
    """The relative primal and dual residuals."""

    def norm(matrices: list[Complex]) -> float:
        return float(np.sqrt(sum(np.linalg.norm(one) ** 2 for one in matrices)))

    primal = norm([one.slack - one.affine for one in parts]) / (1 + norm([one.slack for one in parts]))
    dual = step * norm([one.slack - one.before for one in parts])
    return primal, dual / (1 + step * norm([one.multiplier for one in parts]))


def solve_cvx(
    problem: Problem, *, gram: str = "separate", level: float = 0.0, solver: str = "CLARABEL", **settings: Any
) -> DualSolution:
    """The dual by CVXPY.

    Args:
        problem: samples and sources.
        gram: ``separate`` or ``shared`` Gram matrices.
        level: of regularisation.
        solver: CVXPY's name of it, ``CLARABEL`` or ``SCS``.
        settings: for the solver.

    Raises:
        TmcaError: CVXPY or its solver is missing, or found no solution.
    """
    cp = _cvxpy(solver)
    q = cp.Variable(problem.y.size, complex=True)
    objective = cp.real(cp.sum(cp.multiply(np.conj(problem.y.reshape(-1)), q)))
    if level:
        objective = objective - level / 2 * cp.sum_squares(cp.hstack([cp.real(q), cp.imag(q)]))
    programme = cp.Problem(cp.Maximize(objective), _inequalities(problem, q, gram, cp))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Solution may be inaccurate")  # atoms are fitted to the samples afterwards
        try:
            programme.solve(solver=solver, **settings)
        except cp.error.SolverError as error:
            said = str(error).splitlines()[0]
            raise TmcaError(f"CVXPY with {solver}", said, "a solution", "use CLARABEL or SCS") from error
    if q.value is None:
        raise TmcaError(f"CVXPY with {solver}", f"status {programme.status}", "a solution", "use method=sfw")
    return DualSolution(q.value.reshape(problem.shape), float(programme.value))


def _cvxpy(solver: str) -> Any:
    """CVXPY, where it and the solver are installed."""
    try:
        cp: Any = import_module("cvxpy")
    except ImportError as error:
        raise TmcaError("method=cvxpy", "no CVXPY", "it installed", 'pip install "tmca[dbd]"') from error
    if solver not in cp.installed_solvers():
        raise TmcaError("solver", f"{solver!r}", f"one of {', '.join(cp.installed_solvers())}", "CLARABEL or SCS")
    return cp


def _inequalities(problem: Problem, q: Any, gram: str, cp: Any) -> list[Any]:
    """The matrix inequality of every source, and the traces of its Gram matrix, or of the first one's if shared."""
    constraints: list[Any] = []
    corner = None
    for part in (Gram(source, problem.shape) for source in problem.sources):
        if corner is None or gram != "shared":
            corner, traces = _unit_gram(part, cp)
            constraints.append(traces)
        coefficients = cp.reshape(part.entries @ q, (part.unknowns, part.size), order="C")
        bound = part.bound**2 * np.eye(part.unknowns)
        constraints.append(cp.bmat([[corner, coefficients.H], [coefficients, bound]]) >> 0)
    return constraints


def _unit_gram(part: Gram, cp: Any) -> tuple[Any, Any]:
    """A Hermitian variable and the constraint on the sums of its diagonals, a half of which follows from the other."""
    from scipy.sparse import csr_array

    matrix = cp.Variable((part.size, part.size), hermitian=True)
    numbers, middle = part.lags.reshape(-1), int(part.lags[0, 0])
    half = np.flatnonzero(numbers >= middle)
    used, positions = np.unique(numbers[half], return_inverse=True)
    sums = csr_array((np.ones(half.size), (positions, half)), shape=(len(used), numbers.size))
    return matrix, sums @ cp.vec(matrix, order="C") == (used == middle).astype(float)
