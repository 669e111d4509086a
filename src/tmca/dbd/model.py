"""What a receiver has: overlaid samples and what is known of their sources; and what these cannot tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations

import numpy as np

from tmca.dbd.coordinates import Complex, Real, Units, Whole
from tmca.errors import SettingError, ShapeError


@dataclass(frozen=True)
class Source:
    """A radar or a communications transmitter whose signal lies in a known subspace (thesis equations 56 and 57).

    The signal of pulse ``p`` at frequency ``n`` is ``rows[p, n] @ v[message[p]]`` with unknown coefficients ``v``.

    Args:
        name: what tables and files call it.
        rows: ``(P, M, J)``, the rows ``bₙᴴ`` of the basis in every pulse; ``(M, J)`` where all pulses are the same.
        message: ``(P,)``, which coefficient vector each pulse carries, not decreasing from 0: all zero for a radar
            and for ``shared`` messages, ``0 … P−1`` for ``block`` messages (57).
        weight: of this source in the sum of atomic norms, ``‖f‖ ≤ weight``; by default the root mean square of the
            rows, so that the scale of a basis makes no difference (one for Vandermonde rows, as in the thesis).

    Raises:
        ShapeError, SettingError: rows that are no basis, messages out of order, a weight that is not positive.
    """

    name: str
    rows: Complex = field(repr=False)
    message: Whole = field(repr=False)
    weight: float = None  # type: ignore[assignment]  # a float from here on

    def __post_init__(self) -> None:
        message = np.asarray(self.message)
        if not np.all(message == message.astype(np.int64)):
            raise SettingError(f"messages of {self.name}", f"{message.tolist()}", "whole numbers")
        rows = np.asarray(self.rows, np.complex128)
        if rows.ndim == 2:
            rows = np.broadcast_to(rows, (len(message), *rows.shape))
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "message", message.astype(np.int64))
        self._check_rows()
        self._check_message()
        self._check_rank()
        if self.weight is None:
            power = np.abs(rows) ** 2
            object.__setattr__(self, "weight", float(np.sqrt(np.mean(power[power > 0]))))
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise SettingError(f"weight of {self.name}", f"{self.weight}", "a positive number")

    @property
    def messages(self) -> int:
        """Number of coefficient vectors, G."""
        return int(self.message[-1]) + 1

    @property
    def subspace(self) -> int:
        """Dimension of the signal's subspace in one pulse, J."""
        return self.rows.shape[2]

    @property
    def unknowns(self) -> int:
        """Complex unknowns of one lifted atom, G J."""
        return self.messages * self.subspace

    @cached_property
    def same_every_pulse(self) -> bool:
        """Whether all pulses have the same rows."""
        return self.rows.strides[0] == 0 or bool(np.all(self.rows == self.rows[:1]))

    @property
    def sees_doppler(self) -> bool:
        """Whether a message spans two pulses; without, every path's Doppler hides in its messages' phases."""
        return self.messages < len(self.message)

    def signal(self, coefficients: Complex) -> Complex:
        """The transmitted spectra ``(…, P, M)`` for ``coefficients`` of G J numbers in the last dimension."""
        before = coefficients.shape[:-1]
        if self.messages == 1 and self.same_every_pulse:
            spectrum = coefficients @ self.rows[0].T
            return np.broadcast_to(spectrum[..., None, :], (*before, *self.rows.shape[:2]))
        if self.messages == 1:
            return (coefficients @ self.rows.reshape(-1, self.subspace).T).reshape(*before, *self.rows.shape[:2])
        per_pulse = coefficients.reshape(*before, self.messages, self.subspace)[..., self.message, :]
        return np.matmul(self.rows, per_pulse[..., None])[..., 0]

    def with_signal(self, coefficients: Complex) -> Source:
        """The source that sends what these ``(G J,)`` coefficients make, up to one factor."""
        return Source(self.name, self.signal(coefficients)[..., None], np.zeros(len(self.message), np.int64))

    def _check_rows(self) -> None:
        where, rows = f"basis of {self.name}", self.rows
        if rows.ndim != 3 or 0 in rows.shape:
            raise ShapeError(where, f"shape {rows.shape}", "(pulses, frequencies, subspace) or the last two")
        bad = int(np.sum(~np.isfinite(rows)))
        if bad:
            raise SettingError(where, f"{bad} values that are NaN or infinite", "finite values only")

    def _check_message(self) -> None:
        where, pulses = f"messages of {self.name}", len(self.rows)
        if self.message.shape != (pulses,):
            raise ShapeError(where, f"{self.message.size} numbers", f"one for each of {pulses} pulses")
        steps = np.diff(self.message, prepend=0)
        if self.message[0] != 0 or not np.all(np.isin(steps, (0, 1))):
            raise SettingError(where, f"{self.message.tolist()}", "0 for the first pulse, then steps of 0 or 1")

    def _check_rank(self) -> None:
        """Coefficients that do not show in the signal cannot be estimated."""
        for one in range(1 if self.same_every_pulse else self.messages):
            rows = self.rows[self.message == one].reshape(-1, self.subspace)
            rows = self.rows[0] if self.same_every_pulse else rows
            rank = int(np.linalg.matrix_rank(rows))
            if rank < self.subspace:
                where = f"basis of {self.name}" + (f", message {one}" if self.messages > 1 else "")
                size = f"{rows.shape[0]} x {rows.shape[1]}"
                remedy = "drop the columns that depend on others"
                raise SettingError(where, f"rank {rank} in {size}", "full column rank", remedy)


