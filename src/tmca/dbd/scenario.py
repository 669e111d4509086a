"""The physical layer: a pulse-Doppler radar and an OFDM transmitter on one carrier, received in the time domain.

Every interval of ``prefix_s + useful_s`` seconds starts with the cyclic prefix of a message; the radar fires when the
prefix is over, and the receiver looks at the useful part. There, a path no later than the prefix turns the spectrum of
a message by a ramp, and so does an echo that is over before the interval ends: thesis equations (37) to (58), with the
number of frequencies M = bandwidth × useful time. The Doppler shift within an interval is what the model leaves out.

A :class:`Scenario` describes; :meth:`Scenario.draw` draws codes and symbols, whose :class:`Scene` is what is received.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from tmca.dbd.model import LIGHT_M_S, LONGEST_NAME, Complex, Problem, Real, Source, Truth, Units
from tmca.dbd.simulation import (
    MESSAGES,
    MOST_FREQUENCIES,
    MOST_NUMBERS,
    carriers,
    message_source,
    noisy,
    overlaid,
    unit_vector,
)
from tmca.dbd.waveforms import Waveform, waveform_source
from tmca.errors import SettingError, check_choice, check_range
from tmca.summaries import Summary

_OVERSAMPLING = 32
"""Time samples per inverse bandwidth; the spectra are sums over them."""
_MOST = 1e30
"""No quantity of a scene is larger, in whatever unit, and no divisor smaller than its inverse; powers of larger ones
would be infinite."""


class Way(ABC):
    """What delays, shifts and scales a signal on its way to the receiver.

    Raises:
        SettingError: a number that is not finite, or absurdly large, or a name that no table has room for.
    """

    velocity_m_s: float
    gain: complex
    angle_deg: float
    name: str
    trips: ClassVar[int]
    """2 for there and back."""
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        for name, value in ((name, value) for name, value in vars(self).items() if name != "name"):
            if not abs(value) <= _MOST:
                wanted = f"a number of at most {_MOST:g}"
                raise SettingError(f"{name} of a {type(self).__name__.lower()}", f"{value}", wanted)
        if len(self.name) > LONGEST_NAME or not self.name.isprintable():
            raise SettingError("name", repr(self.name[:LONGEST_NAME]), f"one line of at most {LONGEST_NAME} letters")

    @property
    @abstractmethod
    def delay_s(self) -> float:
        """Of all trips."""

    def doppler_hz(self, carrier_hz: float) -> float:
        """``f v / c`` for each trip."""
        return self.trips * carrier_hz * self.velocity_m_s / LIGHT_M_S

    def turn(self, spacing: float) -> float:
        """The normalised angle for antennas ``spacing`` wavelengths apart."""
        return float(spacing * np.sin(np.deg2rad(self.angle_deg)))


@dataclass(frozen=True)
class Target(Way):
    """A point target of the radar.

    Args:
        range_m: distance.
        velocity_m_s: radial, positive away.
        gain: complex amplitude of the echo; one is as strong as a communications path of gain one.
        angle_deg: from the broadside of the array.
        name: in tables and figures of what is simulated; none is ``target 1``, …
    """

    range_m: float
    velocity_m_s: float
    gain: complex = 1.0
    angle_deg: float = 0.0
    name: str = ""
    trips: ClassVar[int] = 2

    @property
    def delay_s(self) -> float:
        """There and back."""
        return 2 * self.range_m / LIGHT_M_S


@dataclass(frozen=True)
class Path(Way):
    """A path from the communications transmitter to the receiver.

    Args:
        length_m: of the whole way.
        velocity_m_s: by which the way grows.
        gain: complex amplitude.
        angle_deg: of arrival.
        name: in tables and figures of what is simulated; none is ``path 1``, …
    """

    length_m: float
    velocity_m_s: float
    gain: complex = 1.0
    angle_deg: float = 0.0
    name: str = ""
    trips: ClassVar[int] = 1

    @property
    def delay_s(self) -> float:
        """One way."""
        return self.length_m / LIGHT_M_S


@dataclass(frozen=True, repr=False)
class Scenario(Summary):
    """The description of a radar scene and a communications channel that one receiver hears together.

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
        seed: of codes, symbols and noise, where :meth:`draw` is given none.

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
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        for name in ("pulses", "subspace", "antennas"):
            check_range(name, getattr(self, name), 1, whole=True)
        check_range("seed", self.seed, 0, whole=True)
        for name in ("bandwidth_hz", "useful_s", "carrier_hz", "spacing"):
            check_range(name, getattr(self, name), 1 / _MOST, _MOST)
        check_choice("messages", self.messages, MESSAGES)
        check_range("prefix_s", self.prefix_s, 0, unit="s")
        check_range("pulse_s", self.duration_s, above=0, unit="s")
        if self.snr_db is not None:
            check_range("snr_db", self.snr_db, -300, 300, unit="dB")
        self._check_size()
        self._check_delays()
        self._check_unambiguous()

    def _check_size(self) -> None:
        """Samples and bases fit in memory, before anything is made of them."""
        count = self.bandwidth_hz * self.useful_s
        remedy = "take a smaller bandwidth or a shorter interval"
        check_range("bandwidth_hz times useful_s", count, high=MOST_FREQUENCIES, unit="frequencies", remedy=remedy)
        check_range("subspace", self.subspace, 1, self.frequencies, remedy="take fewer unknowns than frequencies")
        unknowns = self.subspace * (self.pulses if self.messages == "dense" else 1)
        numbers = float(self.frequencies) * self.pulses * max(unknowns, self.antennas)
        remedy = "take fewer pulses, antennas or unknowns"
        check_range("samples of the bases", numbers, high=MOST_NUMBERS, remedy=remedy)

    def _check_delays(self) -> None:
        """Echoes end within the interval, paths come within the prefix, none before it was sent."""
        last = max((one.delay_s for one in self.targets), default=0.0) + self.duration_s
        if last > self.useful_s:
            reach = (self.useful_s - self.duration_s) * LIGHT_M_S / 2
            echo = f"an echo that ends {last * 1e6:.4g} µs after the pulse"
            remedy = f"take targets within {reach:.4g} m, a longer interval or a shorter pulse"
            raise SettingError("targets", echo, f"{self.useful_s * 1e6:.4g} µs at most", remedy)
        late = max((one.delay_s for one in self.paths), default=0.0)
        if late > self.prefix_s:
            remedy = "take a longer prefix; without one, subcarriers are no longer orthogonal"
            most = f"at most the prefix, {self.prefix_s * 1e6:.4g} µs"
            raise SettingError("paths", f"a path of {late * 1e6:.4g} µs", most, remedy)
        if any(one.delay_s < 0 for one in (*self.targets, *self.paths)):
            raise SettingError("targets and paths", "a negative distance", "distances of zero or more")

    def _check_unambiguous(self) -> None:
        """Dopplers stay within half the pulse repetition frequency, and angles within half a turn between antennas."""
        channels: dict[str, Sequence[Way]] = {"targets": self.targets, "paths": self.paths}
        for where, one in ((where, one) for where, channel in channels.items() for one in channel):
            limit = LIGHT_M_S / (2 * one.trips * self.carrier_hz * self.interval_s)
            if abs(one.velocity_m_s) >= limit:
                remedy = "take shorter intervals or a lower carrier; faster ones look like slower ones"
                raise SettingError(where, f"{one.velocity_m_s:.4g} m/s", f"less than {limit:.4g} m/s", remedy)
            turn = abs(one.turn(self.spacing))
            if self.antennas > 1 and turn >= 0.5:
                apart = f"a turn of {turn:.4g} wavelengths between antennas {self.spacing:g} wavelengths apart"
                raise SettingError(where, apart, "less than 0.5", "take antennas closer together or smaller angles")

    def _facts(self) -> dict[str, str]:
        return {
            "targets": ", ".join(f"{one.range_m:g} m at {one.velocity_m_s:g} m/s" for one in self.targets),
            "paths": ", ".join(f"{one.length_m:g} m at {one.velocity_m_s:g} m/s" for one in self.paths),
            "signals": f"{self.bandwidth_hz / 1e6:g} MHz at {self.carrier_hz / 1e9:g} GHz, {self.pulses} pulses",
            "noise": "none" if self.snr_db is None else f"{self.snr_db:g} dB below the signals",
        }

    @property
    def frequencies(self) -> int:
        """M, subcarriers in the bandwidth."""
        return max(1, round(self.bandwidth_hz * self.useful_s))

    @property
    def interval_s(self) -> float:
        """Pulse repetition interval: prefix and useful time."""
        return self.prefix_s + self.useful_s

    @property
    def duration_s(self) -> float:
        """Of the radar's pulse."""
        return self.useful_s / 5 if self.pulse_s is None else self.pulse_s

    @property
    def units(self) -> Units:
        """From normalised coordinates to seconds and hertz."""
        return Units(self.useful_s, 1 / self.interval_s, self.carrier_hz, self.spacing)

    def draw(self, seed: int | None = None) -> Scene:
        """Draws codes and symbols, all that is random but the noise; ``seed`` in place of the scenario's."""
        scenario = self if seed is None else replace(self, seed=seed)
        rng = np.random.default_rng(scenario.seed)
        chips = max(2, round(self.bandwidth_hz * self.duration_s))
        codes = np.exp(2j * np.pi * rng.random((chips, self.subspace)))
        times, transform = self.sampling()
        rows = transform @ self.pulse(codes, times)
        power = np.sqrt(np.mean(np.abs(rows) ** 2))  # a gain of one is then as strong as one of the other channel
        radar = Source("radar", rows / power, np.zeros(self.pulses, np.int64))
        size = (self.pulses, self.frequencies)
        link = message_source(rng, "communications", size, self.subspace, "gaussian", self.messages)
        waveforms = [unit_vector(rng, source.unknowns) for source in (radar, link)]
        truth = self._truth(self.targets, waveforms[0]), self._truth(self.paths, waveforms[1])
        return Scene(scenario, (radar, link), truth, codes / power)

    def _truth(self, channel: Sequence[Way], waveform: Complex) -> Truth:
        points = np.zeros((len(channel), 3))
        gains = np.zeros(len(channel), complex)
        for index, way in enumerate(channel):
            doppler = way.doppler_hz(self.carrier_hz)
            points[index] = (way.delay_s / self.useful_s, doppler * self.interval_s, way.turn(self.spacing))
            gains[index] = way.gain * np.exp(-2j * np.pi * doppler * self.middle_s(way))
        return Truth(points % 1.0, gains, waveform, tuple(way.name for way in channel))

    def middle_s(self, way: Way) -> float:
        """The middle of an echo, or of a message, since the useful part of an interval began; gains count from it."""
        return way.delay_s + self.duration_s / 2 if isinstance(way, Target) else self.useful_s / 2

    def pulse(self, codes: Complex, time: Real) -> Complex:
        """Pulses of ``(chips, …)`` codes at times in seconds: overlapping raised-cosine chips, zero outside."""
        half = self.duration_s / (len(codes) + 1)
        away = time[:, None] / half - 1 - np.arange(len(codes))
        return np.where(np.abs(away) < 1, 0.5 + 0.5 * np.cos(np.pi * away), 0.0) @ codes

    def sampling(self) -> tuple[Real, Complex]:
        """Instants of the useful part of an interval; ``(M, instants)``, the Fourier integral at the subcarriers."""
        count = _OVERSAMPLING * self.frequencies
        times = np.arange(count) * (self.useful_s / count)
        phases = np.outer(carriers(self.frequencies), times) / self.useful_s
        return times, np.exp(-2j * np.pi * phases) / count


