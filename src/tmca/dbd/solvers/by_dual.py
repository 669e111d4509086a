"""``method="sdp"`` and ``"cvxpy"``: atoms where the dual polynomials of the programme touch their bounds."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

from tmca.dbd.arrays import Complex
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.atoms.polynomial import Polynomial
from tmca.dbd.estimates.channels import split
from tmca.dbd.estimates.noise import noise_level
from tmca.dbd.estimates.order import selected
from tmca.dbd.estimates.structured import fit
from tmca.dbd.problem import Problem
from tmca.dbd.solvers.admm import solve_dual
from tmca.dbd.solvers.cvx import solve_dual_cvx
from tmca.dbd.solvers.exact import EXACT, refined
from tmca.dbd.solvers.lifted import Lifted
from tmca.errors import SettingError

Told = Callable[..., None]
_TOUCHES = (0.97, 0.99, 0.997, 0.999)
"""Shares of its bound from which a polynomial touches it; a plateau shows as many maxima at the lower ones."""
_MATRICES = 14
"""Matrices of the size of an inequality that the iterations hold at once."""
_CLARABEL_BYTES = 550.0
"""Per fourth power of the samples: 2.25 GB at 45 samples."""
_SCS_BYTES = 2e4
"""Per square of the samples: 0.24 GB at 117 samples."""


def lifted_by_dual(
    problem: Problem, method: str, *, gram: str, early: bool, accuracy: float, solver: str, progress: Told | None
) -> Lifted:
    """Solves the dual and fits the atoms it shows."""
    if problem.sigma is None:
        remedy = "give sigma, or use method=sfw, which estimates it"
        raise SettingError(f"method={method}", "an unknown noise level", "a known one", remedy)
    _check_memory(problem, f"{method} {solver}" if method == "cvxpy" else method)
    if gram == "shared" and any(not source.sees_doppler for source in problem.sources) and problem.shape[1] > 1:
        raise SettingError("gram=shared", "messages that absorb the Doppler", "separate ones", "use gram=separate")
    level = noise_level(problem) * problem.sigma if problem.sigma else 0.0
    if method == "cvxpy":
        q, _ = solve_dual_cvx(problem, gram=gram, level=level, solver=solver)
        return _from_dual(problem, q)
    stop = (lambda q: _explaining(problem, q) is not None) if early and not level else None
    dual = solve_dual(problem, gram=gram, level=level, tolerance=accuracy, stop=stop, progress=progress)
    solution = _from_dual(problem, dual.q)
    if not dual.converged and not dual.stopped:
        said = f"the dual programme has not converged: residual {dual.residual:.1e} after {dual.iterations} iterations"
        solution.notes = (said,)
    return solution


def touching(problem: Problem, q: Complex, share: float) -> Measure:
    """Atoms at the maxima of the dual polynomials that reach a share of their bounds, with least-squares weights."""
    measure = Measure.empty(problem)
    for index, atoms in enumerate(measure.atoms):
        points, _ = Polynomial(atoms, q).peaks(share * atoms.source.weight, most=30)
        measure.add(index, points)
    if sum(measure.counts) and measure.unknowns < 2 * measure.y.size:
        measure.fit_weights()
    return measure


def _explaining(problem: Problem, q: Complex) -> Measure | None:
    """The atoms that a dual variable shows, if they explain the samples exactly."""
    seen: set[tuple[int, ...]] = set()
    for share in _TOUCHES:
        measure = touching(problem, q, share)
        trial = refined(measure, 0.02) if sum(measure.counts) and measure.counts not in seen else None
        seen.add(measure.counts)
        if trial is not None and trial.relative_residual() < EXACT:
            return trial
    return None


def _from_dual(problem: Problem, q: Complex) -> Lifted:
    measure = touching(problem, q, _TOUCHES[0])
    sigma = problem.sigma or 0.0
    if not sum(measure.counts):
        return Lifted(measure, split(problem, measure), q, sigma)
    if sigma:
        measure.merge(0.6)
        return Lifted(measure, selected(split(problem, measure), problem.y, sigma), q, sigma)
    measure = _explaining(problem, q) or measure
    return Lifted(measure, fit(split(problem, measure), problem.y), q, sigma)


def _check_memory(problem: Problem, method: str) -> None:
    """Refuses sizes that would not fit, before anything is built."""
    available = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    samples = problem.y.size
    if method == "cvxpy SCS":
        needed = _SCS_BYTES * float(samples) ** 2
    elif method.startswith("cvxpy"):
        needed = _CLARABEL_BYTES * float(samples) ** 4
    else:
        orders = [
            int(np.prod(problem.shape)) if one.sees_doppler else problem.shape[0] * problem.shape[2]
            for one in problem.sources
        ]
        needed = sum(
            16.0 * _MATRICES * (order + one.unknowns) ** 2 for order, one in zip(orders, problem.sources, strict=True)
        )
    if needed > 0.8 * available:
        found = f"{samples} samples, about {needed / 1e9:.3g} GB"
        expected = f"at most {0.8 * available / 1e9:.3g} GB on this machine"
        raise SettingError(f"method={method}", found, expected, "use method=sfw, which needs no such matrix")
