"""Lifted atoms: what one path with unknown signal coefficients puts on the samples, and how it moves."""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.source import AXES, Source
from tmca.errors import SettingError


class Atoms:
    """The atoms of one source on a lattice of samples; a point is ``(delay, doppler, angle)``, less what is not seen.

    Args:
        source: the transmitter.
        shape: antennas, pulses, frequencies.
        every_axis: keep the Doppler axis even where messages absorb it, for models with one waveform for all paths.

    Raises:
        SettingError: a lattice on which no coordinate shows.
    """

    def __init__(self, source: Source, shape: tuple[int, int, int], every_axis: bool = False) -> None:
        antennas, pulses, frequencies = shape
        self.source, self.shape, self.size = source, shape, source.unknowns
        self.samples = antennas * pulses * frequencies
        doppler = pulses > 1 and (source.sees_doppler or every_axis)
        seen = (frequencies > 1, doppler, antennas > 1)
        self.axes = tuple(axis for axis, there in zip(AXES, seen, strict=True) if there)
        if not self.axes:
            found = f"{antennas} antenna, {pulses} pulses and {frequencies} frequency, where no coordinate shows"
            expected = "several frequencies, or pulses that share a message"
            raise SettingError(f"samples of {source.name}", found, expected)
        self.lattice_axes = tuple(2 - AXES.index(axis) for axis in self.axes)
        self.counts = np.array([shape[axis] for axis in self.lattice_axes], float)

        numbers = {"delay": np.arange(frequencies) - frequencies // 2}
        numbers |= {"doppler": np.arange(pulses), "angle": np.arange(antennas)}
        self.exponents = [numbers[axis].astype(float) for axis in self.axes]
        """Sample numbers along each axis of a point: n, p, a."""

    def phases(self, points: Real) -> Complex:
        """``exp(−j2π(n τ + p ν + a θ))`` of ``(n, D)`` points on the lattice: ``(n, A, P, M)``."""
        phase = np.ones((len(points), 1, 1, 1), complex)
        for ramp, coordinate in zip(self._ramps(), points.T, strict=True):
            phase = phase * np.exp(-2j * np.pi * coordinate[:, None, None, None] * ramp)
        return np.broadcast_to(phase, (len(points), *self.shape))

    def _ramps(self) -> list[Real]:
        """The exponents as arrays that broadcast over the lattice."""
        shapes = {0: (-1, 1, 1), 1: (1, -1, 1), 2: (1, 1, -1)}
        pairs = zip(self.exponents, self.lattice_axes, strict=True)
        return [numbers.reshape(shapes[axis]) for numbers, axis in pairs]

    def matrix(self, points: Real) -> Complex:
        """``(A P M, G J)``: the samples of a path at a point for each coefficient of its signal; of ``(n, D)`` points
        side by side, ``(A P M, n G J)``.
        """
        phases = self.phases(np.atleast_2d(points))
        blocks = [self.through(phase) for phase in phases]
        return np.hstack(blocks) if blocks else np.zeros((self.samples, 0), complex)

    def through(self, response: Complex) -> Complex:
        """``(A P M, G J)``: samples for each coefficient of the signal through a channel ``(A, P, M)``."""
        source, (antennas, pulses, frequencies) = self.source, self.shape
        columns = source.rows * response[..., None]
        if source.messages == 1:
            return columns.reshape(-1, source.subspace)
        full = np.zeros((antennas, pulses, frequencies, source.messages, source.subspace), complex)
        full[:, np.arange(pulses), :, source.message] = columns.swapaxes(0, 1)
        return full.reshape(-1, self.size)

    def signals(self, points: Real, weights: Complex) -> Complex:
        """``(n, A P M)``: the samples of ``(n, D)`` points with coefficients ``(n, G J)`` or ``(G J,)`` each."""
        sent = self.source.signal(weights)
        sent = sent[None, None] if weights.ndim == 1 else sent[:, None]
        return (sent * self.phases(points)).reshape(len(points), self.samples)

    def slopes(self, points: Real, weights: Complex) -> Complex:
        """``(A P M, n D)``: derivatives of the signals by the coordinates, point by point."""
        signals = self.signals(points, weights).reshape(len(points), *self.shape)
        found = np.stack([-2j * np.pi * ramp * signals for ramp in self._ramps()], axis=1)
        return found.reshape(len(points) * len(self.axes), self.samples).T
