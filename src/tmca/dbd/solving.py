"""One interface to every solver."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tmca.dbd.certificate import Certificate, certificate
from tmca.dbd.channel import Channels, no_paths, paths, relative_residual, unknowns, with_fitted_weights
from tmca.dbd.doubts import loud_sigma, whole_doubt
from tmca.dbd.dual import solve_admm, solve_cvx
from tmca.dbd.frank_wolfe import EXACT, Solution, exact_fit, frank_wolfe, rounds_told
from tmca.dbd.identifiability import (
    BeyondFreedom,
    LittleExplained,
    OneWay,
    SameSignals,
    ambiguities,
    beyond_freedom,
    same_signals,
    taken_one_way,
)
from tmca.dbd.model import Complex, Problem
from tmca.dbd.noise import bounds, noise_level, structured
from tmca.dbd.paths import walk_line
from tmca.dbd.recovery import Recovery
from tmca.dbd.separation import joint_separation
from tmca.dbd.tables import separation_line
from tmca.errors import SettingError, check_choice, check_range
from tmca.progress import Asked, reporting

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
    progress: Asked = None,
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
        progress: called with the share that ``sdp`` has done, 0 to 1, None for ``sfw``, and a ``detail``; True for a
            bar, False for none; None for one that is shown after a second in a terminal or a notebook.

    Returns:
        The recovery; ``found``, ``exact`` and ``certified`` are separate statements.

    Raises:
        SettingError: an unknown method, weights that do not fit, a size beyond the method's memory.

    Warns:
        OneWay: a source whose name is nearly ``radar``.
        SameSignals, BeyondFreedom: problems that have no unique answer.
        LittleExplained: a recovery that leaves half of the signal or more, or has nearly as many unknowns as there
            are samples; or bases whose conjugate, or whose reverse in frequency, or another pulse, explains the
            samples better.
    """
    began = time.perf_counter()
    check_choice("method", method, METHODS)
    check_choice("gram", gram, GRAMS)
    check_range("accuracy", accuracy, above=0, below=1)
    if not np.any(problem.y):
        raise SettingError("y", "only zeros", "samples of a signal")
    problem = _weighted(problem, weights)
    _warn_of(problem)
    if method != "sfw":
        _check_dual(problem, method, gram, solver)
    with reporting(progress, method) as report:
        if method == "sfw":
            solution = frank_wolfe(problem, rounds_told(report))
        else:
            solution = _by_dual(problem, method, gram, early, accuracy, solver, report)
        recovery = _recovery(problem, method, solution, certify, began, report)
    if recovery.doubt:
        warnings.warn(recovery.doubt, LittleExplained, stacklevel=2)
    return recovery


def _warn_of(problem: Problem) -> None:
    """Warns the caller of `solve` of names, and of what has no unique answer."""
    for name in taken_one_way(problem):
        warnings.warn(name, OneWay, stacklevel=3)
    for same in same_signals(problem):
        warnings.warn(same, SameSignals, stacklevel=3)
    excess = problem.truth and beyond_freedom(problem, [len(one.points) for one in problem.truth])
    if excess:
        warnings.warn(excess, BeyondFreedom, stacklevel=3)


def _weighted(problem: Problem, weights: Sequence[float] | str | None) -> Problem:
    if weights is None:
        return problem
    if isinstance(weights, str):
        if weights != "balanced":
            raise SettingError("weights", f"{weights!r}", "balanced, or a number for each source")
        fourth = problem.shape[1] ** -0.25
        weights = [source.weight * (1.0 if source.sees_doppler else fourth) for source in problem.sources]
    given = np.atleast_1d(weights)
    if given.shape != (len(problem.sources),):
        raise SettingError("weights", f"{given.size} numbers", f"one for each of {len(problem.sources)} sources")
    pairs = zip(problem.sources, given, strict=True)
    return replace(problem, sources=tuple(replace(source, weight=float(weight)) for source, weight in pairs))


