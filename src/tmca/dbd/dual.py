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
from scipy.linalg import eigh

from tmca.dbd.coordinates import Complex, Real, Whole
from tmca.dbd.model import Problem, Source
from tmca.errors import SettingError, TmcaError

_CHECK = 25
_RELAXATION = 1.6


class Gram:
    """Index arithmetic of one source's inequality.

    Args:
        source: the transmitter.
        shape: antennas, pulses, frequencies.
    """

    def __init__(self, source: Source, shape: tuple[int, int, int]) -> None:
        antennas, pulses, frequencies = shape
        a, p, n = np.meshgrid(np.arange(antennas), np.arange(pulses), np.arange(frequencies), indexing="ij")
        self.lattice = shape if source.sees_doppler else (antennas, 1, frequencies)
        self.size = int(np.prod(self.lattice))
        self.unknowns, self.bound = source.unknowns, source.weight
        pulse = p if source.sees_doppler else np.zeros_like(p)
        self.columns = ((a * self.lattice[1] + pulse) * frequencies + n).reshape(-1, 1)
        first = (source.message[p] * source.subspace).reshape(-1, 1)
        self.rows = first + np.arange(source.subspace)
        self.values = np.conj(source.rows[p, n]).reshape(-1, source.subspace)
        self.lags = lag_numbers(self.lattice)
        self.lag_sizes = np.bincount(self.lags.reshape(-1)).astype(float)

    def coefficients(self, q: Complex) -> Complex:
        """H, ``(G J, lattice)``, for a dual variable ``(A P M,)``."""
        matrix = np.zeros((self.unknowns, self.size), complex)
        matrix[self.rows, self.columns] = self.values * q[:, None]
        return matrix

    def adjoint(self, matrix: Complex) -> Complex:
        """Of :meth:`coefficients`: ``(A P M,)``."""
        return np.sum(np.conj(self.values) * matrix[self.rows, self.columns], axis=1)

    def power(self) -> Real:
        """The diagonal of ``adjoint(coefficients)``."""
        return np.sum(np.abs(self.values) ** 2, axis=1)

    def unit_traces(self, matrix: Complex) -> Complex:
        """The nearest matrix whose diagonals sum to zero, but the main one to one (thesis equation 80)."""
        flat, numbers = matrix.reshape(-1), self.lags.reshape(-1)
        count = len(self.lag_sizes)
        sums = np.bincount(numbers, flat.real, count) + 1j * np.bincount(numbers, flat.imag, count)
        sums[self.lags[0, 0]] -= 1
        return matrix - (sums / self.lag_sizes)[self.lags]


def lag_numbers(lattice: tuple[int, int, int]) -> Whole:
    """``(N, N)``: the number of the lag between two samples, the same for the same difference in every axis."""
    places = np.stack(np.unravel_index(np.arange(int(np.prod(lattice))), lattice))
    numbers = np.zeros((places.shape[1],) * 2, np.int64)
    for place, extent in zip(places, lattice, strict=True):
        numbers = numbers * (2 * extent - 1) + (place[None, :] - place[:, None] + extent - 1)
    return numbers


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


@dataclass
class _State:
    """Slack and scaled multiplier of every inequality, the step length and the last q."""

    slack: list[Complex]
    multiplier: list[Complex]
    step: float
    q: Complex


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
    y = problem.y.reshape(-1)
    state = _start(parts, y)
    power = np.asarray(sum(part.power() for part in parts)) if level else _heard(parts, y)
    stopped, worst, done = False, np.inf, 0
    negative = [0] * len(parts)
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
    value = float(np.real(np.vdot(state.q, y)) - level / 2 * np.linalg.norm(state.q) ** 2)
    q = state.q.reshape(problem.shape)
    return DualSolution(q, value, done, float(worst), bool(worst < tolerance), stopped)


def _heard(parts: list[Gram], y: Complex) -> Real:
    """The power of all sources in every sample; infinite, so that q is zero, in silent samples that nobody fills."""
    power = np.asarray(sum(part.power() for part in parts))
    silent = power == 0
    if np.any(np.abs(y[silent]) > 1e-9 * np.abs(y).max()):
        unreached = f"{int(np.sum(silent))} samples that no basis reaches"
        raise SettingError(
            "y", unreached, "zeros there, or noise that is known", "leave these samples out, or give sigma"
        )
    return np.where(silent, np.inf, power)


def _start(parts: list[Gram], y: Complex) -> _State:
    diagonals = [np.repeat([1 / one.size, one.bound**2], [one.size, one.unknowns]) for one in parts]
    slack: list[Complex] = [np.diag(one).astype(complex) for one in diagonals]
    return _State(slack, [np.zeros_like(one) for one in slack], 0.05, np.zeros_like(y))


