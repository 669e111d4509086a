"""One interface to every solver."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tmca.dbd.atoms import Polynomial
from tmca.dbd.certificate import certificate
from tmca.dbd.channel import Channels, no_paths, paths, relative_residual, with_fitted_weights
from tmca.dbd.coordinates import Complex
from tmca.dbd.dual import DualSolution, solve_admm, solve_cvx
from tmca.dbd.frank_wolfe import EXACT, Solution, exact_fit, frank_wolfe
from tmca.dbd.model import BeyondFreedom, Problem, SameSignals, ambiguities, beyond_freedom, same_signals
from tmca.dbd.noise import bounds, noise_level, structured
from tmca.dbd.recovery import Recovery
from tmca.errors import SettingError

METHODS = ("sfw", "sdp", "cvxpy")
GRAMS = ("separate", "shared")
_TOUCHES = (0.97, 0.99, 0.997, 0.999)
"""Shares of its bound from which a polynomial touches it; a plateau shows as many maxima at the lower ones."""
_MATRICES = 14
"""Matrices of the size of an inequality that the iterations hold at once."""
_CLARABEL_BYTES = 550.0
"""Per fourth power of the samples: 2.25 GB at 45 samples."""
_SCS_BYTES = 2e4
"""Per square of the samples: 0.24 GB at 117 samples."""


def solve(
    problem: Problem,
    method: str = "sfw",
    *,
    certify: bool = True,
    weights: Sequence[float] | str | None = None,
    gram: str = "separate",
    early: bool = True,
    accuracy: float = 1e-5,
    solver: str = "CLARABEL",
    progress: Callable[..., None] | None = None,
) -> Recovery:
    """Finds the paths and signals of every source.

    Args:
        problem: samples and what is known of the sources. Its ``sigma`` decides how noise is met: 0 asks for an exact
            fit, a number regularises by it, None estimates it.
        method: ``sfw``, sliding Frank–Wolfe, at every size; ``sdp``, the dual semidefinite programme by the
            alternating direction method of multipliers; ``cvxpy``, the same by CVXPY, an oracle for small sizes.
        certify: look for a dual certificate of a noiseless recovery.
        weights: of the sources in the sum of atomic norms; by default those of the sources;
            ``balanced`` multiplies those of ``block`` messages by P^(−1/4).
        gram: ``separate`` Gram matrices, or the thesis' ``shared`` one (equation 81), for ``sdp`` and ``cvxpy``.
        early: let ``sdp`` stop as soon as its peaks explain noiseless samples exactly.
        accuracy: relative residual at which ``sdp`` ends; the value of the programme is about ten times as inexact.
        solver: CVXPY's name of the solver.
        progress: called with the share that ``sdp`` has done, 0 to 1, and a ``detail``.

    Returns:
        The recovery; ``found``, ``exact`` and ``certified`` are separate statements.

    Raises:
        SettingError: an unknown method, weights that do not fit, a size beyond the method's memory.
    """
    began = time.perf_counter()
    if method not in METHODS:
        raise SettingError("method", f"{method!r}", f"one of {', '.join(METHODS)}")
    if gram not in GRAMS:
        raise SettingError("gram", f"{gram!r}", f"one of {', '.join(GRAMS)}")
    if not 0 < accuracy < 1:
        raise SettingError("accuracy", f"{accuracy}", "a relative residual between 0 and 1, such as 1e-5")
    problem = _weighted(problem, weights)
    _warn(problem)
    if not np.any(problem.y):
        raise SettingError("y", "only zeros", "samples of a signal")
    if method == "sfw":
        solution = frank_wolfe(problem)
    else:
        solution = _by_dual(problem, _Dual(method, gram, early, accuracy, solver, progress))
    return _recovery(problem, method, solution, certify, began)


def _weighted(problem: Problem, weights: Sequence[float] | str | None) -> Problem:
    if weights is None:
        return problem
    if isinstance(weights, str):
        if weights != "balanced":
            raise SettingError("weights", f"{weights!r}", "balanced, or a number for each source")
        fourth = problem.shape[1] ** -0.25
        weights = [source.weight * (1.0 if source.sees_doppler else fourth) for source in problem.sources]
    given = np.atleast_1d(np.asarray(weights, float))
    if given.shape != (len(problem.sources),):
        raise SettingError("weights", f"{given.size} numbers", f"one for each of {len(problem.sources)} sources")
    pairs = zip(problem.sources, given, strict=True)
    return replace(problem, sources=tuple(replace(source, weight=float(weight)) for source, weight in pairs))


def _warn(problem: Problem) -> None:
    """Says before the work that it cannot succeed."""
    for same in same_signals(problem):
        warnings.warn(same, SameSignals, stacklevel=3)
    if problem.truth is not None:
        excess = beyond_freedom(problem, [len(one.points) for one in problem.truth])
        if excess:
            warnings.warn(excess, BeyondFreedom, stacklevel=3)


@dataclass(frozen=True)
class _Dual:
    """How the dual programme is solved: see :func:`solve`."""

    method: str
    gram: str
    early: bool
    accuracy: float
    solver: str
    progress: Callable[..., None] | None

    def __call__(self, problem: Problem, level: float) -> DualSolution:
        if self.method == "cvxpy":
            return solve_cvx(problem, gram=self.gram, level=level, solver=self.solver)
        stop = (lambda q: _explaining(problem, q) is not None) if self.early and not level else None
        return solve_admm(
            problem, gram=self.gram, level=level, tolerance=self.accuracy, stop=stop, progress=self.progress
        )

    def memory(self, problem: Problem) -> float:
        """Bytes that the matrices take."""
        samples = float(problem.y.size)
        if self.method == "cvxpy":
            return _SCS_BYTES * samples**2 if self.solver == "SCS" else _CLARABEL_BYTES * samples**4
        orders = [
            problem.y.size // (1 if one.sees_doppler else problem.shape[1]) + one.unknowns for one in problem.sources
        ]
        return sum(16.0 * _MATRICES * order**2 for order in orders)


def _by_dual(problem: Problem, dual: _Dual) -> Solution:
    """Atoms where the dual polynomials of the programme touch their bounds, and the channels in them."""
    _check_dual(problem, dual)
    sigma = problem.sigma or 0.0
    result = dual(problem, noise_level(problem) * sigma if sigma else 0.0)
    notes: tuple[str, ...] = ()
    if not result.converged and not result.stopped:
        reached = f"residual {result.residual:.1e} after {result.iterations} iterations"
        notes = (f"the dual programme has not converged: {reached}",)
    lifted = _touching(problem, result.q, _TOUCHES[0])
    if sigma:
        lifted = [one.merged(0.6) for one in lifted]
    elif any(paths(lifted)):
        lifted = _explaining(problem, result.q) or lifted
    return Solution(lifted, structured(lifted, problem.y, sigma), result.q, sigma, notes)


def _check_dual(problem: Problem, dual: _Dual) -> None:
    """Refuses what the programme does not know and sizes that would not fit, before anything is built."""
    where = f"method={dual.method}"
    if problem.sigma is None:
        raise SettingError(
            where, "an unknown noise level", "a known one", "give sigma, or use method=sfw, which estimates it"
        )
    needed, available = dual.memory(problem), os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.8 * available:
        size = f"{problem.y.size} samples, about {needed / 1e9:.3g} GB"
        expected = f"at most {0.8 * available / 1e9:.3g} GB on this machine"
        raise SettingError(where, size, expected, "use method=sfw, which needs no such matrix")
    if dual.gram == "shared" and any(not source.sees_doppler for source in problem.sources) and problem.shape[1] > 1:
        raise SettingError("gram=shared", "messages that absorb the Doppler", "separate ones", "use gram=separate")


def _touching(problem: Problem, q: Complex, share: float) -> Channels:
    """Atoms at the maxima of the dual polynomials that reach a share of their bounds, with least-squares weights."""
    channels = no_paths(problem)
    peaks = [Polynomial(one.atoms, q).peaks(share * one.atoms.source.weight, most=30)[0] for one in channels]
    channels = [one.added(places) for one, places in zip(channels, peaks, strict=True)]
    if any(paths(channels)) and sum(one.unknowns for one in channels) < 2 * problem.y.size:
        channels = with_fitted_weights(channels, problem.y)
    return channels


def _explaining(problem: Problem, q: Complex) -> Channels | None:
    """The atoms that a dual variable shows, if they explain the samples exactly."""
    seen: set[tuple[int, ...]] = set()
    for share in _TOUCHES:
        channels = _touching(problem, q, share)
        new = any(paths(channels)) and paths(channels) not in seen
        seen.add(paths(channels))
        left, trial = exact_fit(channels, problem.y, [0.02]) if new else (np.inf, None)
        if left < EXACT:
            return trial
    return None


def _recovery(problem: Problem, method: str, solution: Solution, certify: bool, began: float) -> Recovery:
    channels, counts = solution.channels, paths(solution.channels)
    left = relative_residual(channels, problem.y)
    unknowns = sum(one.unknowns for one in channels)
    exact = bool(solution.sigma == 0 and left < EXACT and unknowns < 2 * problem.y.size)
    proof = certificate(solution.lifted) if certify and exact else None
    notes = [*ambiguities(problem), *solution.notes]
    if beyond_freedom(problem, counts):
        notes.append(f"{sum(counts)} paths have more lifted unknowns than there are samples: they mean nothing")
    if proof is not None and (proof.status != "certified" or not proof.unique):
        notes.append(f"{'certified, but' if proof.certified else 'not certified:'} {proof.reason}")
    if solution.sigma > 0 and any(counts):
        pairs = zip(channels, bounds(channels, solution.sigma), strict=True)
        channels = [replace(one, bounds=one.atoms.full(deviations)) for one, deviations in pairs]
    q = proof.q if proof is not None and proof.certified and proof.q is not None else solution.q
    seconds = time.perf_counter() - began
    return Recovery(problem, method, tuple(channels), left, exact, proof, solution.sigma, q, seconds, tuple(notes))
