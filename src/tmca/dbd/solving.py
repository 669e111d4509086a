"""One interface to every solver."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tmca.dbd.arrays import Real
from tmca.dbd.estimates.channels import Channel
from tmca.dbd.estimates.structured import bounds, residual
from tmca.dbd.identifiability import BeyondFreedom, SameSignals, ambiguities, beyond_freedom, same_signals
from tmca.dbd.problem import Problem
from tmca.dbd.recovery import RecoveredSource, Recovery
from tmca.dbd.solvers.certificate import Certificate, certificate
from tmca.dbd.solvers.exact import EXACT
from tmca.dbd.solvers.lifted import Lifted
from tmca.errors import SettingError

METHODS = ("sfw", "sdp", "cvxpy")
GRAMS = ("separate", "shared")


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
        progress: told the share that ``sdp`` has done, 0 to 1, and a ``detail``.

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
        from tmca.dbd.solvers.by_frank_wolfe import lifted

        solution = lifted(problem)
    else:
        from tmca.dbd.solvers.by_dual import lifted_by_dual

        solution = lifted_by_dual(
            problem, method, gram=gram, early=early, accuracy=accuracy, solver=solver, progress=progress
        )
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
        said = beyond_freedom(problem, [len(one.points) for one in problem.truth])
        if said:
            warnings.warn(said, BeyondFreedom, stacklevel=3)


def _recovery(problem: Problem, method: str, solution: Lifted, certify: bool, began: float) -> Recovery:
    left = float(np.linalg.norm(residual(solution.channels, problem.y)) / np.linalg.norm(problem.y))
    audible = [one for one in solution.channels if len(one.points)]
    unknowns = sum(2 * (len(one.points) + one.waveform.size - 1) + one.points.size for one in audible)
    exact = bool(solution.sigma == 0 and left < EXACT and unknowns < 2 * problem.y.size)
    proof: Certificate | None = None
    if certify and exact:
        proof = certificate(solution.measure)
    paths = [len(one.points) for one in solution.channels]
    notes = [*ambiguities(problem), *solution.notes]
    if beyond_freedom(problem, paths):
        notes.append(f"{sum(paths)} paths have more lifted unknowns than there are samples: they mean nothing")
    if proof is not None and (proof.status != "certified" or not proof.unique):
        notes.append(f"{'certified, but' if proof.certified else 'not certified:'} {proof.reason}")
    deviations = bounds(solution.channels, solution.sigma) if solution.sigma > 0 and any(paths) else None
    sources = [
        _source(one, None if deviations is None else deviations[index]) for index, one in enumerate(solution.channels)
    ]
    q = proof.q if proof is not None and proof.certified and proof.q is not None else solution.q
    return Recovery(
        problem, method, tuple(sources), left, exact, proof, solution.sigma, q, time.perf_counter() - began,
        tuple(notes),
    )  # fmt: skip


def _source(channel: Channel, deviations: Real | None) -> RecoveredSource:
    source = channel.atoms.source
    points = channel.full_points()
    spread = None if deviations is None else _in_full(channel, deviations)
    signal, relative = source.signal(channel.waveform), channel.relative_axis is not None
    return RecoveredSource(source.name, points, channel.amplitudes, channel.waveform, signal, spread, relative)


def _in_full(channel: Channel, values: Real) -> Real:
    """``(n, D)`` values as ``(n, 3)``, NaN for an axis that does not exist."""
    return Channel(channel.atoms, values, channel.amplitudes, channel.waveform).full_points()