@dataclass(frozen=True)
class Truth:
    """The channel and the signal of one source.

    Args:
        points: ``(L, 3)``, normalised delay, Doppler and angle of each path in [0, 1).
        amplitudes: ``(L,)``, complex gains.
        waveform: ``(G J,)``, coefficients of the signal in its basis.
    """

    points: Real
    amplitudes: Complex
    waveform: Complex

    def __post_init__(self) -> None:
        count = len(self.amplitudes)
        if np.shape(self.points) != (count, 3):
            raise ShapeError("points of the truth", f"shape {np.shape(self.points)}", f"({count}, 3), as gains")
        if not all(np.all(np.isfinite(one)) for one in (self.points, self.amplitudes, self.waveform)):
            raise SettingError("truth", "NaN or infinite numbers", "finite ones")


@dataclass(frozen=True)
class Problem:
    """Overlaid samples in the frequency domain (thesis equation 58) with everything a solver may use.

    ``y[a, p, n] = Σ_sources Σ_paths α (rows[p, n] @ v[message[p]]) exp(−j2π(n τ + p ν + a θ)) + noise``
    with ``n`` from ``−⌊M/2⌋``.

    Args:
        y: ``(A, P, M)`` antennas, pulses, frequencies; ``(P, M)`` or ``(P·M,)`` for one antenna.
        sources: the transmitters.
        sigma: standard deviation of the complex noise of one sample; 0 without noise, None where it is unknown.
        truth: one per source, where it is known.
        units: physical scales, where there are any.

    Raises:
        ShapeError: y or a basis of the wrong size.
        SettingError: y with NaN, without sources, a negative sigma.
    """

    y: Complex = field(repr=False)
    sources: tuple[Source, ...]
    sigma: float | None = None
    truth: tuple[Truth, ...] | None = field(default=None, repr=False)
    units: Units | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sources", tuple(self.sources))
        if not self.sources:
            raise SettingError("sources", "none", "at least one")
        y = np.asarray(self.y, np.complex128)
        object.__setattr__(self, "y", y.reshape(self._lattice(y)))
        bad = int(np.sum(~np.isfinite(y)))
        if bad:
            raise SettingError("y", f"{bad} of {y.size} samples NaN or infinite", "finite samples", "drop the pulses")
        if self.sigma is not None and not (np.isfinite(self.sigma) and self.sigma >= 0):
            raise SettingError("sigma", f"{self.sigma}", "a standard deviation of zero or more")
        names = [one.name for one in self.sources]
        if len(set(names)) < len(names):
            raise SettingError("sources", ", ".join(names), "a name of its own for each")
        if self.truth is not None and len(self.truth) != len(self.sources):
            raise ShapeError("truth", f"{len(self.truth)}", f"one for each of {len(self.sources)} sources")

    def _lattice(self, y: Complex) -> tuple[int, int, int]:
        pulses, frequencies = size = self.sources[0].rows.shape[:2]
        for source in self.sources[1:]:
            if source.rows.shape[:2] != size:
                there = f"{source.rows.shape[:2]} pulses and frequencies"
                raise ShapeError(f"basis of {source.name}", there, f"{size} as {self.sources[0].name}")
        antennas = y.shape[0] if y.ndim == 3 else 1
        if y.shape not in ((antennas, *size), size, (pulses * frequencies,)):
            expected = f"{size} or {pulses * frequencies} numbers, after antennas where there are any"
            raise ShapeError("y", f"shape {y.shape}", expected, "y and the bases have to be of the same pulses")
        return antennas, pulses, frequencies

    @property
    def shape(self) -> tuple[int, int, int]:
        """Antennas, pulses, frequencies."""
        return self.y.shape


