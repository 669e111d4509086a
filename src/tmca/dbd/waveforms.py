"""Bases from waveforms in time: a chirp, an OFDM grid, samples of one's own.

The model wants spectra: of the pulse at the M frequencies, ``n / useful time`` apart. Each of J waveforms whose mix is
sent gives a column; a single column is a signal that is known up to its gain.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tmca.dbd.model import Complex, Problem, Source
from tmca.dbd.simulation import MOST_FREQUENCIES, MOST_NUMBERS, carriers
from tmca.errors import DataError, SettingError, ShapeError, check_range, check_shape, did_you_mean

if TYPE_CHECKING:
    from pydantic import ValidationError

    from tmca.dbd.recordings import RecordedSamples

UNKNOWN_NAME = "unexpected_keyword_argument"
"""Pydantic's name of that error."""
_OVERSAMPLING = 16
"""Samples of a chirp for every inverse of its bandwidth or of the receiver's, whichever is less."""


@dataclass(frozen=True)
class Chirp:
    """A pulse whose frequency rises (or falls) linearly through the bandwidth while its magnitude is one.

    Args:
        bandwidth_hz: from the lowest to the highest frequency around the carrier; negative for a falling one.
        duration_s: of the pulse.
        pieces: J, equal parts one after another whose gains and phases are unknown; 1 for a known pulse.
    """

    bandwidth_hz: float
    duration_s: float
    pieces: int = 1
    kind: ClassVar[str] = "chirp"
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        check_range("bandwidth of a chirp", abs(self.bandwidth_hz), above=0, high=1e15, unit="Hz")
        check_range("duration of a chirp", self.duration_s, above=0, high=1e6, unit="s")
        check_range("pieces of a chirp", self.pieces, 1, 1000, whole=True)

    def rows(self, pulses: int, frequencies: int, delay_s: float) -> Complex:
        """``(M, J)``, the spectrum of each piece.

        Raises:
            SettingError: a pulse that is longer than the useful time, or has too many samples.
        """
        check_range("duration of a chirp", self.duration_s, high=delay_s, unit="s")
        samples = _OVERSAMPLING * max(abs(self.bandwidth_hz), frequencies / delay_s) * self.duration_s
        check_range("samples of a chirp", samples, high=MOST_NUMBERS / frequencies)
        count = max(1, int(np.ceil(samples / self.pieces))) * self.pieces
        times = (np.arange(count) + 0.5) * (self.duration_s / count)
        pulse = np.exp(1j * np.pi * self.bandwidth_hz / self.duration_s * (times - self.duration_s / 2) ** 2)
        parts = np.zeros((self.pieces, count), complex)
        parts[np.repeat(np.arange(self.pieces), count // self.pieces), np.arange(count)] = pulse
        return basis_from_waveform(parts, frequencies, delay_s, count / self.duration_s, times[0])


@dataclass(frozen=True)
class Ofdm:
    """OFDM symbols, one in each pulse interval after its cyclic prefix: unknown data on known QPSK codes.

    Args:
        subcarriers: that are used, around the carrier; the others are silent.
        unknowns: J, data symbols that a pulse spreads over its subcarriers; 1 for a known grid with an unknown gain.
        shared: all pulses carry the same data, in codes of their own; otherwise each has data of its own.
        prefix_s: cyclic prefix; the receiver looks at what follows.
        seed: of the codes.
    """

    subcarriers: int
    unknowns: int = 1
    shared: bool = False
    prefix_s: float = 0.0
    seed: int = 0
    kind: ClassVar[str] = "ofdm"
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        check_range("subcarriers", self.subcarriers, 1, MOST_FREQUENCIES, whole=True)
        remedy = "take fewer unknowns than subcarriers"
        check_range("unknowns of an OFDM grid", self.unknowns, 1, self.subcarriers, whole=True, remedy=remedy)
        check_range("prefix of an OFDM grid", self.prefix_s, 0, 1e6, unit="s")
        check_range("seed", self.seed, 0, whole=True)

    def codes(self, pulses: int) -> Complex:
        """``(P, J, subcarriers)``, of magnitude one."""
        turns = np.random.default_rng(self.seed).integers(4, size=(pulses, self.unknowns, self.subcarriers))
        return np.exp(0.5j * np.pi * (turns + 0.5))

    def samples(self, pulses: int, delay_s: float, sample_rate_hz: float) -> Complex:
        """``(P, J, T)``, what each unknown sends in time, prefix first."""
        times = np.arange(round((self.prefix_s + delay_s) * sample_rate_hz)) / sample_rate_hz - self.prefix_s
        return self.codes(pulses) @ np.exp(2j * np.pi * np.outer(carriers(self.subcarriers), times) / delay_s)

    def rows(self, pulses: int, frequencies: int, delay_s: float) -> Complex:
        """``(P, M, J)``: the codes on their subcarriers, as the transform of :meth:`samples` after the prefix is.

        Raises:
            SettingError: more subcarriers than frequencies, or too many numbers.
        """
        check_range("subcarriers", self.subcarriers, high=frequencies, remedy="the receiver has no more frequencies")
        check_range("numbers of the basis", float(pulses) * frequencies * self.unknowns, high=MOST_NUMBERS)
        rows = np.zeros((pulses, frequencies, self.unknowns), complex)
        first = frequencies // 2 - self.subcarriers // 2
        rows[:, first : first + self.subcarriers] = self.codes(pulses).swapaxes(1, 2)
        return rows


@dataclass(frozen=True)
class SampledWaveform:
    """Samples of a pulse in a file: ``.npz``, ``.mat``, or SigMF (``.sigmf-meta`` beside ``.sigmf-data``).

    Args:
        file: that holds them: ``(T,)`` of a known pulse, ``(J, T)`` of J whose mix is sent, ``(P, J, T)`` where they
            change from pulse to pulse.
        variable: which array, where there are several.
        sample_rate_hz: of the samples; a SigMF file says it itself.
        start_s: when the first one is, since the useful time of an interval began.
        count: how many count, all without.
        shared: of waveforms that change from pulse to pulse: all pulses send the same mix; otherwise each its own.
    """

    file: Path
    variable: str | None = None
    sample_rate_hz: float | None = None
    start_s: float = 0.0
    count: int | None = None
    shared: bool = True
    kind: ClassVar[str] = "samples"
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def __post_init__(self) -> None:
        if self.sample_rate_hz is not None:
            check_range("sample rate of samples", self.sample_rate_hz, above=0, unit="Hz")
        check_range("start of samples", self.start_s, unit="s")
        if self.count is not None:
            check_range("count of samples", self.count, 1, whole=True)

    def rows(self, pulses: int, frequencies: int, delay_s: float) -> Complex:
        """``(M, J)``, their spectra; ``(P, M, J)`` where they change from pulse to pulse.

        Raises:
            DataError: a missing or damaged file, or one without a sample rate where none is given.
            ShapeError: waveforms of another number of pulses.
        """
        recorded = self._recorded()
        if recorded.samples.ndim == 3:
            check_shape(str(self.file), recorded.samples, (pulses, "J", "T"), "one set of waveforms for each pulse")
        rate = recorded.sample_rate_hz if self.sample_rate_hz is None else self.sample_rate_hz
        if rate is None:
            raise DataError(self.file, "no sample rate", "one", "give sample_rate=… in hertz")
        return basis_from_waveform(recorded.samples, frequencies, delay_s, rate, self.start_s)

    def taken_as(self) -> str:
        """What the shape of the samples is taken as, in words."""
        *pulses, waveforms, count = np.atleast_2d(self._recorded().samples).shape
        what = "a known waveform" if waveforms == 1 else f"{waveforms} unknown waveforms, of which a mix is sent,"
        every = f" in each of {pulses[0]} pulses" if pulses else ", the same in every pulse"
        return f"{what} of {count} samples{every}"

    def _recorded(self) -> RecordedSamples:
        from tmca.dbd.recordings import read_recording

        recorded = read_recording(self.file, self.variable)
        return recorded._replace(samples=recorded.samples[..., : self.count])


Waveform = Chirp | Ofdm | SampledWaveform
KINDS: Mapping[str, type[Chirp] | type[Ofdm] | type[SampledWaveform]] = {
    one.kind: one for one in (Chirp, Ofdm, SampledWaveform)
}


def basis_from_waveform(
    samples: Complex, frequencies: int, delay_s: float, sample_rate_hz: float, start_s: float = 0.0
) -> Complex:
    """The basis of waveforms in time: their spectra at the M frequencies of the receiver.

    ``rows[n, j] = Σ_t samples[j, t] exp(−j2π n t / delay_s)``, over its root mean square, with ``n`` from ``−⌊M/2⌋``:
    what a transform of the useful time sees of them.

    Args:
        samples: ``(T,)``, ``(J, T)``, or ``(P, J, T)`` where pulses differ.
        frequencies: M.
        delay_s: useful time of an interval, the inverse of the frequency spacing.
        sample_rate_hz: of the samples.
        start_s: when the first sample is, since the useful time began.

    Returns:
        ``(M, J)`` or ``(P, M, J)``, for :class:`Source`.

    Raises:
        ShapeError, SettingError: samples of another shape, none that are not zero, more than the useful time.
    """
    values = np.atleast_2d(np.asarray(samples, np.complex128))
    if values.ndim not in (2, 3) or not values.size:
        raise ShapeError("samples", f"shape {np.shape(samples)}", "(T,), (J, T) or (P, J, T)")
    if not np.all(np.isfinite(values)):
        raise SettingError("samples", "NaN or infinite ones", "finite ones")
    check_range("frequencies", frequencies, 1, MOST_FREQUENCIES, whole=True)
    check_range("delay_s", delay_s, above=0, unit="s")
    check_range("sample_rate_hz", sample_rate_hz, frequencies / delay_s * (1 - 1e-9), unit="Hz",
                remedy="fewer samples than frequencies cannot tell them apart")  # fmt: skip
    remedy = "cut the samples to one pulse, or take a longer useful time"
    duration = values.shape[-1] / sample_rate_hz
    check_range("samples of a pulse", duration, high=delay_s * (1 + 1e-9), unit="s", remedy=remedy)
    times = start_s + np.arange(values.shape[-1]) / sample_rate_hz
    transform = np.exp(-2j * np.pi * np.outer(times, carriers(frequencies)) / delay_s)
    rows = (values @ transform).swapaxes(-1, -2)
    size = float(np.sqrt(np.mean(np.abs(rows) ** 2)))
    if size == 0:
        raise SettingError("samples", "only zeros", "samples of a signal")
    return np.asarray(rows / size)


def spectra_of_recording(
    samples: Complex, frequencies: int, delay_s: float, sample_rate_hz: float, prf_hz: float, start_s: float = 0.0
) -> Complex:
    """The samples y of a recording in time: the useful part of every pulse interval, transformed.

    Args:
        samples: ``(T,)``.
        frequencies: M.
        delay_s: useful time of an interval.
        sample_rate_hz: of the samples.
        prf_hz: pulse repetition frequency.
        start_s: when the useful time of the first interval begins, since the first sample.

    Returns:
        ``(P, M)``, for :class:`Problem`, of as many whole useful times as there are; scaled as a time average.

    Raises:
        SettingError: an interval shorter than its useful time, or no whole one.
    """
    values = np.asarray(samples, np.complex128).reshape(-1)
    check_range("prf_hz", prf_hz, above=0, high=1 / delay_s * (1 + 1e-9), unit="Hz")
    check_range("sample_rate_hz", sample_rate_hz, frequencies / delay_s * (1 - 1e-9), unit="Hz")
    inside = round(delay_s * sample_rate_hz)
    pulses = int(np.floor(((len(values) - inside) / sample_rate_hz - start_s) * prf_hz + 1e-9)) + 1
    if pulses < 1 or start_s < 0:
        raise SettingError("samples", f"{len(values)} of them", f"{inside} or more after start_s of 0 or more")
    spectra = np.zeros((pulses, frequencies), complex)
    for pulse in range(pulses):
        begin = start_s + pulse / prf_hz
        first = int(np.ceil(begin * sample_rate_hz - 1e-9))
        window = values[first : first + inside]
        times = (first + np.arange(len(window))) / sample_rate_hz - begin
        spectra[pulse] = window @ np.exp(-2j * np.pi * np.outer(times, carriers(frequencies)) / delay_s) / inside
    return spectra


def waveform_source(name: str, waveform: Waveform, pulses: int, frequencies: int, delay_s: float) -> Source:
    """A source that sends a waveform in every pulse; see :class:`Source`."""
    rows = waveform.rows(pulses, frequencies, delay_s)
    own = not isinstance(waveform, Chirp) and not waveform.shared
    return Source(name, rows, np.arange(pulses) if own else np.zeros(pulses, np.int64))


def with_waveforms(problem: Problem, waveforms: Mapping[str, Waveform]) -> Problem:
    """The problem with bases from waveforms, in place of those of these names or beside them; it has no truth then.

    Raises:
        SettingError: a problem without units, whose useful time is not known.
    """
    if not waveforms:
        return problem
    if problem.units is None:
        remedy = "give delay_s (the useful time of an interval) and doppler_hz with the samples"
        raise SettingError("waveform", "samples without units", "a known useful time", remedy)
    _, pulses, frequencies = problem.shape
    made = {
        name: waveform_source(name, one, pulses, frequencies, problem.units.delay_s) for name, one in waveforms.items()
    }
    known = [made.pop(one.name, one) for one in problem.sources]
    return Problem(problem.y, (*known, *made.values()), problem.sigma, units=problem.units)


def read_waveforms(given: str) -> dict[str, Waveform]:
    """Waveforms by the names of their sources, from ``NAME=KIND:SETTING=VALUE,…`` or a YAML file.

    Settings are those of the classes, without units in their names if one likes: ``radar=chirp:bandwidth=8e6,
    duration=1e-6``. In YAML, ``radar: {kind: chirp, bandwidth_hz: 8e6, duration_s: 1e-6}``; files are beside it.

    Raises:
        DataError, SettingError: no such file or kind, unknown or bad settings.
    """
    name, equals, rest = given.partition("=")
    if equals:
        if not name.strip():
            raise SettingError("waveform", f"{given!r}, without a NAME", "NAME=KIND:SETTING=VALUE,…")
        kind, _, settings = rest.partition(":")
        pairs = dict(one.partition("=")[::2] for one in settings.split(",") if one)
        return {name: _waveform(f"waveform {name}", {"kind": kind, **pairs}, Path())}
    from tmca.yaml_files import read_yaml

    path = Path(given)
    if not path.is_file():
        raise DataError(given, "no such file", "a YAML file, or NAME=KIND:SETTING=VALUE,…")
    described = read_yaml(path, "waveforms by the names of their sources")
    return {str(name): _waveform(f"{path}, {name}", one, path.parent) for name, one in described.items()}


def _waveform(where: str, described: Any, folder: Path) -> Waveform:
    from pydantic import TypeAdapter, ValidationError

    if not isinstance(described, Mapping) or described.get("kind") not in KINDS:
        kind = described.get("kind") if isinstance(described, Mapping) else described
        raise SettingError(where, f"kind {kind!r}", f"one of {', '.join(KINDS)}")
    made = KINDS[described["kind"]]
    names = [field.name for field in fields(made)]
    short = {name: name.rpartition("_")[0] if name.endswith(("_hz", "_s")) else name for name in names}
    full = {without_unit: name for name, without_unit in short.items()}
    settings = {full.get(name, name): _plain(value) for name, value in described.items() if name != "kind"}
    try:
        waveform: Waveform = TypeAdapter(made).validate_python(settings)
    except ValidationError as error:
        raise _refusal(where, short, error) from error
    if isinstance(waveform, SampledWaveform):
        return SampledWaveform(folder / waveform.file, *list(vars(waveform).values())[1:])
    return waveform


def _refusal(where: str, short: Mapping[str, str], error: ValidationError) -> SettingError:
    """What is wrong with settings, whose names are shown without units."""
    first = first_problem(error)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, SettingError):
        return SettingError(f"{where}, {cause.where}", cause.found, cause.expected, cause.remedy)
    place, known = ".".join(short.get(one, one) for one in map(str, first["loc"])), ", ".join(short.values())
    if first["type"] in ("missing", "missing_argument"):
        return SettingError(where, f"no {place}=", known)
    if first["type"] == UNKNOWN_NAME:
        return SettingError(where, f"{place}=", known, did_you_mean(place, list(short.values())))
    return SettingError(where, f"{place} {first['input']!r}", f"{known}: {first['msg']}")


def first_problem(error: ValidationError) -> Any:
    """What to say of a description: first a name that there is not, which may be a misspelt one of those missing."""
    return sorted(error.errors(), key=lambda one: one["type"] != UNKNOWN_NAME)[0]


def _plain(value: Any) -> Any:
    """YAML 1.1 has text for 8e6; pydantic makes numbers of text, but none of a switch."""
    return value if isinstance(value, bool) or value is None else str(value)