@dataclass(frozen=True)
class Scene:
    """A scenario with the codes and symbols that were drawn for it, the one on air.

    Args:
        scenario: its description, with the seed.
        sources: radar and communications transmitter.
        truth: the channel and the signal of both.
        codes: ``(chips, J)``, of the radar's pulses.
    """

    scenario: Scenario
    sources: tuple[Source, Source] = field(repr=False)
    truth: tuple[Truth, Truth] = field(repr=False)
    codes: Complex = field(repr=False)

    def with_waveforms(self, waveforms: Mapping[str, Waveform]) -> Scene:
        """The scene with other signals, for :meth:`problem`: coefficients are drawn with the scenario's seed.

        Raises:
            SettingError: a source that the scene does not have, or a waveform that does not fit its interval.
        """
        scenario, sources, truth = self.scenario, list(self.sources), list(self.truth)
        names, rng = [one.name for one in sources], np.random.default_rng(self.scenario.seed)
        for name, waveform in waveforms.items():
            check_choice("waveform", name, names)
            place = names.index(name)
            sources[place] = waveform_source(name, waveform, scenario.pulses, scenario.frequencies, scenario.useful_s)
            truth[place] = replace(truth[place], waveform=unit_vector(rng, sources[place].unknowns))
        return replace(self, sources=(sources[0], sources[1]), truth=(truth[0], truth[1]))

    def problem(self) -> Problem:
        """The samples of the normalised model (58), with everything known."""
        y, sigma = self._noisy(overlaid(self.sources, self.truth, self.scenario.antennas))
        return Problem(y, self.sources, sigma, self.truth, self.scenario.units)

    def receive(self, doppler_within: bool = True) -> Problem:
        """The samples as a receiver gets them: both signals in the time domain, through their channels, transformed.

        The problem's ``sigma`` counts the noise and what the model leaves out, which a solver can explain no better.

        Args:
            doppler_within: let phases turn within an interval too, as they do; without, they turn from interval to
                interval only, and the samples are the model's.
        """
        spectra = self._spectra(doppler_within)
        y, sigma = self._noisy(spectra)
        if doppler_within:
            sigma = float(np.hypot(sigma, self._left_out(spectra)))
        return Problem(y, self.sources, sigma, self.truth, self.scenario.units)

    @property
    def model_error(self) -> float:
        """Relative norm of what the model leaves out of the noiseless samples."""
        spectra = self._spectra(True)
        return self._left_out(spectra) / float(np.sqrt(np.mean(np.abs(spectra) ** 2)))

    def _noisy(self, y: Complex) -> tuple[Complex, float]:
        return noisy(y, self.scenario.snr_db, np.random.default_rng(self.scenario.seed + 1))

    def _left_out(self, spectra: Complex) -> float:
        """Root mean square of what the model leaves out of noiseless samples."""
        model = overlaid(self.sources, self.truth, self.scenario.antennas)
        return float(np.sqrt(np.mean(np.abs(spectra - model) ** 2)))

    def _spectra(self, doppler_within: bool) -> Complex:
        """``(A, P, M)`` spectra of what arrives in every interval."""
        scene = self.scenario
        times, transform = scene.sampling()
        spectra = np.zeros((scene.antennas, scene.pulses, scene.frequencies), complex)
        for way in (*scene.targets, *scene.paths):
            within = times if doppler_within else np.full_like(times, scene.middle_s(way))
            steer = np.exp(-2j * np.pi * way.turn(scene.spacing) * np.arange(scene.antennas))
            for pulse in range(scene.pulses):
                phase = way.doppler_hz(scene.carrier_hz) * (pulse * scene.interval_s + within)
                arrived = way.gain * self._sent(way, pulse, times - way.delay_s) * np.exp(-2j * np.pi * phase)
                spectra[:, pulse] += steer[:, None] * (transform @ arrived)
        return spectra

    def _sent(self, way: Way, interval: int, time: Real) -> Complex:
        """What the transmitter of a way sends in an interval, at times since its useful part began."""
        if isinstance(way, Target):
            return self.scenario.pulse(self.codes @ self.truth[0].waveform, time)
        symbols = self.sources[1].signal(self.truth[1].waveform)[interval]
        waves = np.exp(2j * np.pi * np.outer(time, carriers(len(symbols))) / self.scenario.useful_s)
        return np.where(time >= -self.scenario.prefix_s, waves @ symbols, 0)
