"""The estimate of a source's channel and signal, from lifted weights to one waveform, and its least squares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial, relative_dopplers
from tmca.dbd.model import Complex, Mask, Problem, Real, Source, Truth, Whole, distance

_TRIALS = 8
_SAME_PLACE = 0.02
"""Resolution cells within which a point is there already."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One source: where its paths are, their gains, and its waveform; in one of three states.

    *lifted*: every path has a waveform of its own and a gain of one, as the convex problem has it;
    *structured*: one waveform for all paths; *bounded*: with Cramér–Rao bounds of the points.

    Args:
        atoms: of the source; structured ones have every axis, the Doppler of ``block`` messages too.
        positions: ``(n, D)``, the coordinates that the atoms see, in [0, 1).
        amplitudes: ``(n,)``, complex gains, up to one factor.
        waveform: ``(G J,)``, coefficients of the signal, once normalised of norm one with the largest real and
            positive; ``(n, G J)`` while lifted.
        bounds: ``(n, 3)``, standard deviations of the points in the estimated noise; None without noise.
    """

    atoms: Atoms = field(repr=False)
    positions: Real
    amplitudes: Complex = field(repr=False)
    waveform: Complex = field(repr=False)
    bounds: Real | None = field(default=None, repr=False)

    @classmethod
    def from_weights(cls, atoms: Atoms, positions: Real, weights: Complex) -> Channel:
        """A lifted one with ``(n, G J)`` coefficients."""
        return cls(atoms, positions, np.ones(len(positions), complex), weights)

    @classmethod
    def true(cls, source: Source, truth: Truth, shape: tuple[int, int, int]) -> Channel:
        """The structured one of a source whose channel and signal are known."""
        atoms = Atoms(source, shape, every_axis=True)
        return cls(atoms, atoms.seen(truth.points), truth.amplitudes, truth.waveform)

    @property
    def name(self) -> str:
        """Of the source."""
        return self.atoms.source.name

    @property
    def points(self) -> Real:
        """``(n, 3)``, normalised delay, Doppler and angle; NaN for an axis that does not exist."""
        return self.atoms.full(self.positions)

    @property
    def signal(self) -> Complex:
        """``(P, M)``, the spectrum that the waveform makes; ``(n, P, M)`` while lifted."""
        return self.atoms.source.signal(self.waveform)

    @property
    def lifted(self) -> bool:
        """Whether every path has a waveform of its own."""
        return self.waveform.ndim == 2

    @property
    def weights(self) -> Complex:
        """``(n, G J)``, the lifted coefficients: gains times waveforms."""
        return self.waveform if self.lifted else self.amplitudes[:, None] * self.waveform

    @property
    def relative_axis(self) -> int | None:
        """The column of Dopplers that messages absorb, so that they count from the strongest path's; or None."""
        absorbed = "doppler" in self.atoms.axes and not self.atoms.source.sees_doppler
        return self.atoms.axes.index("doppler") if absorbed else None

    @property
    def relative_doppler(self) -> bool:
        """Whether Dopplers count from the strongest path."""
        return self.relative_axis is not None

    @property
    def strongest(self) -> int:
        """The path that relative Dopplers count from."""
        return int(np.argmax(np.abs(self.amplitudes)))

    @property
    def strengths(self) -> Real:
        """``(n,)``, weighted norms: the shares of the sum of atomic norms, whatever the basis' scale."""
        return self.atoms.source.weight * np.linalg.norm(self.weights, axis=1)

    @property
    def unknowns(self) -> int:
        """Real unknowns; one complex factor between the gains and the waveform counts for none."""
        coefficients = self.waveform.size if self.lifted else len(self) + self.waveform.size - 1
        return self.positions.size + 2 * coefficients if len(self) else 0

    def __len__(self) -> int:
        return len(self.positions)

    def samples(self) -> Complex:
        """``(A P M,)``: what all paths put on the samples."""
        return self.atoms.signals(self.positions, self.weights).sum(axis=0)

    def columns(self) -> Complex:
        """``(A P M, n)``: the samples of each path with gain one."""
        return self.atoms.signals(self.positions, self.waveform).T

    def linear(self) -> Complex:
        """``(A P M, K)``: how the samples change with the coefficients, or with gains and then waveform."""
        if self.lifted:
            return self.atoms.matrix(self.positions)
        response = np.tensordot(self.amplitudes, self.atoms.phases(self.positions), axes=1)
        return np.hstack([self.columns(), self.atoms.through(response)])

    def slopes(self) -> Complex:
        """``(A P M, n D)``: how the samples change with the positions."""
        return self.atoms.slopes(self.positions, self.weights)

    def moved(self, shift: Real, change: Complex) -> Channel:
        """With positions changed by ``(n D,)`` and the numbers of :meth:`linear` by ``(K,)``."""
        positions = (self.positions + shift.reshape(self.positions.shape)) % 1.0
        gains, waveform = np.split(change, [0 if self.lifted else len(self)])
        amplitudes = self.amplitudes if self.lifted else self.amplitudes + gains
        return Channel(self.atoms, positions, amplitudes, self.waveform + waveform.reshape(self.waveform.shape))

    def taken(self, paths: Mask | Whole) -> Channel:
        """Of some of its paths only."""
        waveform = self.waveform[paths] if self.lifted else self.waveform
        return Channel(self.atoms, self.positions[paths], self.amplitudes[paths], waveform)

    def without(self, path: int) -> Channel:
        """Less one path."""
        return self.taken(np.arange(len(self)) != path)

    def added(self, positions: Real) -> Channel:
        """A lifted one with atoms of weight zero at the positions that it has none at yet."""
        new = [x for x in positions if np.all(self._cells(self.positions, x) > _SAME_PLACE)]
        if not new:
            return self
        weights = np.vstack([self.waveform, np.zeros((len(new), self.atoms.size))])
        return Channel.from_weights(self.atoms, np.vstack([self.positions, new]), weights)

    def with_peaks(self, q: Complex, level: float, most: int = 20, oversampling: int = 4) -> Channel:
        """A lifted one with atoms of weight zero where the polynomial of a dual variable reaches a level."""
        return self.added(Polynomial(self.atoms, q).peaks(level, oversampling, most)[0])

    def merged(self, radius: float) -> Channel:
        """A lifted one whose atoms within ``radius`` resolution cells of a stronger one are replaced by it.

        The strongest atom takes over the others' signal as far as its subspace can.
        """
        norms = np.linalg.norm(self.weights, axis=1)  # equal ones keep their order, whatever the rounding
        left = list(np.argsort(-np.round(norms / norms.max(initial=1e-300), 8), kind="stable"))
        places, weights = [], []
        while left:
            near = self._cells(self.positions[left], self.positions[left[0]]) < radius
            group, left = [left[0], *np.array(left)[near][1:]], list(np.array(left)[~near])
            weight = self.waveform[group[0]]
            if len(group) > 1:
                together = self.taken(np.array(group)).samples()
                weight = np.linalg.lstsq(self.atoms.matrix(self.positions[group[0]]), together, rcond=None)[0]
            places.append(self.positions[group[0]])
            weights.append(weight)
        return Channel.from_weights(self.atoms, np.array(places), np.array(weights)) if places else self

    def _cells(self, positions: Real, position: Real) -> Real:
        """Largest coordinate distance in resolution cells."""
        return np.max(distance(positions, position) * self.atoms.counts, axis=-1, initial=0.0)

    def structured(self) -> Channel:
        """The rank-one part of lifted coefficients: gains times one waveform, with every axis."""
        atoms = Atoms(self.atoms.source, self.atoms.shape, every_axis=True)
        if not len(self):
            first = np.eye(1, atoms.size, dtype=complex)[0]
            return Channel(atoms, np.zeros((0, len(atoms.axes))), np.zeros(0, complex), first)
        positions, weights = self.positions, self.waveform
        if atoms.axes != self.atoms.axes:
            per_pulse = weights.reshape(len(self), atoms.source.messages, -1)
            dopplers = relative_dopplers(per_pulse)
            ramps = np.exp(2j * np.pi * dopplers[:, None] * np.arange(atoms.source.messages))
            positions = np.insert(positions, 1, dopplers, axis=1)
            weights = (per_pulse * ramps[..., None]).reshape(len(self), -1)
        left, sizes, right = np.linalg.svd(weights, full_matrices=False)
        return Channel(atoms, positions, left[:, 0] * sizes[0], right[0]).normalised()

    def normalised(self) -> Channel:
        """The same with a waveform of norm one whose largest coefficient is real and positive.

        Dopplers that messages absorb count from the strongest path.
        """
        positions, waveform = self.positions.copy(), self.waveform
        if self.relative_axis is not None and len(self):
            start = positions[self.strongest, self.relative_axis]
            positions[:, self.relative_axis] -= start
            ramp = np.exp(-2j * np.pi * start * np.arange(self.atoms.source.messages))
            waveform = (waveform.reshape(len(ramp), -1) * ramp[:, None]).reshape(-1)
        largest = waveform[np.argmax(np.abs(waveform))]
        factor = np.linalg.norm(waveform) * (largest / abs(largest) if largest else 1)
        return Channel(self.atoms, positions % 1.0, self.amplitudes * factor, waveform / factor)


