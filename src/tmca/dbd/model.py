"""What a receiver has: overlaid samples and what is known of their sources.

Delays, Dopplers and angles are normalised: on a torus, where they wrap around at 1; :class:`Units` makes metres, metres
a second and degrees of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.errors import SettingError, ShapeError, check_range, check_shape
from tmca.summaries import Summary, sizes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Complex = NDArray[np.complexfloating[Any, Any]]
Real = NDArray[np.floating[Any]]
Whole = NDArray[np.signedinteger[Any]]
Mask = NDArray[np.bool_]

AXES = ("delay", "doppler", "angle")
LIGHT_M_S = 299_792_458.0
LONGEST_NAME = 60
"""Letters of the name of a target or a path."""
_LISTED = 10
"""Pulses that a message names."""


def distance(a: ArrayLike, b: ArrayLike) -> Real:
    """The shorter way around from ``a`` to ``b``, per coordinate, 0 to 0.5; arrays broadcast."""
    apart = np.abs(np.asarray(a, float) - np.asarray(b, float)) % 1.0
    return np.minimum(apart, 1 - apart)


def matched(estimate: Real, truth: Real) -> tuple[Whole, Whole]:
    """Pairs with the least sum of largest coordinate errors (Hungarian method): indices into both.

    Args:
        estimate: ``(n, D)``.
        truth: ``(m, D)``.
    """
    from scipy.optimize import linear_sum_assignment

    first, second = linear_sum_assignment(distance(estimate[:, None], truth[None]).max(-1, initial=0.0))
    return first, second


def centred(values: Real) -> Real:
    """The same place on the torus in −½ to ½."""
    return (np.asarray(values, float) + 0.5) % 1.0 - 0.5


def from_zero(delays: Real, frequencies: int) -> Real:
    """Delays in [0, 1), but those within half a resolution cell below one as what they are: a little under zero."""
    return delays - (delays > 1 - 0.5 / frequencies)


@dataclass(frozen=True)
class Units:
    """From normalised coordinates to seconds and hertz, metres, metres a second and degrees.

    Delays of sources whose name starts with ``radar`` are there and back.

    Args:
        delay_s: seconds of a normalised delay of one: the inverse of the frequency spacing.
        doppler_hz: hertz of a normalised Doppler of one: the pulse repetition frequency.
        carrier_hz: carrier frequency, for velocities; None leaves Dopplers in hertz.
        spacing: antenna spacing in wavelengths, for angles.

    Raises:
        SettingError: numbers that are not positive, a useful time longer than the interval between pulses.
    """

    delay_s: float
    doppler_hz: float
    carrier_hz: float | None = None
    spacing: float = 0.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None:
                check_range(name, value, above=0)
        remedy = f"it is within an interval of 1 / doppler_hz ({self.doppler_hz:g} Hz); give seconds and hertz"
        check_range("delay_s", self.delay_s, high=(1 + 1e-9) / self.doppler_hz, unit="s", remedy=remedy)

    def physical(self, values: Real, axis: int, name: str) -> Real:
        """Normalised delays (axis 0) in metres, Dopplers (1) of −½ to ½ in metres a second, angles (2) in degrees.

        Raises:
            SettingError: a Doppler without a carrier frequency.
        """
        if axis == 2:
            return np.rad2deg(np.arcsin(np.clip(values / self.spacing, -1, 1)))
        if axis == 1 and self.carrier_hz is None:
            raise SettingError("carrier_hz", "none", "a frequency", "give Units(…, carrier_hz=…) for velocities")
        scale = self.delay_s if axis == 0 else self.doppler_hz / (self.carrier_hz or 1.0)
        return np.asarray(values, float) * scale * LIGHT_M_S / (2.0 if is_radar(name) else 1.0)

    def deviation(self, values: Real, deviations: Real, axis: int, name: str) -> Real:
        """Standard deviations of normalised coordinates at ``values`` in the units of :meth:`physical`."""
        if axis < 2:
            return deviations * self.physical(np.array(1.0), axis, name)
        cosine = np.sqrt(np.maximum(1 - (values / self.spacing) ** 2, 0))
        with np.errstate(divide="ignore"):
            return np.rad2deg(deviations / (self.spacing * cosine))


def is_radar(name: str) -> bool:
    """Whether the delays of a source are there and back."""
    return name.startswith("radar")


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
        where, message, rows = f"basis of {self.name}", np.asarray(self.message), np.asarray(self.rows, np.complex128)
        rows = np.repeat(rows[None], len(message), axis=0) if rows.ndim == 2 else rows
        check_shape(where, rows, ("pulses", "frequencies", "subspace"))
        bad = int(np.sum(~np.isfinite(rows)))
        if bad:
            raise SettingError(where, f"{bad} values that are NaN or infinite", "finite values only")
        check_shape(f"messages of {self.name}", message, (len(rows),), "give one for each pulse")
        if message[0] != 0 or not np.all(np.isin(np.diff(message), (0, 1))):
            expected = "whole numbers, 0 for the first pulse, then steps of 0 or 1"
            raise SettingError(f"messages of {self.name}", f"{message.tolist()}", expected)
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "message", message.astype(np.int64))
        self._check_rank(where)
        if self.weight is None:
            power = np.abs(rows) ** 2
            object.__setattr__(self, "weight", float(np.sqrt(np.mean(power[power > 0]))))
        check_range(f"weight of {self.name}", self.weight, above=0)

    def _check_rank(self, where: str) -> None:
        """Raises SettingError for coefficients that do not show in the signal, as they cannot be estimated."""
        for one in range(self.messages):
            heard = self.rows[self.message == one].reshape(-1, self.subspace)
            rank = int(np.linalg.matrix_rank(heard))
            if rank < self.subspace:
                which = f"{where}, message {one}" if self.messages > 1 else where
                remedy = "drop the columns that depend on others"
                raise SettingError(which, f"rank {rank} of {self.subspace} columns", "full column rank", remedy)

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
        return bool(np.all(self.rows == self.rows[:1]))

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


@dataclass(frozen=True)
class Truth:
    """The channel and the signal of one source.

    Args:
        points: ``(L, 3)``, normalised delay, Doppler and angle of each path in [0, 1).
        amplitudes: ``(L,)``, complex gains.
        waveform: ``(G J,)``, coefficients of the signal in its basis.
        names: of the paths, in tables and figures; empty ones are numbered.
    """

    points: Real
    amplitudes: Complex
    waveform: Complex
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.names and len(self.names) != len(self.amplitudes):
            raise ShapeError("names of the truth", f"{len(self.names)}", f"{len(self.amplitudes)}, one for each path")
        check_shape("points of the truth", np.shape(self.points), (len(self.amplitudes), 3))
        if not all(np.all(np.isfinite(one)) for one in (self.points, self.amplitudes, self.waveform)):
            raise SettingError("truth", "NaN or infinite numbers", "finite ones")


@dataclass(frozen=True, repr=False)
class Problem(Summary):
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
        names = [one.name for one in self.sources]
        if not names or len(set(names)) < len(names):
            raise SettingError("sources", ", ".join(names) or "none", "at least one, each with a name of its own")
        y, size, like = np.asarray(self.y, np.complex128), self.sources[0].rows.shape[:2], names[0]
        if y.ndim > 1 and y.shape[-2:] in [one.rows.shape[:2] for one in self.sources]:
            size, like = y.shape[-2:], "y"
        for source in self.sources:
            check_shape(f"basis of {source.name}", source.rows, (*size, "J"), f"as {like}")
        shape = (y.shape[0] if y.ndim == 3 else 1, *size)
        if y.shape not in (shape, size, (size[0] * size[1],)):
            expected = f"{size} or {size[0] * size[1]} numbers, after antennas where there are any"
            turned = y.ndim > 1 and y.shape[-2:] == size[::-1]
            remedy = "transposed?" if turned else "y and the bases have to be of the same pulses"
            raise ShapeError("y", f"shape {y.shape}", expected, remedy)
        object.__setattr__(self, "y", y.reshape(shape))
        self._check_finite()
        if self.sigma is not None:
            check_range("sigma", self.sigma, 0)
        if self.truth is not None and len(self.truth) != len(names):
            raise ShapeError("truth", f"{len(self.truth)}", f"one for each of {len(names)} sources")

    def _check_finite(self) -> None:
        """Raises SettingError for samples that are NaN or infinite, and says in which pulses."""
        bad = ~np.isfinite(self.y)
        if bad.any():
            pulses = [str(one) for one in np.flatnonzero(bad.any(axis=(0, 2)))]
            which = f"{', '.join(pulses[:_LISTED])}{' …' * (len(pulses) > _LISTED)} of 0 to {self.shape[1] - 1}"
            plural = "s" if len(pulses) != 1 else ""
            found = f"{int(bad.sum())} of {bad.size} samples NaN or infinite, in pulse{plural} {which}"
            raise SettingError("y", found, "finite samples", "drop the pulses")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Antennas, pulses, frequencies."""
        return self.y.shape

    def plot(self) -> Figure:
        """Magnitude of the samples of the first antenna over pulses (rows) and frequencies."""
        from tmca.plots.thumbnails import Panel, row_figure

        return row_figure([Panel("samples: pulses × frequencies", np.abs(self.y[0]), "viridis", "magnitude")])

    def _facts(self) -> dict[str, str]:
        unknowns = (f"{one.name} ({one.unknowns} unknowns of its signal)" for one in self.sources)
        return {
            "samples": f"{sizes(self.shape)} (antennas, pulses, frequencies)",
            "sources": ", ".join(unknowns),
            "noise": "not known" if self.sigma is None else f"{self.sigma:.3g}" if self.sigma else "none",
            "truth": "" if self.truth is None else "known",
        }

    def _picture(self) -> Figure:
        return self.plot()