def _check_dual(problem: Problem, method: str, gram: str, solver: str) -> None:
    """Refuses what the programme does not know and sizes that would not fit, before anything is built."""
    where, samples = f"method={method}", float(problem.y.size)
    if problem.sigma is None:
        remedy = "give sigma, or use method=sfw, which estimates it"
        raise SettingError(where, "an unknown noise level", "a known one", remedy)
    if method == "cvxpy":
        needed = _SCS_BYTES * samples**2 if solver == "SCS" else _CLARABEL_BYTES * samples**4
    else:
        pulses = problem.shape[1]
        orders = [samples / (1 if one.sees_doppler else pulses) + one.unknowns for one in problem.sources]
        needed = sum(16.0 * _MATRICES * order**2 for order in orders)
    available = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.8 * available:
        size = f"{problem.y.size} samples, about {needed / 1e9:.3g} GB"
        expected = f"at most {0.8 * available / 1e9:.3g} GB on this machine"
        raise SettingError(where, size, expected, "use method=sfw, which needs no such matrix")
    if gram == "shared" and any(not source.sees_doppler for source in problem.sources) and problem.shape[1] > 1:
        raise SettingError("gram=shared", "messages that absorb the Doppler", "separate ones", "use gram=separate")


def _by_dual(
    problem: Problem, method: str, gram: str, early: bool, accuracy: float, solver: str,
    progress: Callable[..., None] | None,
) -> Solution:  # fmt: skip
    """Atoms where the dual polynomials of the programme touch their bounds, and the channels in them."""
    sigma = problem.sigma or 0.0
    level = noise_level(problem) * sigma if sigma else 0.0
    if method == "cvxpy":
        result = solve_cvx(problem, gram=gram, level=level, solver=solver)
    else:
        stop = (lambda q: _explaining(problem, q) is not None) if early and not level else None
        result = solve_admm(problem, gram=gram, level=level, tolerance=accuracy, stop=stop, progress=progress)
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


def _touching(problem: Problem, q: Complex, share: float) -> Channels:
    """Atoms at the maxima of the dual polynomials that reach a share of their bounds, with least-squares weights."""
    channels = [one.with_peaks(q, share, most=30) for one in no_paths(problem)]
    if any(paths(channels)) and unknowns(channels) < 2 * problem.y.size:
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


def _recovery(
    problem: Problem, method: str, solution: Solution, certify: bool, began: float, report: Callable[..., None] | None
) -> Recovery:
    channels, counts = solution.channels, paths(solution.channels)
    left = relative_residual(channels, problem.y)
    exact = bool(solution.sigma == 0 and left < EXACT and unknowns(channels) < 2 * problem.y.size)
    proof = certificate(solution.lifted) if certify and exact else None
    notes = _notes(problem, solution, left, proof)
    if solution.sigma > 0 and any(counts):
        pairs = zip(channels, bounds(channels, solution.sigma), strict=True)
        channels = [replace(one, bounds=one.atoms.full(deviations)) for one, deviations in pairs]
    q = proof.q if proof is not None and proof.certified and proof.q is not None else solution.q
    doubtful = whole_doubt(problem, channels, left, exact, report)
    seconds, sigma = time.perf_counter() - began, solution.sigma
    recovery = Recovery(problem, method, tuple(channels), left, exact, proof, sigma, q, seconds, (), doubtful)
    separated = any(one.satisfied or not one.nearest for one in joint_separation(recovery))
    close = "" if separated or sum(counts) < 2 else separation_line(recovery)
    notes += [line for line in (walk_line(recovery), close) if line]
    return replace(recovery, notes=tuple(notes))


def _notes(problem: Problem, solution: Solution, left: float, proof: Certificate | None) -> list[str]:
    """What cannot be known, and what is doubtful about a solution that leaves so much."""
    notes, counts = [*ambiguities(problem), *solution.notes], paths(solution.channels)
    if loud := loud_sigma(problem, solution.channels, left):
        notes.append(loud)
    if beyond_freedom(problem, counts):
        notes.append(f"{sum(counts)} paths have more lifted unknowns than there are samples: they mean nothing")
    if proof is not None and (proof.status != "certified" or not proof.unique):
        notes.append(f"{'certified, but' if proof.certified else 'not certified:'} {proof.reason}")
    return notes
