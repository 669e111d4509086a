"""``method="sfw"``: an exact fit without noise, one regularisation in known noise, a path of them in unknown."""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.estimates.channels import Channel, split
from tmca.dbd.estimates.noise import noise_level
from tmca.dbd.estimates.order import cost, selected
from tmca.dbd.estimates.structured import fit, residual
from tmca.dbd.problem import Problem
from tmca.dbd.solvers.exact import EXACT, exact_fit
from tmca.dbd.solvers.frank_wolfe import LEVELS, crowded, descend, largest_level, path
from tmca.dbd.solvers.lifted import Lifted

_SHRINK = 0.6
"""Step down in the noise level where it is unknown."""
_OVERFIT = 0.6
"""Share of the best estimate of the noise below which a level only explains noise."""
_NO_NOISE = 1e-7
"""Relative residual below which unknown noise is none."""


def lifted(problem: Problem) -> Lifted:
    """Solves with the noise the problem states."""
    if problem.sigma is None:
        return _unknown_noise(problem)
    audible = EXACT * float(np.sqrt(np.mean(np.abs(problem.y) ** 2)))
    return _noisy(problem, problem.sigma) if problem.sigma > audible else _noiseless(problem)


def _noiseless(problem: Problem) -> Lifted:
    measure = Measure.empty(problem)
    best: tuple[float, Measure | None] = (np.inf, None)
    levels = []
    for share, level in zip(LEVELS, path(measure), strict=False):
        levels.append(level)
        trial = exact_fit(measure, share / 3)
        best = min(best, trial, key=lambda one: one[0])
        if best[0] < EXACT or crowded(measure):
            break
    q = (measure.residual() / levels[-1]).reshape(problem.shape)
    solution = best[1] or measure
    return Lifted(solution, fit(split(problem, solution), problem.y), q, 0.0)


def _noisy(problem: Problem, sigma: float) -> Lifted:
    measure = Measure.empty(problem)
    return _at_noise(problem, measure, sigma, noise_level(problem) * sigma)


def _at_noise(problem: Problem, measure: Measure, sigma: float, level: float) -> Lifted:
    """Solves on from a measure at one regularisation; the measure is changed in place."""
    top = largest_level(measure)
    steps = [] if sum(measure.counts) else [share * top for share in (0.5, 0.25) if share * top > level]
    if measure.unknowns < measure.y.size:  # beyond, only the selection of paths goes on
        for step in (*steps, level):
            descend(measure, step, rounds=15, weak=1e-4)
    q = (measure.residual() / level).reshape(problem.shape)
    joined = measure.copy()
    joined.merge(0.6)
    if not sum(joined.counts):
        return Lifted(joined, split(problem, joined), q, sigma)
    return Lifted(joined, selected(split(problem, joined), problem.y, sigma), q, sigma)


def _unknown_noise(problem: Problem) -> Lifted:
    """Lowers the noise level until the Bayesian information criterion with unknown noise is at its best."""
    measure, factor = Measure.empty(problem), noise_level(problem)
    size = problem.y.size
    scale = float(np.linalg.norm(problem.y)) / np.sqrt(size)
    sigma = min(scale, 0.9 * largest_level(measure) / factor)
    best: tuple[float, Lifted | None] = (np.inf, None)
    least = 0.0
    while sigma > max(_NO_NOISE * scale, least):
        solution = _at_noise(problem, measure, sigma, factor * sigma)
        left = float(np.linalg.norm(residual(solution.channels, problem.y)))
        free = size - _parameters(solution.channels) / 2
        if free < size / 4:
            break
        if left < _NO_NOISE * scale * np.sqrt(size):
            return _noiseless(problem)
        solution.sigma = float(left / np.sqrt(free))
        judged = _information(solution.channels, problem.y)
        if judged < best[0]:
            best, least = (judged, solution), _OVERFIT * solution.sigma
        sigma *= _SHRINK
    if best[1] is None:
        return _noisy(problem, sigma)
    return best[1]


def _parameters(channels: list[Channel]) -> int:
    return sum(one.points.size + 2 * (len(one.points) + one.waveform.size - 1) for one in channels if len(one.points))


def _information(channels: list[Channel], y: Complex) -> float:
    """The Bayesian information criterion where the noise level is a parameter too."""
    left = float(np.linalg.norm(residual(channels, y)) ** 2)
    prices = cost(channels, y, 1.0) - 2 * left
    return 2 * y.size * float(np.log(left / y.size)) + prices