def _nearest(parts: list[Gram], state: _State, y: Complex, power: Real, level: float, gram: str) -> list[Complex]:
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
    matrices = []
    for part, corner in zip(parts, corners, strict=True):
        matrix = np.diag(np.full(part.size + part.unknowns, part.bound**2, complex))  # np.block would take longer
        matrix[: part.size, : part.size] = part.unit_traces(corner)
        matrix[part.size :, : part.size] = coefficients = part.coefficients(q)
        matrix[: part.size, part.size :] = coefficients.conj().T
        matrices.append(matrix)
    return matrices


def _projected(
    affine: list[Complex], state: _State, negative: list[int]
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


def _residuals(affine: list[Complex], before: list[Complex], state: _State) -> tuple[float, float]:
    def norm(matrices: list[Complex]) -> float:
        return float(np.sqrt(sum(np.linalg.norm(one) ** 2 for one in matrices)))

    primal = norm([slack - matrix for slack, matrix in zip(state.slack, affine, strict=True)])
    dual = state.step * norm([slack - old for slack, old in zip(state.slack, before, strict=True)])
    return primal / (1 + norm(state.slack)), dual / (1 + state.step * norm(state.multiplier))


def _balance(state: _State, primal: float, dual: float) -> None:
    """Keeps the two residuals within a factor of five."""
    if primal > 5 * dual:
        scale = 2.0
    elif dual > 5 * primal:
        scale = 0.5
    else:
        return
    state.step *= scale
    state.multiplier = [one / scale for one in state.multiplier]


def positive_part(matrix: Complex, few_negative: bool) -> tuple[Complex, int]:
    """The nearest positive semidefinite matrix, and how many eigenvalues were negative.

    Args:
        matrix: Hermitian ``(n, n)``.
        few_negative: whether the negative eigenvalues are expected to be the fewer.
    """
    limits = (-np.inf, 0.0) if few_negative else (0.0, np.inf)
    values, vectors = eigh(matrix, subset_by_value=limits, driver="evr", check_finite=False)
    part = (vectors * values) @ vectors.conj().T
    if few_negative:
        return matrix - part, len(values)
    return part, len(matrix) - len(values)


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
    try:
        cp: Any = import_module("cvxpy")
    except ImportError as error:
        raise TmcaError("method=cvxpy", "no CVXPY", "it installed", 'pip install "tmca[dbd]"') from error
    if solver not in cp.installed_solvers():
        raise TmcaError("solver", f"{solver!r}", f"one of {', '.join(cp.installed_solvers())}", "CLARABEL or SCS")
    q = cp.Variable(problem.y.size, complex=True)
    constraints: list[Any] = []
    corner = None
    for part in (Gram(source, problem.shape) for source in problem.sources):
        if corner is None or gram != "shared":
            corner, traces = _unit_gram(part)
            constraints.append(traces)
        coefficients = _coefficients(part, q, problem.y.size)
        bound = part.bound**2 * np.eye(part.unknowns)
        constraints.append(cp.bmat([[corner, coefficients.H], [coefficients, bound]]) >> 0)
    objective = cp.real(cp.sum(cp.multiply(np.conj(problem.y.reshape(-1)), q)))
    if level:
        objective = objective - level / 2 * cp.sum_squares(cp.hstack([cp.real(q), cp.imag(q)]))
    programme = cp.Problem(cp.Maximize(objective), constraints)
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


def _unit_gram(part: Gram) -> tuple[Any, Any]:
    """A Hermitian variable and the constraint on the sums of its diagonals, a half of which follows from the other."""
    from scipy.sparse import csr_matrix

    cp: Any = import_module("cvxpy")
    matrix = cp.Variable((part.size, part.size), hermitian=True)
    numbers = part.lags.T.reshape(-1)  # CVXPY stacks columns
    middle = int(part.lags[0, 0])
    half = np.flatnonzero(numbers >= middle)
    used, positions = np.unique(numbers[half], return_inverse=True)
    entries = (np.ones(positions.size), (positions, half))
    sums = csr_matrix(entries, shape=(len(used), numbers.size))
    return matrix, sums @ cp.vec(matrix, order="F") == (used == middle).astype(float)


def _coefficients(part: Gram, q: Any, samples: int) -> Any:
    """The coefficients of a CVXPY variable."""
    from scipy.sparse import csr_matrix

    cp: Any = import_module("cvxpy")
    units = [part.coefficients(unit).reshape(-1, order="F") for unit in np.eye(samples, dtype=complex)]
    return cp.reshape(csr_matrix(np.stack(units, axis=1)) @ q, (part.unknowns, part.size), order="F")
