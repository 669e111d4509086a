"""How many paths there are: atoms that the noise explains as well are taken out, ones that it does not are put in.

The gain of one path is judged by the drop of the squared residual over the noise, against the Bayesian information
criterion of its parameters: position and complex amplitude.
"""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.atoms.polynomial import Polynomial
from tmca.dbd.estimates.channels import Channel
from tmca.dbd.estimates.structured import fit, residual
from tmca.dbd.source import Source
from tmca.dbd.torus import distance

_ROUNDS = 30
_STEPS = 8
"""Of a fit that only has to say whether a path pays."""
_TRIED = 4
"""Doubtful paths that are taken out on trial in a round."""
_NEAR = 1.2
"""Resolution cells within which two atoms may be one."""


def price(atoms: Atoms) -> float:
    """What one more path has to gain: its real parameters times the logarithm of the real samples, and its choice.

    The best of as many resolution cells as there are samples fits noise by twice the logarithm of their number.
    """
    samples = float(np.prod(atoms.shape))
    return (len(atoms.axes) + 2) * float(np.log(2 * samples)) + 2 * float(np.log(samples))


def cost(channels: list[Channel], y: Complex, sigma: float) -> float:
    """Twice the negative log-likelihood, less a constant, with the price of every path and every waveform."""
    fit_ = 2 * float(np.linalg.norm(residual(channels, y)) ** 2) / sigma**2
    logarithm = float(np.log(2 * y.size))
    return fit_ + sum(
        len(one.points) * price(one.atoms) + bool(len(one.points)) * 2 * (one.waveform.size - 1) * logarithm
        for one in channels
    )


def selected(channels: list[Channel], y: Complex, sigma: float) -> list[Channel]:
    """The channels with the number of paths that costs least, from a fit with too many or too few."""
    channels = fit(channels, y)
    best = cost(channels, y, sigma)
    for _ in range(_ROUNDS):
        trial = _one_less(channels, y, sigma, best) or _one_more(channels, y, sigma, best)
        if trial is None:
            break
        channels, best = trial, cost(trial, y, sigma)
    return fit(channels, y)


def _one_less(channels: list[Channel], y: Complex, sigma: float, best: float) -> list[Channel] | None:
    """The channels without the path that is missed least, if they cost less."""
    for _, index, path in sorted(_doubtful(channels, sigma))[:_TRIED]:
        trial = [one.copy() for one in channels]
        one = trial[index]
        one.points = np.delete(one.points, path, axis=0)
        one.amplitudes = np.delete(one.amplitudes, path)
        trial = fit(trial, y, _STEPS)
        if cost(trial, y, sigma) < best:
            return trial
    return None


def _doubtful(channels: list[Channel], sigma: float) -> list[tuple[float, int, int]]:
    """Paths that may be noise or doubles: their significance with all else fixed, source and number."""
    columns = np.hstack([one.columns() for one in channels])
    spread = np.real(np.diag(np.linalg.pinv(columns.conj().T @ columns)))
    found, start = [], 0
    for index, one in enumerate(channels):
        for path, gain in enumerate(one.amplitudes):
            gained = 2 * abs(gain) ** 2 / (spread[start + path] * sigma**2)
            apart = np.max(distance(one.points, one.points[path]) * one.atoms.counts, axis=1)
            if gained < 6 * price(one.atoms) or np.sum(apart < _NEAR) > 1:
                found.append((float(gained), index, path))
        start += len(one.amplitudes)
    return found


def _one_more(channels: list[Channel], y: Complex, sigma: float, best: float) -> list[Channel] | None:
    """The channels with a path more where the residual matches a source best, if they cost less."""
    left = residual(channels, y)
    for index, one in enumerate(channels):
        trial = [other.copy() for other in channels]
        trial[index] = _another(one, left) if len(one.points) else _first(one, left)
        trial = fit(trial, y, _STEPS)
        if cost(trial, y, sigma) < best:
            return trial
    return None


def _another(channel: Channel, left: Complex) -> Channel:
    """The channel with one more path of its waveform."""
    points, _ = Polynomial(_matched_filter(channel), left).peaks(0.0, most=1)
    column = channel.atoms.signals(points[:1], channel.waveform)[0]
    gain = np.vdot(column, left) / np.vdot(column, column)
    stacked = np.vstack([channel.points, points[:1]])
    return Channel(channel.atoms, stacked, np.append(channel.amplitudes, gain), channel.waveform)


def _first(channel: Channel, left: Complex) -> Channel:
    """The first path of a source whose waveform is not known yet either."""
    lifted = Atoms(channel.atoms.source, channel.atoms.shape)
    points, _ = Polynomial(lifted, left).peaks(0.0, most=1)
    weight = np.linalg.lstsq(lifted.matrix(points[0]), left, rcond=None)[0]
    point = np.zeros(len(channel.atoms.axes))
    point[[channel.atoms.axes.index(axis) for axis in lifted.axes]] = points[0]
    return Channel(channel.atoms, point[None], np.ones(1, complex), weight).normalised()


def _matched_filter(channel: Channel) -> Atoms:
    """Atoms of a source whose signal is the channel's waveform."""
    source = channel.atoms.source
    known = Source(source.name, source.signal(channel.waveform)[..., None], np.zeros(len(source.message), np.int64))
    return Atoms(known, channel.atoms.shape)