Channels = list[Channel]


def no_paths(problem: Problem) -> Channels:
    """A lifted channel without paths for every source."""
    families = [Atoms(source, problem.shape) for source in problem.sources]
    empty = np.zeros(0, complex)
    return [Channel(one, np.zeros((0, len(one.axes))), empty, empty.reshape(0, one.size)) for one in families]


def paths(channels: Sequence[Channel]) -> tuple[int, ...]:
    """Number of paths of every source."""
    return tuple(len(one) for one in channels)


def unknowns(channels: Sequence[Channel]) -> int:
    """Real unknowns of all sources."""
    return sum(one.unknowns for one in channels)


def each_atom(channels: Sequence[Channel]) -> Iterator[tuple[Atoms, Real, Complex]]:
    """The lifted atoms one by one: family, position, coefficients."""
    for one in channels:
        for position, weight in zip(one.positions, one.weights, strict=True):
            yield one.atoms, position, weight


def residual(channels: Sequence[Channel], y: Complex) -> Complex:
    """What the channels leave of the samples, ``(A P M,)``."""
    explained: Complex = np.sum([one.samples() for one in channels], axis=0)
    return y.reshape(-1) - explained


def relative_residual(channels: Sequence[Channel], y: Complex) -> float:
    """Norm of the residual over that of the samples."""
    return float(np.linalg.norm(residual(channels, y))) / max(float(np.linalg.norm(y)), 1e-300)


