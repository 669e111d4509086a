"""What noise does: the regularisation that keeps it out, how many paths it hides, and how exactly they can be known.

The number of paths is that of the Bayesian information criterion: the drop of the squared residual over the noise
against the parameters of one path, position and complex amplitude.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import Channel, Channels, fit, no_paths, normal_equations, paths, residual
from tmca.dbd.model import Complex, Problem, Real, Whole, distance
from tmca.errors import SettingError

_QUANTILE = 0.95
_DRAWS = 30
_ROUNDS = 30
_STEPS = 8
"""Of a fit that only has to say whether a path pays."""
_TRIED = 4
"""Doubtful paths that are taken out on trial in a round."""
_NEAR = 1.2
"""Resolution cells within which two atoms may be one."""


def noise_level(problem: Problem, seed: int = 0) -> float:
    """The 95 % quantile of the highest ``‖f‖ / weight`` that complex noise of standard deviation one reaches.

    Times the noise's standard deviation it is the regularisation above which noise alone gives an atom in one of
    twenty draws.
    """
    rng, channels = np.random.default_rng(seed), no_paths(problem)
    highest = []
    for _ in range(_DRAWS):
        noise = (rng.standard_normal(problem.shape) + 1j * rng.standard_normal(problem.shape)) / np.sqrt(2)
        highest.append(largest_level(channels, noise))
    return float(np.quantile(highest, _QUANTILE))


def largest_level(channels: Sequence[Channel], y: Complex) -> float:
    """The regularisation above which no atoms are optimal: the highest ``‖f‖ / weight`` of the samples."""
    return max(float(Polynomial(one.atoms, y).levels_on_grid().max()) for one in channels)


def price(atoms: Atoms) -> float:
    """What one more path has to gain: its real parameters times the logarithm of the real samples, and its choice.

    The best of as many resolution cells as there are samples fits noise by twice the logarithm of their number.
    """
    samples = float(np.prod(atoms.shape))
    return (len(atoms.axes) + 2) * float(np.log(2 * samples)) + 2 * float(np.log(samples))


def cost(channels: Sequence[Channel], y: Complex, sigma: float) -> float:
    """Twice the negative log-likelihood, less a constant, with the price of every path and every waveform."""
    squares, logarithm = 2 * float(np.linalg.norm(residual(channels, y)) ** 2) / sigma**2, float(np.log(2 * y.size))
    waveforms = sum(2 * (one.waveform.size - 1) * logarithm for one in channels if len(one))
    return squares + sum(len(one) * price(one.atoms) for one in channels) + waveforms


def structured(lifted: Sequence[Channel], y: Complex, sigma: float) -> Channels:
    """Lifted channels with one waveform a source; in noise, with the number of paths that costs least."""
    channels = [one.structured() for one in lifted]
    if not any(paths(channels)):
        return channels
    return selected(channels, y, sigma) if sigma else fit(channels, y)


def selected(channels: Channels, y: Complex, sigma: float) -> Channels:
    """The channels with the number of paths that costs least, from a fit with too many or too few."""
    channels = fit(channels, y)
    best = cost(channels, y, sigma)
    for _ in range(_ROUNDS):
        trial = _one_less(channels, y, sigma, best) or _one_more(channels, y, sigma, best)
        if trial is None:
            break
        channels, best = trial, cost(trial, y, sigma)
    return fit(channels, y)


def _one_less(channels: Channels, y: Complex, sigma: float, best: float) -> Channels | None:
    """The channels without the path that is missed least, if they cost less."""
    columns = np.hstack([one.columns() for one in channels])
    variances = iter(np.real(np.diag(np.linalg.pinv(columns.conj().T @ columns))))
    doubtful = []  # paths that may be noise or doubles, by their significance with all else fixed
    for index, one in enumerate(channels):
        for path, gain in enumerate(one.amplitudes):
            gained = 2 * abs(gain) ** 2 / (next(variances) * sigma**2)
            apart = np.max(distance(one.positions, one.positions[path]) * one.atoms.counts, axis=1)
            if gained < 6 * price(one.atoms) or np.sum(apart < _NEAR) > 1:
                doubtful.append((float(gained), index, path))
    less = ((index, channels[index].without(path)) for _, index, path in sorted(doubtful)[:_TRIED])
    return _cheaper(channels, less, y, sigma, best)


def _one_more(channels: Channels, y: Complex, sigma: float, best: float) -> Channels | None:
    """The channels with a path more where the residual matches a source best, if they cost less."""
    left = residual(channels, y)
    more = ((index, _extended(one, left)) for index, one in enumerate(channels))
    return _cheaper(channels, more, y, sigma, best)


def _cheaper(
    channels: Channels, changes: Iterable[tuple[int, Channel]], y: Complex, sigma: float, best: float
) -> Channels | None:
    """A short fit with the first of the channels replaced that makes it cost less."""
    for index, channel in changes:
        trial = fit([*channels[:index], channel, *channels[index + 1 :]], y, _STEPS)
        if cost(trial, y, sigma) < best:
            return trial
    return None


def _extended(channel: Channel, left: Complex) -> Channel:
    """The channel with one more path, where a matched filter says; before the first, the waveform is unknown too."""
    source = channel.atoms.source
    matched = Atoms(source.with_signal(channel.waveform) if len(channel) else source, channel.atoms.shape)
    point = Polynomial(matched, left).peaks(0.0, most=1)[0][:1]
    if not len(channel):
        weight = np.linalg.lstsq(matched.matrix(point[0]), left, rcond=None)[0]
        position = np.nan_to_num(channel.atoms.seen(matched.full(point)))
        return Channel(channel.atoms, position, np.ones(1, complex), weight).normalised()
    column = channel.atoms.signals(point, channel.waveform)[0]
    gain = np.vdot(column, left) / np.vdot(column, column)
    positions = np.vstack([channel.positions, point])
    return Channel(channel.atoms, positions, np.append(channel.amplitudes, gain), channel.waveform)


def bounds(channels: Sequence[Channel], sigma: float, references: Sequence[int | None] | None = None) -> list[Real]:
    """Cramér–Rao bounds of the positions: standard deviations ``(n, D)`` per source; see :func:`covariances`."""
    return [np.sqrt(np.diagonal(one, axis1=1, axis2=2)) for one in covariances(channels, sigma, references)]


def covariances(
    channels: Sequence[Channel], sigma: float, references: Sequence[int | None] | None = None
) -> list[Real]:
    """Cramér–Rao bounds of the covariances of the coordinates of each path: ``(n, D, D)`` per source.

    Gains and waveforms are nuisance, up to their common factor. Dopplers of ``block`` messages are bounded relative to
    one path's, whose own is zero. Coordinates that no samples of this kind can tell have no bound: infinite variances.

    Args:
        channels: structured; the truth, or an estimate in its place.
        sigma: standard deviation of the complex noise.
        references: per source, the path that relative Dopplers count from; by default the strongest.
    """
    curvature, _ = normal_equations(channels, np.zeros(channels[0].atoms.samples, complex))
    sizes = np.sqrt(np.diag(curvature))
    sizes[sizes == 0] = 1  # no rank depends on anybody's units
    fisher = 2 / sigma**2 * curvature / np.outer(sizes, sizes)
    ends = np.cumsum([one.positions.size for one in channels])
    starts = ends - [one.positions.size for one in channels]
    nuisance = np.arange(len(fisher) - ends[-1])
    free = np.setdiff1d(np.arange(ends[-1]), _counted_from(channels, references, starts))
    columns = len(nuisance) + free
    cross = fisher[np.ix_(columns, nuisance)]
    within = np.linalg.pinv(fisher[np.ix_(nuisance, nuisance)], rcond=1e-9)
    inverse = _inverse(fisher[np.ix_(columns, columns)] - cross @ within @ cross.T, 1e-11 * 2 / sigma**2)
    every = np.zeros((ends[-1], ends[-1]))
    every[np.ix_(free, free)] = inverse / np.outer(sizes[columns], sizes[columns])
    return [_of_paths(every, start, *one.positions.shape) for one, start in zip(channels, starts, strict=True)]


def _counted_from(channels: Sequence[Channel], references: Sequence[int | None] | None, starts: Whole) -> list[int]:
    """The columns of the Dopplers that others of their sources count from."""
    columns = []
    for one, path, start in zip(channels, references or [None] * len(channels), starts, strict=True):
        if one.relative_axis is not None and len(one):
            reference = one.strongest if path is None else path
            columns.append(start + one.relative_axis + reference * one.positions.shape[1])
    return columns


def _inverse(information: Real, least: float) -> Real:
    """The inverse in directions of more than the least information; infinite variances of others."""
    values, vectors = np.linalg.eigh(information)
    certain = values > least
    inverse = vectors[:, certain] / values[certain] @ vectors[:, certain].T
    unseen = np.flatnonzero((vectors[:, ~certain] ** 2).sum(axis=1) > 1e-8)  # a direction that no sample tells
    inverse[unseen, unseen] = np.inf
    return inverse


def _of_paths(covariance: Real, start: int, count: int, axes: int) -> Real:
    """``(count, axes, axes)``, the blocks on the diagonal from a place on."""
    places = start + np.arange(count * axes).reshape(count, axes)
    return covariance[places[:, :, None], places[:, None, :]]


def true_bounds(problem: Problem, references: Sequence[int | None] | None = None) -> list[Real]:
    """Cramér–Rao bounds of a simulated problem, at its true parameters; see :func:`bounds`.

    Raises:
        SettingError: a problem without truth or without noise.
    """
    if problem.truth is None or not problem.sigma:
        raise SettingError("problem", "no truth or no noise", "a simulated problem with snr_db")
    pairs = zip(problem.sources, problem.truth, strict=True)
    return bounds([Channel.true(*both, problem.shape) for both in pairs], problem.sigma, references)
