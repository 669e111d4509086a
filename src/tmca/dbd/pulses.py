"""Whether another pulse explains the samples better than the basis that was given.

A wrong pulse shows as a comb: every target becomes several, at one velocity and at the same distances from each other
wherever there is one. One unknown pulse with a target for each velocity explains such samples with fewer unknowns.
Targets that do stand in several ranges at each velocity seldom have the same distances. Where the bandwidth is a few
per cent off, there are too few false targets for that to pay: the given pulse at another chirp rate has one unknown.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tmca.dbd.atoms import Atoms
from tmca.dbd.channel import Channel, Channels, fit, relative_residual
from tmca.dbd.model import Complex, Problem, Real, Source, Whole, centred
from tmca.dbd.noise import selected

_SAME_DOPPLER = 0.35
"""Resolution cells; Dopplers without a larger gap between them are one."""
_TURN, _FINE = 0.2, 8
"""Radians between the changes of chirp rate that are tried; samples in time for each frequency."""
_TURNS = [_TURN * step for step in range(-6, 7) if step]
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
    spectra = _spectra(channels[index], groups_of_dopplers(channels[index].points, problem.shape[1]))
    pulse = spectra[np.argmax(np.linalg.norm(spectra, axis=1))]
    everything = _one_each(problem, channels, index, spectra, np.eye(len(pulse), dtype=complex), pulse)
    if problem.y.size > _LARGE:
        return fit(everything, problem.y)
    level = problem.sigma or relative_residual(channels, problem.y) * float(np.sqrt(np.mean(np.abs(problem.y) ** 2)))
    return selected(everything, problem.y, level)


def with_near_pulse(problem: Problem, channels: Sequence[Channel], index: int) -> Channels:
    """The channels fitted with the known pulse of one source at the chirp rate that fits best, a path each velocity."""
    pulse = channels[index].signal[0]
    spectra = _spectra(channels[index], groups_of_dopplers(channels[index].points, problem.shape[1]))

    def fitted(turn: float) -> Channels:
        changed, one = _chirped(pulse, turn), np.ones(1, complex)
        return fit(_one_each(problem, channels, index, spectra, changed[:, None], one), problem.y)

    def left(turn: float) -> float:
        return relative_residual(fitted(turn), problem.y)

    best = min(_TURNS, key=left)
    return fitted(min((best - _TURN / 2, best, best + _TURN / 2), key=left))


def _chirped(pulse: Complex, turn: float) -> Complex:
    """A spectrum ``(M,)`` with another chirp rate: a phase that grows with time squared, to ``turn`` at its ends."""
    numbers = np.arange(len(pulse)) - len(pulse) // 2
    times = np.arange(_FINE * len(pulse)) / (_FINE * len(pulse))
    waves = np.exp(2j * np.pi * np.outer(numbers, times))
    signal = pulse @ waves
    power = np.abs(signal) ** 2 / np.sum(np.abs(signal) ** 2)
    away = centred(times - np.angle(power @ np.exp(2j * np.pi * times)) / (2 * np.pi))
    ends = 3 * float(power @ away**2)  # squared, of a pulse that is as strong all the time
    return waves.conj() @ (signal * np.exp(1j * turn * away**2 / ends)) / len(times)


def _one_each(
    problem: Problem, channels: Sequence[Channel], index: int, spectra: Complex, rows: Complex, waveform: Complex
) -> Channels:
    """The channels with another basis ``(M, J)`` and waveform of one source, whose paths are one for each velocity."""
    channel = channels[index]
    groups = groups_of_dopplers(channel.points, problem.shape[1])
    source = Source(channel.name, rows, np.zeros(problem.shape[1], np.int64))
    atoms = Atoms(source, problem.shape, every_axis=True)
    delays, gains = _shifts(spectra, rows @ waveform)
    strongest = [max(np.flatnonzero(groups == one), key=lambda path: abs(channel.amplitudes[path])) for one in
                 range(len(spectra))]  # fmt: skip
    points = channel.points[strongest]
    points[:, 0] = delays
    other = Channel(atoms, np.nan_to_num(atoms.seen(points)), gains, waveform).normalised()
    return [*channels[:index], other, *channels[index + 1 :]]


def _spectra(channel: Channel, groups: Whole) -> Complex:
    """``(velocities, M)``, what comes back at each velocity, in the first pulse."""
    sent = channel.signal[0]
    numbers = np.arange(len(sent)) - len(sent) // 2
    ramps = channel.amplitudes[:, None] * np.exp(-2j * np.pi * np.outer(channel.points[:, 0], numbers))
    return np.stack([sent * ramps[groups == one].sum(axis=0) for one in range(groups.max() + 1)])


def _shifts(spectra: Complex, pulse: Complex) -> tuple[Real, Complex]:
    """Delays and gains with which a pulse is most like each of ``(count, M)`` spectra."""
    numbers = np.arange(len(pulse)) - len(pulse) // 2
    delays = np.arange(_GRID * len(pulse)) / (_GRID * len(pulse))
    matched = (spectra * pulse.conj()) @ np.exp(2j * np.pi * np.outer(numbers, delays))
    best = np.argmax(np.abs(matched), axis=1)
    return delays[best], matched[np.arange(len(spectra)), best] / np.linalg.norm(pulse) ** 2
