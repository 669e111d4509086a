"""Channels with one waveform for all paths of a source: the model behind the lifted atoms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tmca.dbd.arrays import Complex, Real, Whole
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.problem import Problem
from tmca.dbd.source import AXES


@dataclass
class Channel:
    """One source: where its paths are, their gains, and its waveform.

    Args:
        atoms: with every axis, the Doppler of ``block`` messages too.
        points: ``(n, D)``; Dopplers of ``block`` messages are relative to the strongest path's once normalised.
        amplitudes: ``(n,)``.
        waveform: ``(G J,)`` of norm one, its largest coefficient real and positive.
    """

    atoms: Atoms
    points: Real
    amplitudes: Complex
    waveform: Complex

    def copy(self) -> Channel:
        """Another one that can be changed on its own."""
        return Channel(self.atoms, self.points.copy(), self.amplitudes.copy(), self.waveform.copy())

    def columns(self) -> Complex:
        """``(A P M, n)``: the samples of each path with gain one."""
        return self.atoms.signals(self.points, self.waveform).T

    def signal(self) -> Complex:
        """``(A P M,)``: the samples of all paths."""
        return self.columns() @ self.amplitudes

    @property
    def relative_axis(self) -> int | None:
        """The column of Dopplers that messages absorb, so that they are known relative to each other; or None."""
        if "doppler" in self.atoms.axes and not self.atoms.source.sees_doppler:
            return self.atoms.axes.index("doppler")
        return None

    @property
    def strongest(self) -> int:
        """The path that relative Dopplers count from."""
        return int(np.argmax(np.abs(self.amplitudes)))

    def normalised(self) -> Channel:
        """The same with a waveform of norm one whose largest coefficient is real and positive."""
        points, waveform = self.points.copy(), self.waveform
        if self.relative_axis is not None and len(points):
            start = points[self.strongest, self.relative_axis]
            points[:, self.relative_axis] -= start
            ramp = np.exp(-2j * np.pi * start * np.arange(self.atoms.source.messages))
            waveform = (waveform.reshape(len(ramp), -1) * ramp[:, None]).reshape(-1)
        largest = waveform[np.argmax(np.abs(waveform))]
        factor = np.linalg.norm(waveform) * (largest / abs(largest) if largest else 1)
        return Channel(self.atoms, points % 1.0, self.amplitudes * factor, waveform / factor)

    def full_points(self) -> Real:
        """``(n, 3)``: delay, Doppler, angle; NaN for an axis that does not exist."""
        full = np.full((len(self.points), len(AXES)), np.nan)
        for column, axis in enumerate(self.atoms.axes):
            full[:, AXES.index(axis)] = self.points[:, column]
        return full


def split(problem: Problem, measure: Measure) -> list[Channel]:
    """The rank-one part of every source's lifted weights: gains times waveform."""
    found = []
    for source, points, weights in zip(problem.sources, measure.points, measure.weights, strict=True):
        atoms = Atoms(source, problem.shape, every_axis=True)
        if not len(points):
            found.append(Channel(atoms, np.zeros((0, len(atoms.axes))), np.zeros(0, complex), _first(source.unknowns)))
            continue
        if "doppler" in atoms.axes and not source.sees_doppler:
            points, weights = _with_relative_doppler(points, weights.reshape(len(points), source.messages, -1))
        left, sizes, right = np.linalg.svd(weights, full_matrices=False)
        found.append(Channel(atoms, points, left[:, 0] * sizes[0], right[0]).normalised())
    return found


def _first(size: int) -> Complex:
    return np.eye(1, size, dtype=complex)[0]


def _with_relative_doppler(points: Real, weights: Complex) -> tuple[Real, Complex]:
    """Adds Dopplers relative to the strongest path and takes them out of ``(n, P, J)`` weights.

    The phases of ``block`` messages absorb an absolute Doppler; two paths carry the same messages, so that the
    products of their coefficients turn with the difference of theirs.
    """
    strongest = int(np.argmax(np.linalg.norm(weights, axis=(1, 2))))
    pulses = np.arange(weights.shape[1])
    turning = np.einsum("npj,pj->np", weights, weights[strongest].conj())
    dopplers = np.array([_frequency(one, pulses) for one in turning])
    straight = weights * np.exp(2j * np.pi * dopplers[:, None] * pulses)[..., None]
    return np.insert(points, 1, dopplers, axis=1), straight.reshape(len(points), -1)


def _frequency(turning: Complex, pulses: Whole, oversampling: int = 16) -> float:
    """The frequency at which ``Σ z_p exp(+j2π p x)`` is largest."""
    size = oversampling * len(pulses)
    x = float(np.argmax(np.abs(np.fft.ifft(turning, size)))) / size
    for _ in range(20):
        terms = np.exp(2j * np.pi * pulses * x) * turning
        slope = 2j * np.pi * pulses
        f, f1, f2 = terms.sum(), (slope * terms).sum(), (slope**2 * terms).sum()
        curvature = abs(f1) ** 2 + np.real(np.conj(f) * f2)
        if curvature >= 0:
            break
        step = -float(np.real(np.conj(f) * f1) / curvature)
        x += float(np.clip(step, -0.5 / size, 0.5 / size))
        if abs(step) < 1e-16:
            break
    return x % 1.0
