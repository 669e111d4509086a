"""The dual semidefinite programme through CVXPY: an oracle for small sizes."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

import numpy as np

from tmca.dbd.arrays import Complex
from tmca.dbd.problem import Problem
from tmca.dbd.solvers.gram import Gram, grams
from tmca.errors import TmcaError


def solve_dual_cvx(
    problem: Problem, *, gram: str = "separate", level: float = 0.0, solver: str = "CLARABEL", **settings: Any
) -> tuple[Complex, float]:
    """The dual variable ``(A, P, M)`` and the value of the dual.

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
    parts = grams(problem)
    q = cp.Variable(problem.y.size, complex=True)
    constraints: list[Any] = []
    corner = None
    for part in parts:
        if corner is None or gram != "shared":
            corner, traces = _unit_gram(part)
            constraints.append(traces)
        coefficients = _coefficients(part, q)
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
    return q.value.reshape(problem.shape), float(programme.value)


def _unit_gram(part: Gram) -> tuple[Any, Any]:
    """A Hermitian variable and the constraint on the sums of its diagonals, a half of which follows from the other."""
    from scipy.sparse import csr_matrix

    cp: Any = import_module("cvxpy")
    matrix = cp.Variable((part.size, part.size), hermitian=True)
    numbers = part.lags.T.reshape(-1)  # CVXPY stacks columns
    middle = int(part.lags[0, 0])
    kept = numbers >= middle
    used, positions = np.unique(numbers[kept], return_inverse=True)
    entries = (np.ones(positions.size), (positions, np.flatnonzero(kept)))
    sums = csr_matrix(entries, shape=(len(used), numbers.size))
    return matrix, sums @ cp.vec(matrix, order="F") == (used == middle).astype(float)


def _coefficients(part: Gram, q: Any) -> Any:
    from scipy.sparse import csr_matrix

    cp: Any = import_module("cvxpy")
    rows, columns = np.broadcast_arrays(part.rows, part.columns)
    samples = np.broadcast_to(np.arange(len(part.rows))[:, None], rows.shape)
    places = (rows + part.unknowns * columns).reshape(-1)
    shape = (part.unknowns * part.size, len(part.rows))
    matrix = csr_matrix((part.values.reshape(-1), (places, samples.reshape(-1))), shape=shape)
    return cp.reshape(matrix @ q, (part.unknowns, part.size), order="F")
