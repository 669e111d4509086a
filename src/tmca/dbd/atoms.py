"""Lifted atoms: what one path with unknown coefficients puts on the samples; and the dual: where samples match them."""

from __future__ import annotations

from itertools import product

import numpy as np

from tmca.dbd.model import AXES, Complex, Real, Source, distance
from tmca.errors import SettingError

_NEWTON_STEPS = 14
_SAME_PEAK = 0.1
"""Maxima closer than this share of a resolution cell are one."""


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
        seen = (frequencies > 1, pulses > 1 and (source.sees_doppler or every_axis), antennas > 1)
        self.columns = [axis for axis, there in enumerate(seen) if there]
        """Which of delay, Doppler and angle show."""
        self.axes = tuple(AXES[axis] for axis in self.columns)
        if not self.axes:
            sizes = f"{antennas} antenna, {pulses} pulses and {frequencies} frequency, where no coordinate shows"
            expected = "several frequencies, or pulses that share a message"
            raise SettingError(f"samples of {source.name}", sizes, expected)
        self.lattice_axes = tuple(2 - axis for axis in self.columns)
        self.counts = np.array([shape[axis] for axis in self.lattice_axes], float)
        numbers = (np.arange(frequencies) - frequencies // 2, np.arange(pulses), np.arange(antennas))
        self.exponents = [numbers[axis].astype(float) for axis in self.columns]
        """Sample numbers along each axis of a point: n, p, a."""
        shapes = ((1, 1, -1), (1, -1, 1), (-1, 1, 1))
        self.ramps = [numbers.reshape(shapes[axis]) for numbers, axis in zip(self.exponents, self.columns, strict=True)]
        """The same as arrays that broadcast over the lattice."""

    def seen(self, points: Real) -> Real:
        """The coordinates ``(n, D)`` that these atoms depend on, of ``(n, 3)`` points."""
        return points[:, self.columns]

    def full(self, positions: Real) -> Real:
        """``(n, 3)`` of ``(n, D)`` coordinates: NaN for an axis that does not exist."""
        points = np.full((len(positions), len(AXES)), np.nan)
        points[:, self.columns] = positions
        return points

    def phases(self, points: Real) -> Complex:
        """``exp(−j2π(n τ + p ν + a θ))`` of ``(n, D)`` points on the lattice: ``(n, A, P, M)``."""
        phase = np.ones((len(points), 1, 1, 1), complex)
        for ramp, coordinate in zip(self.ramps, points.T, strict=True):
            phase = phase * np.exp(-2j * np.pi * coordinate[:, None, None, None] * ramp)
        return np.broadcast_to(phase, (len(points), *self.shape))

    def matrix(self, points: Real) -> Complex:
        """``(A P M, G J)``: the samples of a path at a point for each coefficient of its signal; of ``(n, D)`` points
        side by side, ``(A P M, n G J)``.
        """
        blocks = [self.through(phase) for phase in self.phases(np.atleast_2d(points))]
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
        slopes = np.stack([-2j * np.pi * ramp * signals for ramp in self.ramps], axis=1)
        return slopes.reshape(len(points) * len(self.axes), self.samples).T


class Polynomial:
    """``f(x) = Σ q conj(rows) exp(+j2π(n τ + p ν + a θ))`` in C^(G J) (thesis equations 77 and 78, corrected).

    Its level is ``‖f‖`` over its bound, the weight of the source.

    Args:
        atoms: of the source.
        q: ``(A, P, M)``, the dual variable.
    """

    def __init__(self, atoms: Atoms, q: Complex) -> None:
        self.atoms, self.q = atoms, q.reshape(atoms.shape)

    def levels_on_grid(self, oversampling: int = 4) -> Real:
        """The levels on a grid of ``oversampling`` points a resolution cell; dimensions as a point's coordinates."""
        atoms, source = self.atoms, self.atoms.source
        axes = atoms.lattice_axes[::-1]
        sizes = [int(oversampling * count) for count in atoms.counts[::-1]]
        absorbed = tuple(axis for axis in range(3) if axis not in axes)
        apart = source.messages > 1 and 1 in axes  # without a Doppler, pulses are summed in squares anyway
        messages = [source.message == one for one in range(source.messages)] if apart else [source.message >= 0]
        squares = np.zeros(sizes)
        for column, sent in product(range(source.subspace), messages):
            values = np.where(sent[:, None], np.conj(source.rows[:, :, column]) * self.q, 0)
            spectrum = np.fft.ifftn(values, sizes, axes)
            squares += (spectrum.real**2 + spectrum.imag**2).sum(absorbed)
        return np.sqrt(squares.T) * (float(np.prod(sizes)) / source.weight)

    def derivatives(self, points: Real) -> tuple[Real, Real, Real]:
        """``‖f‖²`` at ``(n, D)`` points, its gradient ``(n, D)`` and its Hessian ``(n, D, D)``."""
        moments, dims = self._moments(points), range(len(self.atoms.axes))

        def moment(*by: int) -> Complex:
            return moments[tuple(by.count(dim) for dim in dims)]

        def inner(a: Complex, b: Complex) -> Real:
            return 2 * np.real(np.sum(np.conj(a) * b, axis=(1, 2)))

        f, first = moment(), [moment(i) for i in dims]
        gradient = np.stack([inner(f, one) for one in first], axis=-1)
        second = [inner(f, moment(i, j)) + inner(first[i], first[j]) for i, j in product(dims, dims)]
        return inner(f, f) / 2, gradient, np.stack(second, axis=-1).reshape(len(points), len(dims), len(dims))

    def _moments(self, points: Real) -> dict[tuple[int, ...], Complex]:
        """Derivatives of f by the coordinates up to the second, keyed by order in each; each ``(n, G, J)``."""
        count, atoms = len(points), self.atoms
        powers = {axis: np.ones((count, 1, atoms.shape[axis]), complex) for axis in range(3)}
        for axis, numbers, x in zip(atoms.lattice_axes, atoms.exponents, points.T, strict=True):
            slope = 2j * np.pi * numbers
            wave = np.exp(x[:, None] * slope)
            powers[axis] = np.stack([slope**order * wave for order in range(3)], axis=1)
        weighted = np.conj(atoms.source.rows) * self.q[..., None]
        over_n = np.matmul(powers[2].reshape(-1, atoms.shape[2]), weighted)
        over_n = over_n.reshape(*atoms.shape[:2], count, -1, atoms.source.subspace)
        terms = over_n[:, :, :, :, None] * powers[1].transpose(2, 0, 1)[None, :, :, None, :, None]
        starts = np.flatnonzero(np.diff(atoms.source.message, prepend=-1))
        full = np.einsum("agnors,nta->nortgs", np.add.reduceat(terms, starts, axis=1), powers[0])
        orders = [order for order in np.ndindex(full.shape[1:4]) if sum(order) <= 2]
        return {tuple(one[2 - axis] for axis in atoms.lattice_axes): full[(slice(None), *one)] for one in orders}

    def ascend(self, points: Real) -> tuple[Real, Real]:
        """Maxima of ``‖f‖²`` near ``(n, D)`` points by Newton steps, halved while they lose, and their values."""
        x, limit = np.array(points, float), 0.5 / self.atoms.counts
        value, gradient, hessian = self.derivatives(x)
        active = np.arange(len(x))
        for _ in range(_NEWTON_STEPS):
            waiting, step, moving = active, _newton_step(gradient[active], hessian[active], limit), []
            for _ in range(4):
                v, g, h = self.derivatives(x[waiting] + step)
                good = v >= value[waiting] - 1e-14 * np.abs(value[waiting])
                won = waiting[good]
                x[won] += step[good]
                value[won], gradient[won], hessian[won] = v[good], g[good], h[good]
                moving.append(won[np.abs(step[good]).max(-1) > 1e-12])
                waiting, step = waiting[~good], step[~good] / 2
                if not len(waiting):
                    break
            active = np.sort(np.concatenate(moving))
            if not len(active):
                break
        return x % 1.0, value

    def peaks(self, level: float = 1.0, oversampling: int = 4, most: int = 20) -> tuple[Real, Real]:
        """Local maxima of at least ``level``, the highest first, each once: points ``(n, D)`` and levels."""
        from scipy.ndimage import maximum_filter

        grid = self.levels_on_grid(oversampling)
        high = (grid >= maximum_filter(grid, size=3, mode="wrap")) & (grid**2 >= 0.8 * level**2)
        places = np.argwhere(high)
        places = places[np.argsort(-grid[high])][:most]
        if not len(places):
            return np.zeros((0, len(self.atoms.axes))), np.zeros(0)
        points, squares = self.ascend(places / np.array(grid.shape))
        levels = np.sqrt(squares) / self.atoms.source.weight
        chosen: list[int] = []
        for one in map(int, np.argsort(-levels)):
            apart = np.max(distance(points[one], points[chosen]) * self.atoms.counts, axis=-1)
            if levels[one] >= level and np.all(apart >= _SAME_PEAK):
                chosen.append(one)
        return points[chosen], levels[chosen]


def _newton_step(gradient: Real, hessian: Real, limit: Real) -> Real:
    """Uphill step with the absolute curvatures, shortened to ``limit`` in every coordinate."""
    curvature, directions = np.linalg.eigh(hessian)
    size = np.abs(curvature)
    size = np.maximum(size, 1e-9 * size.max(-1, keepdims=True) + 1e-300)
    along = np.einsum("nij,ni->nj", directions, gradient) / size
    step = np.einsum("nij,nj->ni", directions, along)
    shorten = np.min(limit / (np.abs(step) + 1e-300), axis=-1, keepdims=True)
    return step * np.minimum(1, shorten)


def relative_dopplers(weights: Complex) -> Real:
    """Dopplers relative to the strongest path, of ``(n, P, J)`` coefficients.

    The phases of ``block`` messages absorb an absolute Doppler; two paths carry the same messages, so that the
    products of their coefficients turn with the difference of theirs.
    """
    pulses = weights.shape[1]
    strongest = int(np.argmax(np.linalg.norm(weights, axis=(1, 2))))
    turning = np.einsum("npj,pj->np", weights, weights[strongest].conj())
    tone = Atoms(Source("tone", np.ones((pulses, 1, 1), complex), np.zeros(pulses, np.int64)), (1, pulses, 1))
    return np.array([Polynomial(tone, one).peaks(0.0, oversampling=16, most=1)[0][0, 0] for one in turning])
