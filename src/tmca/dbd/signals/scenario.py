"""The physical layer: a pulse-Doppler radar and an OFDM transmitter on one carrier, received in the time domain.

Every interval of ``prefix_s + useful_s`` seconds starts with the cyclic prefix of a message; the radar fires when the
prefix is over, and the receiver looks at the useful part. There, a path no later than the prefix turns the spectrum of
a message by a ramp, and so does an echo that is over before the interval ends: thesis equations (37) to (58), with the
number of frequencies M = bandwidth × useful time. The Doppler shift within an interval is what the model leaves out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.problem import Problem, Truth, Units
from tmca.dbd.signals.bases import unit_vector
from tmca.dbd.signals.messages import messages as message_source
from tmca.dbd.signals.scenario_checks import check_delays, check_numbers, check_unambiguous
from tmca.dbd.signals.simulate import overlaid
from tmca.dbd.signals.ways import Path, Target, Way
from tmca.dbd.source import Source

_OVERSAMPLING = 32
"""Time samples per inverse bandwidth; the spectra are sums over them."""


@dataclass(frozen=True)
class Scenario:
    """A radar scene and a communications channel that one receiver hears together.

    The radar's pulse is an unknown mix of ``subspace`` known pulses of random phase codes; a message is ``subspace``
    unknown symbols spread over all subcarriers by known codes.

    Args:
        targets: of the radar.
        paths: of the communications channel.
        bandwidth_hz: of both.
        useful_s: of an interval, the inverse of the subcarrier spacing.
        prefix_s: cyclic prefix.
        carrier_hz: of both.
        pulses: intervals that are received.
        subspace: J.
        pulse_s: duration of the radar's pulse; a fifth of the useful time without.
        messages: ``shared``, ``block`` or ``dense``.
        antennas: of the receiver.
        spacing: of the antennas, in wavelengths.
        snr_db: of the samples; no noise without.
        seed: of codes, symbols and noise.

    Raises:
        SettingError: durations or a bandwidth that are not positive, echoes that outlast the interval, paths later
            than the prefix, velocities or angles that look like others.
    """

    targets: Sequence[Target]
    paths: Sequence[Path]
    bandwidth_hz: float = 10e6
    useful_s: float = 3.3e-6
    prefix_s: float = 1.2e-6
    carrier_hz: float = 77e9
    pulses: int = 17
    subspace: int = 3
    pulse_s: float | None = None
    messages: str = "shared"
    antennas: int = 1
    spacing: float = 0.5
    snr_db: float | None = None
    seed: int = 0
    sources: tuple[Source, ...] = field(init=False, repr=False)
    truth: tuple[Truth, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_numbers(self)
        if self.pulse_s is None:
            object.__setattr__(self, "pulse_s", self.useful_s / 5)
        check_delays(self)
        check_unambiguous(self)
        rng = np.random.default_rng(self.seed)
        radar = self._radar(rng)
        link = message_source(
            rng, "communications", (self.pulses, self.frequencies), self.subspace, "gaussian", self.messages
        )
        sources = (radar, link)
        waveforms = [unit_vector(rng, source.unknowns) for source in sources]
        channels: tuple[Sequence[Way], Sequence[Way]] = (self.targets, self.paths)
        object.__setattr__(self, "sources", sources)
        object.__setattr__(self, "truth", tuple(map(self._truth, channels, waveforms)))

    @property
    def frequencies(self) -> int:
        """M, subcarriers in the bandwidth."""
        return max(1, round(self.bandwidth_hz * self.useful_s))

    @property
    def interval_s(self) -> float:
        """Pulse repetition interval: prefix and useful time."""
        return self.prefix_s + self.useful_s

    @property
    def units(self) -> Units:
        """From normalised coordinates to seconds and hertz."""
        return Units(self.useful_s, 1 / self.interval_s, self.carrier_hz, self.spacing)

    def problem(self) -> Problem:
        """The samples of the normalised model (58), with everything known."""
        rng = np.random.default_rng(self.seed + 1)
        made = overlaid(self.sources, self.truth, self.antennas, self.snr_db, rng)
        return replace(made, units=self.units)

    def receive(self, doppler_within: bool = True) -> Problem:
        """The samples as a receiver gets them: both signals in the time domain, through their channels, transformed.

        The problem's ``sigma`` counts the noise and what the model leaves out, which a solver can explain no better.

        Args:
            doppler_within: let phases turn within an interval too, as they do; without, they turn from interval to
                interval only, and the samples are the model's.
        """
        spectra = self._spectra(doppler_within)
        power = self._left_out(spectra) ** 2 if doppler_within else 0.0
        if self.snr_db is not None:
            rng = np.random.default_rng(self.seed + 1)
            sigma = float(np.sqrt(np.mean(np.abs(spectra) ** 2) * 10 ** (-self.snr_db / 10)))
            noise = rng.standard_normal(spectra.shape) + 1j * rng.standard_normal(spectra.shape)
            spectra, power = spectra + sigma * noise / np.sqrt(2), power + sigma**2
        return Problem(spectra, self.sources, float(np.sqrt(power)), self.truth, self.units)

    def _left_out(self, spectra: Complex) -> float:
        """Root mean square of what the model leaves out of noiseless samples."""
        return float(np.sqrt(np.mean(np.abs(spectra - replace(self, snr_db=None).problem().y) ** 2)))

    @property
    def model_error(self) -> float:
        """Relative norm of what the model leaves out of the noiseless samples."""
        spectra = self._spectra(True)
        return self._left_out(spectra) / float(np.sqrt(np.mean(np.abs(spectra) ** 2)))

    def _radar(self, rng: np.random.Generator) -> Source:
        """Known pulses, smooth chips of random phases, and their spectra at the subcarriers."""
        assert self.pulse_s is not None
        chips = max(2, round(self.bandwidth_hz * self.pulse_s))
        codes = np.exp(2j * np.pi * rng.random((chips, self.subspace)))
        times, step = self._times()
        pulses = np.stack([self._pulse(code)(times) for code in codes.T], axis=1)
        rows = self._transform(times, step) @ pulses
        power = np.sqrt(np.mean(np.abs(rows) ** 2))  # a gain of one is then as strong as one of the other channel
        rows = rows / power
        object.__setattr__(self, "_codes", codes / power)
        return Source("radar", rows, np.zeros(self.pulses, np.int64))

    def _pulse(self, code: Complex) -> Callable[[Real], Complex]:
        """A pulse as a function of time in seconds: overlapping raised-cosine chips, zero outside its duration."""
        assert self.pulse_s is not None
        half = self.pulse_s / (len(code) + 1)

        def pulse(time: Real) -> Complex:
            away = time[:, None] / half - 1 - np.arange(len(code))
            shape = np.where(np.abs(away) < 1, 0.5 + 0.5 * np.cos(np.pi * away), 0.0)
            return shape @ code

        return pulse

    def _times(self) -> tuple[Real, float]:
        """Instants of the useful part of an interval, and their distance."""
        count = _OVERSAMPLING * self.frequencies
        return np.arange(count) * (self.useful_s / count), self.useful_s / count

    def _transform(self, times: Real, step: float) -> Complex:
        """``(M, instants)``: the Fourier integral at the subcarriers, over the useful time."""
        n = np.arange(self.frequencies) - self.frequencies // 2
        return np.exp(-2j * np.pi * np.outer(n, times) / self.useful_s) * (step / self.useful_s)

    def _truth(self, channel: Sequence[Way], waveform: Complex) -> Truth:
        points = np.zeros((len(channel), 3))
        for index, one in enumerate(channel):
            turn = self.spacing * np.sin(np.deg2rad(one.angle_deg))
            doppler = one.doppler_hz(self.carrier_hz) * self.interval_s
            points[index] = (one.delay_s / self.useful_s, doppler, turn)
        gains = np.array([one.gain * self._turned(one) for one in channel], complex)
        return Truth(points % 1.0, gains, waveform)

    def _turned(self, one: Way) -> complex:
        """The Doppler's phase in the middle of what is received in an interval, a part of the gain."""
        return complex(np.exp(-2j * np.pi * one.doppler_hz(self.carrier_hz) * self._middle_s(one)))

    def _middle_s(self, one: Way) -> float:
        """The middle of an echo, or of a message, since the useful part of an interval began."""
        assert self.pulse_s is not None
        return one.delay_s + self.pulse_s / 2 if isinstance(one, Target) else self.useful_s / 2

    def _spectra(self, doppler_within: bool) -> Complex:
        """``(A, P, M)`` spectra of what arrives in every interval."""
        times, step = self._times()
        transform = self._transform(times, step)
        radar, link = self._sent()
        spectra = np.zeros((self.antennas, self.pulses, self.frequencies), complex)
        antennas = np.arange(self.antennas)
        pairs: list[tuple[Sequence[Way], Callable[[int, Real], Complex]]]
        pairs = [(self.targets, radar), (self.paths, link)]
        for channel, sent in pairs:
            for one in channel:
                within = times if doppler_within else np.full_like(times, self._middle_s(one))
                steer = np.exp(-2j * np.pi * self.spacing * np.sin(np.deg2rad(one.angle_deg)) * antennas)
                for pulse in range(self.pulses):
                    began = pulse * self.interval_s
                    phase = np.exp(-2j * np.pi * one.doppler_hz(self.carrier_hz) * (began + within))
                    arrived = one.gain * sent(pulse, times - one.delay_s) * phase
                    spectra[:, pulse] += steer[:, None] * (transform @ arrived)
        return spectra

    def _sent(self) -> tuple[Callable[[int, Real], Complex], Callable[[int, Real], Complex]]:
        """What both transmitters send in an interval, as functions of the time since its useful part began."""
        codes: Complex = self._codes  # type: ignore[attr-defined]
        pulse = self._pulse(codes @ self.truth[0].waveform)
        symbols = self.sources[1].signal(self.truth[1].waveform)
        n = np.arange(self.frequencies) - self.frequencies // 2

        def radar(_: int, time: Real) -> Complex:
            return pulse(time)

        def link(interval: int, time: Real) -> Complex:
            wave: Complex = np.exp(2j * np.pi * np.outer(time, n) / self.useful_s) @ symbols[interval]
            return np.where(time >= -self.prefix_s, wave, 0)

        return radar, link
