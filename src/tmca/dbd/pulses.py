"""Whether another pulse explains the samples better than the basis that was given.

A wrong pulse shows as a comb: every target becomes several, at one velocity and at the same distances from each other
wherever there is one. One unknown pulse with a target for each velocity explains such samples with fewer unknowns.
Targets that do stand in several ranges at each velocity seldom have the same distances.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tmca.dbd.atoms import Atoms
from tmca.dbd.channel import Channel, Channels, fit, relative_residual
from tmca.dbd.model import Complex, Problem, Real, Source, Whole
from tmca.dbd.noise import selected

_SAME_DOPPLER = 0.35
"""Resolution cells; Dopplers without a larger gap between them are one."""
_GRID, _LARGE = 16, 2000
"""Delays tried in a resolution cell; samples from which no further paths are tried."""


def groups_of_dopplers(points: Real, pulses: int) -> Whole:
    """For each of ``(n, 3)`` points the number of the velocity it has, from 0."""
    dopplers = points[:, 1] % 1.0
    order = np.argsort(dopplers)
    gaps = np.diff(dopplers[order], append=dopplers[order[:1]] + 1) > _SAME_DOPPLER / pulses
    if not gaps.any():
        return np.zeros(len(points), np.int64)
    start = np.concatenate([[0], np.cumsum(gaps)[:-1]])
    groups = np.empty(len(points), np.int64)
    groups[order] = start % int(gaps.sum())
    return groups


def has_one_pulse(channel: Channel) -> bool:
    """Whether a source sends the same in all pulses, in fewer dimensions than there are frequencies."""
    source = channel.atoms.source
    same = source.messages == 1 and np.allclose(source.rows, source.rows[:1])
    return bool(same and source.subspace < source.rows.shape[1] and channel.atoms.shape[1] > 1)


def with_other_pulse(problem: Problem, channels: Sequence[Channel], index: int) -> Channels:
    """The channels fitted with a pulse of any spectrum for one source, and as many of its paths as pay.

    They start from one path for each of its velocities.
    """
    channel = channels[index]
    groups = groups_of_dopplers(channel.points, problem.shape[1])
    count = int(groups.max()) + 1
    spectra = _spectra(channel, groups, count)
    pulse = spectra[np.argmax(np.linalg.norm(spectra, axis=1))]
    frequencies = len(pulse)
    source = Source(channel.name, np.eye(frequencies, dtype=complex), np.zeros(problem.shape[1], np.int64))
    atoms = Atoms(source, problem.shape, every_axis=True)
    delays, gains = _shifts(spectra, pulse)
    strongest = [max(np.flatnonzero(groups == one), key=lambda path: abs(channel.amplitudes[path])) for one in
                 range(count)]  # fmt: skip
    points = channel.points[strongest]
    points[:, 0] = delays
    other = Channel(atoms, np.nan_to_num(atoms.seen(points)), gains, pulse).normalised()
    everything = [*channels[:index], other, *channels[index + 1 :]]
    if problem.y.size > _LARGE:
        return fit(everything, problem.y)
    level = problem.sigma or relative_residual(channels, problem.y) * float(np.sqrt(np.mean(np.abs(problem.y) ** 2)))
    return selected(everything, problem.y, level)


def _spectra(channel: Channel, groups: Whole, count: int) -> Complex:
    """``(count, M)``, what comes back at each velocity, in the first pulse."""
    sent = channel.signal[0]
    numbers = np.arange(len(sent)) - len(sent) // 2
    ramps = channel.amplitudes[:, None] * np.exp(-2j * np.pi * np.outer(channel.points[:, 0], numbers))
    return np.stack([sent * ramps[groups == one].sum(axis=0) for one in range(count)])


def _shifts(spectra: Complex, pulse: Complex) -> tuple[Real, Complex]:
    """Delays and gains with which a pulse is most like each of ``(count, M)`` spectra."""
    numbers = np.arange(len(pulse)) - len(pulse) // 2
    delays = np.arange(_GRID * len(pulse)) / (_GRID * len(pulse))
    matched = (spectra * pulse.conj()) @ np.exp(2j * np.pi * np.outer(numbers, delays))
    best = np.argmax(np.abs(matched), axis=1)
    return delays[best], matched[np.arange(len(spectra)), best] / np.linalg.norm(pulse) ** 2