def objective(channels: Sequence[Channel], left: Complex, level: float = 0.0) -> float:
    """``½‖left‖² + level Σ weight ‖wᵢ‖`` of channels that leave a residual ``(A P M,)``."""
    penalty = level * float(sum(one.strengths.sum() for one in channels)) if level else 0.0
    return 0.5 * float(np.linalg.norm(left) ** 2) + penalty


def with_weights(channels: Sequence[Channel], vector: Complex) -> Channels:
    """Lifted channels with the coefficients of all atoms from one vector."""
    parts = np.split(vector, np.cumsum([one.waveform.size for one in channels])[:-1])
    return [replace(one, waveform=part.reshape(one.waveform.shape)) for one, part in zip(channels, parts, strict=True)]


def with_fitted_weights(channels: Sequence[Channel], y: Complex) -> Channels:
    """Lifted channels with least-squares coefficients at their positions."""
    matrix = np.hstack([one.linear() for one in channels])
    return with_weights(channels, np.linalg.lstsq(matrix, y.reshape(-1), rcond=None)[0])


def fit(channels: Channels, y: Complex, steps: int = 30, level: float = 0.0) -> Channels:
    """Levenberg–Marquardt on all positions, gains and waveforms together; structured channels end normalised.

    What no samples can tell stays where it is.

    Args:
        channels: where to start.
        y: ``(A, P, M)`` or ``(A P M,)``.
        steps: at most; the descent ends where none lowers the objective.
        level: of the penalty on the norms of lifted coefficients; its curvature is exact, the fit's Gauss–Newton's.
    """
    if not any(paths(channels)):
        return channels
    left, damping = residual(channels, y), 1e-6
    value = objective(channels, left, level)
    for _ in range(steps):
        hessian, gradient = normal_equations(channels, left, level)
        before = value
        for _ in range(_TRIALS):
            trial = _moved(channels, hessian, gradient, damping)
            left = residual(trial, y)
            value = objective(trial, left, level)
            if value < before:
                break
            damping = max(damping * 20, 1e-6)
        else:
            break
        channels, damping = trial, max(damping / 5, 1e-12)
        if before - value < 1e-13 * value:
            break
    return [one if one.lifted else one.normalised() for one in channels]


