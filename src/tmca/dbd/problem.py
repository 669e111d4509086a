"""What a receiver has: samples of overlaid signals and what is known of their sources; in simulation, the truth too."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.source import Source
from tmca.errors import SettingError, ShapeError


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
class Units:
    """From normalised coordinates to seconds and hertz.

    Args:
        delay_s: seconds of a normalised delay of one: the inverse of the frequency spacing.
        doppler_hz: hertz of a normalised Doppler of one: the pulse repetition frequency.
        carrier_hz: carrier frequency, for velocities.
        spacing: antenna spacing in wavelengths, for angles.
    """

    delay_s: float
    doppler_hz: float
    carrier_hz: float
    spacing: float = 0.5


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
        pulses, frequencies = self.sources[0].rows.shape[:2]
        for source in self.sources[1:]:
            if source.rows.shape[:2] != (pulses, frequencies):
                found = f"{source.rows.shape[:2]} pulses and frequencies"
                raise ShapeError(f"basis of {source.name}", found, f"{(pulses, frequencies)} as {self.sources[0].name}")
        antennas = y.shape[0] if y.ndim == 3 else 1
        if y.shape not in ((antennas, pulses, frequencies), (pulses, frequencies), (pulses * frequencies,)):
            expected = (
                f"({pulses}, {frequencies}) or {pulses * frequencies} numbers, after antennas where there are any"
            )
            raise ShapeError("y", f"shape {y.shape}", expected, "y and the bases have to be of the same pulses")
        return antennas, pulses, frequencies

    @property
    def shape(self) -> tuple[int, int, int]:
        """Antennas, pulses, frequencies."""
        return self.y.shape