class BeyondFreedom(UserWarning):
    """More lifted unknowns than samples."""


class SameSignals(UserWarning):
    """Whatever one source sends, another can send too."""


def lifted_unknowns(problem: Problem, paths: Sequence[int]) -> int:
    """Complex unknowns of the lifted problem: paths times coefficients, summed over the sources.

    For a radar and ``block`` messages L J + Q J P (dbd erratum S2: with the Doppler absorbed, every path needs its
    own J P coefficients; the sample bound of thesis equation 87 misses the factor P).
    """
    return sum(count * source.unknowns for count, source in zip(paths, problem.sources, strict=True))


def beyond_freedom(problem: Problem, paths: Sequence[int]) -> str | None:
    """Why no convex method can succeed with so many paths, or None."""
    unknowns, samples = lifted_unknowns(problem, paths), problem.y.size
    if unknowns <= samples:
        return None
    parts = " + ".join(f"{n} x {one.unknowns}" for n, one in zip(paths, problem.sources, strict=True))
    return (
        f"{parts} = {unknowns} lifted unknowns exceed {samples} samples: convex methods cannot succeed; "
        "take more frequencies, fewer coefficients or messages that pulses share"
    )


def same_signals(problem: Problem) -> tuple[str, ...]:
    """Pairs of sources one of which can send all that the other can, a sentence each."""
    from scipy.linalg import subspace_angles

    sentences = []
    for one, other in combinations(problem.sources, 2):
        if float(subspace_angles(_subspace(one), _subspace(other)).max()) < 1e-7:
            sentences.append(f"{one.name} and {other.name} can send the same signals: any path may be of either")
    return tuple(sentences)


def _subspace(source: Source) -> Complex:
    """All signals a source can send, as columns ``(P M, G J)``."""
    return np.moveaxis(source.signal(np.eye(source.unknowns, dtype=complex)), 0, -1).reshape(-1, source.unknowns)


def ambiguities(problem: Problem) -> tuple[str, ...]:
    """What is undetermined in principle, a sentence each."""
    sentences = ["the scale and phase of each waveform trade against its gains"]
    for source in problem.sources:
        if not source.sees_doppler and problem.shape[1] > 1:
            sentences.append(
                f"{source.name}: messages of their own in every pulse absorb the absolute Doppler; "
                "Dopplers are relative to each other, and waveforms known up to a phase ramp over the pulses"
            )
    sentences += same_signals(problem)
    sentences.append(
        "an unknown lag of a source's clock adds to all its delays, an unknown frequency offset to its Dopplers"
    )
    return tuple(sentences)