def normal_equations(channels: Sequence[Channel], left: Complex, level: float = 0.0) -> tuple[Real, Real]:
    """Curvature and gradient, at a residual ``(A P M,)``, of the objective.

    By real parts, then imaginary parts of what :meth:`Channel.linear` tells of all sources, then by positions.
    """
    linear = np.hstack([one.linear() for one in channels])
    both = np.hstack([linear, *(one.slopes() for one in channels)])
    gram, right = both.conj().T @ both, both.conj().T @ left
    w, x = slice(0, linear.shape[1]), slice(linear.shape[1], None)
    hessian = np.block([
        [gram[w, w].real, -gram[w, w].imag, gram[w, x].real],
        [gram[w, w].imag, gram[w, w].real, gram[w, x].imag],
        [gram[w, x].real.T, gram[w, x].imag.T, gram[x, x].real],
    ])  # fmt: skip
    gradient = -np.concatenate([right[w].real, right[w].imag, right[x].real])
    if level:
        _add_penalty(channels, level, hessian, gradient)
    return hessian, gradient


def _add_penalty(channels: Sequence[Channel], level: float, hessian: Real, gradient: Real) -> None:
    start, total = 0, sum(one.waveform.size for one in channels)
    for atoms, _, weight in each_atom(channels):
        penalty, norm = level * atoms.source.weight, float(np.linalg.norm(weight))
        direction = np.concatenate([weight.real, weight.imag]) / norm
        inside = np.arange(start, start + weight.size)
        both = np.concatenate([inside, total + inside])
        gradient[both] += penalty * direction
        hessian[np.ix_(both, both)] += penalty / norm * (np.eye(len(both)) - np.outer(direction, direction))
        start += weight.size


def _moved(channels: Sequence[Channel], hessian: Real, gradient: Real, damping: float) -> Channels:
    """One damped step; none where the system has no solution."""
    diagonal = np.diag(hessian)
    try:
        damped = hessian + np.diag((damping + 1e-14) * diagonal + (diagonal == 0))
        step = -np.linalg.solve(damped, gradient)
    except np.linalg.LinAlgError:
        step = np.zeros_like(gradient)
    sizes = [one.waveform.size + (0 if one.lifted else len(one)) for one in channels]
    real, imaginary, shift = np.split(step, [sum(sizes), 2 * sum(sizes)])
    changes = np.split(real + 1j * imaginary, np.cumsum(sizes)[:-1])
    shifts = np.split(shift, np.cumsum([one.positions.size for one in channels])[:-1])
    return [one.moved(*parts) for one, *parts in zip(channels, shifts, changes, strict=True)]
