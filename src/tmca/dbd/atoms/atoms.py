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
        doppler = pulses > 1 and (source.sees_doppler or every_axis)
        seen = (frequencies > 1, doppler, antennas > 1)
        self.axes = tuple(axis for axis, there in zip(AXES, seen, strict=True) if there)
        if not self.axes:
            found = f"{antennas} antenna, {pulses} pulses and {frequencies} frequency, where no coordinate shows"
            expected = "several frequencies, or pulses that share a message"
            raise SettingError(f"samples of {source.name}", found, expected)
        self.lattice_axes = tuple(2 - AXES.index(axis) for axis in self.axes)
        self.counts = np.array([shape[axis] for axis in self.lattice_axes], float)

    @property
    def exponents(self) -> list[Real]:
        """Sample numbers along each axis of a point: n, p, a."""
        numbers = {"delay": np.arange(self.shape[2]) - self.shape[2] // 2}
        numbers |= {"doppler": np.arange(self.shape[1]), "angle": np.arange(self.shape[0])}
        return [numbers[axis].astype(float) for axis in self.axes]

    def ramps(self) -> list[Real]:
        """The exponents as arrays that broadcast over the lattice."""
        shapes = {0: (-1, 1, 1), 1: (1, -1, 1), 2: (1, 1, -1)}
        pairs = zip(self.exponents, self.lattice_axes, strict=True)
        return [numbers.reshape(shapes[axis]) for numbers, axis in pairs]

    def phase(self, point: Real) -> Complex:
        """``exp(−j2π(n τ + p ν + a θ))`` on the lattice ``(A, P, M)``."""
        phase = np.ones((1, 1, 1), complex)
        for ramp, coordinate in zip(self.ramps(), point, strict=True):
            phase = phase * np.exp(-2j * np.pi * coordinate * ramp)
        return np.broadcast_to(phase, self.shape)

    def matrix(self, point: Real) -> Complex:
        """``(A P M, G J)``: the samples of a path at ``point`` for each coefficient of its signal."""
        source, (antennas, pulses, frequencies) = self.source, self.shape
        columns = source.rows * self.phase(point)[..., None]
        if source.messages == 1:
            return columns.reshape(-1, source.subspace)
        full = np.zeros((antennas, pulses, frequencies, source.messages, source.subspace), complex)
        for pulse, message in enumerate(source.message):
            full[:, pulse, :, message] = columns[:, pulse]
        return full.reshape(-1, self.size)

    def signal(self, point: Real, weight: Complex) -> Complex:
        """``(A P M,)``: ``matrix(point) @ weight`` without the matrix."""
        return (self.source.signal(weight) * self.phase(point)).reshape(-1)

    def slopes(self, point: Real, weight: Complex) -> Complex:
        """``(A P M, D)``: derivatives of the signal by the point's coordinates."""
        signal = self.signal(point, weight).reshape(self.shape)
        return np.stack([(-2j * np.pi * ramp * signal).reshape(-1) for ramp in self.ramps()], axis=1)
