"""Sliding Frank–Wolfe over several families of lifted atoms, and what it does without, with and in unknown noise.

Denoyelle, Duval, Peyré and Soubies, "The sliding Frank–Wolfe algorithm and its application to super-resolution
microscopy", 2019, extended to complex group atoms of several sources and several insertions a round, with continuation
in the regularisation; without noise followed by an exact fit with as few atoms as explain the samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import count
from typing import NamedTuple

import numpy as np

from tmca.dbd.channel import (
    Channels,
    each_atom,
    fit,
    no_paths,
    objective,
    paths,
    relative_residual,
    residual,
    unknowns,
    with_fitted_weights,
    with_weights,
)
from tmca.dbd.model import Complex, Problem, Real
from tmca.dbd.noise import cost, largest_level, noise_level, structured

Tell = Callable[[int], None]
"""Takes the number of points, in every round."""
EXACT = 1e-9
"""Relative residual from which samples count as explained exactly."""
_LEVELS = (0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3)
"""Shares of the largest useful regularisation that a noiseless solution goes through."""
_TOLERANCE = 1e-3
_SMALL = 200
"""Unknowns that a descent may pass through, at most five for every sample."""
_FEWEST, _SAMPLES = 40, 16
"""Atoms at which a solution in noise stops: so many, or one for every so many samples, whichever is more."""
_INSERTIONS = 8
"""Most atoms that one source may gain in a round."""
_SHARES = (0.1, 0.2, 0.02, 1e-3)
"""Of the strongest atom: what is weaker is left out on trial. The last are for paths 20 to 60 dB below others."""
_CELLS = 0.6
_STEPS = 25
_MISSED = 0.1
"""Relative residual without an atom above which the others cannot take over its signal."""
_SHRINK = 0.6
"""Step down in the noise level where it is unknown."""
_OVERFIT = 0.6
"""Share of the best estimate of the noise below which a level only explains noise."""
_NO_NOISE = 1e-7
"""Relative residual below which unknown noise is none."""


class Solution(NamedTuple):
    """What every solver hands on: the channels of the convex problem and structured ones, and the dual variable."""

    lifted: Channels
    channels: Channels
    q: Complex
    sigma: float
    """Standard deviation of the noise it was solved for; 0 for none."""
    notes: tuple[str, ...] = ()
    """What is doubtful about it."""
    stopped: int = 0
    """Atoms at which it stopped, more than there may be; 0 where it did not."""


def rounds_told(report: Callable[..., None] | None, what: str = "") -> Tell:
    """What counts the rounds of work whose share nobody knows, for a progress report."""
    rounds = count(1)

    def tell(points: int) -> None:
        if report is not None:
            report(None, detail=f"{what}round {next(rounds)}, {points} points")

    return tell


def frank_wolfe(problem: Problem, tell: Tell = lambda points: None) -> Solution:
    """Solves with the noise the problem states: an exact fit, one regularisation, or a path of them if unknown."""
    if problem.sigma is None:
        return _unknown_noise(problem, tell)
    audible = EXACT * float(np.sqrt(np.mean(np.abs(problem.y) ** 2)))
    if problem.sigma <= audible:
        return _noiseless(problem, tell)
    solution = _at_noise(problem, no_paths(problem), problem.sigma, noise_level(problem) * problem.sigma, tell)
    if not solution.stopped:
        return solution
    note = (
        f"stopped at {solution.stopped} points, too many for {problem.y.size} samples: noise of the given sigma, "
        f"{problem.sigma:.3g}, does not explain the rest; the noise is estimated instead"
    )
    return _unknown_noise(problem, tell)._replace(notes=(note,))


def _noiseless(problem: Problem, tell: Tell) -> Solution:
    channels, y = no_paths(problem), problem.y
    top = level = largest_level(channels, y)
    best: tuple[float, Channels | None] = (np.inf, None)
    for share in _LEVELS:
        level = share * top
        channels = descend(channels, y, level, tell=tell)
        left = [one for one in _SHARES if one >= share / 3]  # the regularisation has left none below that counts
        best = min(best, exact_fit(channels, y, left), key=lambda one: one[0])
        if best[0] < EXACT or crowded(channels, y):
            break
    q = (residual(channels, y) / level).reshape(problem.shape)
    lifted = best[1] or channels
    return Solution(lifted, structured(lifted, y, 0.0), q, 0.0)


def _at_noise(problem: Problem, channels: Channels, sigma: float, level: float, tell: Tell) -> Solution:
    """Solves on from lifted channels at one regularisation; in ``lifted`` are the ones to go on from."""
    y, top = problem.y, largest_level(channels, problem.y)
    steps = [] if any(paths(channels)) else [share * top for share in (0.5, 0.25) if share * top > level]
    stopped, most = 0, max(_FEWEST, y.size // _SAMPLES)
    if unknowns(channels) < y.size:  # beyond, only the selection of paths goes on
        for step in (*steps, level):
            further = descend(channels, y, step, rounds=15, weak=1e-4, most=most, tell=tell)
            if sum(paths(further)) > most:
                stopped = sum(paths(further))
                break
            channels = further
    q = (residual(channels, y) / level).reshape(problem.shape)
    joined = [one.merged(_CELLS) for one in channels]
    return Solution(channels, structured(joined, y, sigma), q, sigma, stopped=stopped)


def _unknown_noise(problem: Problem, tell: Tell) -> Solution:
    """Lowers the noise level until the Bayesian information criterion with unknown noise is at its best."""
    channels, factor = no_paths(problem), noise_level(problem)
    size = problem.y.size
    scale = float(np.linalg.norm(problem.y)) / np.sqrt(size)
    sigma = min(scale, 0.9 * largest_level(channels, problem.y) / factor)
    best: tuple[float, Solution | None] = (np.inf, None)
    least = 0.0
    while sigma > max(_NO_NOISE * scale, least):
        solution = _at_noise(problem, channels, sigma, factor * sigma, tell)
        if solution.stopped:
            break
        channels = solution.lifted
        left = float(np.linalg.norm(residual(solution.channels, problem.y)))
        free = size - unknowns(solution.channels) / 2
        if free < size / 4:
            break
        if left < _NO_NOISE * scale * np.sqrt(size):
            return _noiseless(problem, tell)
        criterion = 2 * size * float(np.log(left**2 / size)) + cost(solution.channels, problem.y, 1.0) - 2 * left**2
        if criterion < best[0]:
            best = criterion, solution._replace(sigma=float(left / np.sqrt(free)))
            least = _OVERFIT * left / np.sqrt(free)
        sigma *= _SHRINK
    return best[1] or _at_noise(problem, no_paths(problem), sigma, factor * sigma, tell)


def crowded(channels: Channels, y: Complex) -> bool:
    """Whether there are about as many unknowns as samples: these samples are not sparse."""
    return unknowns(channels) > max(2 * y.size, min(_SMALL, 5 * y.size))


def descend(
    channels: Channels,
    y: Complex,
    level: float,
    rounds: int = 12,
    weak: float = 1e-6,
    most: float = np.inf,
    tell: Tell = lambda points: None,
) -> Channels:
    """Solves the group BLASSO at one regularisation from lifted channels, without atoms below a share of the whole.

    It stops with more than ``most`` atoms, and tells of every round.
    """
    channels = fit(channels, y, 10, level)
    for _ in range(rounds):
        tell(sum(paths(channels)))
        if crowded(channels, y) or sum(paths(channels)) > most:
            break
        dual = residual(channels, y) / level
        inserted = [one.with_peaks(dual, 1 + _TOLERANCE, most=_INSERTIONS) for one in channels]
        if paths(inserted) == paths(channels):
            return fit(channels, y, 10, level)
        channels = _stronger(group_lasso(inserted, y, level), 1e-9)
        channels = [one.merged(0.02) for one in fit(channels, y, 12, level)]
        merged = [one.merged(0.5) for one in channels]
        if paths(merged) != paths(channels):
            merged = fit(merged, y, 15, level)
            after, before = (objective(some, residual(some, y), level) for some in (merged, channels))
            channels = merged if after <= before * (1 + 1e-9) else channels
        channels = _stronger(channels, weak)
    return channels


def _stronger(channels: Channels, share: float) -> Channels:
    limit = share * np.linalg.norm(np.concatenate([one.strengths for one in channels]))
    return [one.taken(one.strengths > limit) for one in channels]


def group_lasso(channels: Channels, y: Complex, level: float, sweeps: int = 60, tolerance: float = 1e-9) -> Channels:
    """Lifted channels with the coefficients that minimise ``½‖y − A w‖² + level Σ weight ‖wᵢ‖``.

    Block coordinate descent; each block is solved through its eigenvalues (a scalar secular equation).
    """
    if not any(paths(channels)):
        return channels
    matrix = np.hstack([one.linear() for one in channels])
    gram = matrix.conj().T @ matrix
    weights = np.concatenate([one.waveform.reshape(-1) for one in channels])
    left = matrix.conj().T @ y.reshape(-1) - gram @ weights
    sizes = [atoms.size for atoms, _, _ in each_atom(channels)]
    blocks = [slice(end - size, end) for end, size in zip(np.cumsum(sizes), sizes, strict=True)]
    penalties = [level * atoms.source.weight for atoms, _, _ in each_atom(channels)]
    systems = [np.linalg.eigh(gram[block, block]) for block in blocks]
    for _ in range(sweeps):
        largest = 0.0
        for block, (values, vectors), penalty in zip(blocks, systems, penalties, strict=True):
            old = weights[block]
            target = left[block] + gram[block, block] @ old
            new = _block(values, vectors, target, penalty, float(np.linalg.norm(old)))
            left -= gram[:, block] @ (new - old)
            largest = max(largest, float(np.linalg.norm(new - old)))
            weights[block] = new
        if largest <= tolerance * float(np.linalg.norm(weights)):
            break
    return with_weights(channels, weights)


def _block(values: Real, vectors: Complex, target: Complex, penalty: float, start: float) -> Complex:
    """The minimiser of ``½wᴴGw − Re wᴴc + penalty ‖w‖`` with ``G`` by its eigenvalues and vectors."""
    size = float(np.linalg.norm(target))
    if size <= penalty:
        return np.zeros_like(target)
    along = vectors.conj().T @ target
    power = np.abs(along) ** 2
    norm = max(start, (size - penalty) / values[-1])
    for _ in range(50):
        scale = values * norm + penalty
        total = float(np.sum(power / scale**2))
        slope = -2 * float(np.sum(power * values / scale**3))
        change = (total**-0.5 - 1) / (-0.5 * total**-1.5 * slope)  # Newton on a nearly straight function
        updated = norm - change if norm > change else norm / 10
        done = abs(updated - norm) < 1e-13 * norm
        norm = updated
        if done:
            break
    return vectors @ (along / (values + penalty / norm))


def exact_fit(channels: Channels, y: Complex, shares: Iterable[float]) -> tuple[float, Channels | None]:
    """The best unregularised fit, clusters joined, of the lifted atoms above some share of the strongest.

    Its relative residual and its atoms; infinite and None where there are too many.
    """
    best: tuple[float, Channels | None] = (np.inf, None)
    seen: set[tuple[int, ...]] = set()
    merged = [one.merged(_CELLS) for one in channels]
    strongest = max(one.strengths.max(initial=0.0) for one in merged)
    for share in shares:
        trial = [one.taken(one.strengths > share * strongest) for one in merged]
        if not any(paths(trial)) or unknowns(trial) >= 2 * y.size or paths(trial) in seen:
            continue
        seen.add(paths(trial))
        trial = _fitted(trial, y)
        best = min(best, (relative_residual(trial, y), trial), key=lambda one: one[0])
        if best[0] < EXACT:
            break
    return best


def _fitted(channels: Channels, y: Complex) -> Channels:
    """Least squares; where they are exact, with as few atoms as that takes."""
    channels = fit(with_fitted_weights(channels, y), y, _STEPS)
    if relative_residual(channels, y) < EXACT:
        merged = [one.merged(1e-2) for one in channels]
        fewer: Channels | None = fit(with_fitted_weights(merged, y), y, _STEPS)
        while fewer is not None:
            channels, fewer = fewer, _one_less(fewer, y) if sum(paths(fewer)) > 1 else None
    return channels


def _one_less(channels: Channels, y: Complex) -> Channels | None:
    """An exact fit without one atom, the weakest if possible."""
    order = sorted(
        (value, index, atom) for index, one in enumerate(channels) for atom, value in enumerate(one.strengths)
    )
    for _, index, atom in order:
        trial = with_fitted_weights([*channels[:index], channels[index].without(atom), *channels[index + 1 :]], y)
        if relative_residual(trial, y) < _MISSED:
            trial = fit(trial, y, _STEPS)
        if relative_residual(trial, y) < EXACT:
            return trial
    return None
