"""Random problems of the normalised model, thesis equation (58): what transmitters send, and paths of theirs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from tmca.dbd.channel import Channel
from tmca.dbd.model import Complex, Problem, Real, Source, Truth, Whole, distance, is_radar
from tmca.errors import SettingError, check_choice, check_range

BASES = ("vandermonde", "gaussian", "dft", "sign")
KNOWN = ("radar", "communications", "both")
MESSAGES = ("shared", "block", "dense")
Several = int | Sequence[int]
_RATIOS = "a whole number, or one over a whole number"
_TRIES = 20_000
MOST_FREQUENCIES, MOST_NUMBERS = 2048, 2**25
"""Most frequencies, and most complex numbers of a basis (0.5 GB)."""
_MOST_PATHS = 1000


def simulate(
    M: int = 13,
    P: int = 9,
    J: int = 3,
    targets: Several = 3,
    paths: Several = 3,
    messages: str = "shared",
    seed: int = 0,
    snr_db: float | None = None,
    *,
    basis: str = "vandermonde",
    antennas: int = 1,
    symbol_ratio: float | Fraction = 1,
    lag: float = 0.0,
    late_samples: int = 0,
    separation: float | Sequence[float] | None = None,
    amplitudes: tuple[float, float] = (1.0, 1.0),
    known_waveforms: bool = False,
    known: str | None = None,
) -> Problem:
    """Draws a problem: points apart from each other, random phases, random signals in random subspaces.

    Args:
        M: frequencies.
        P: pulses.
        J: dimension of the subspace of each signal.
        targets: of the radar; several numbers for several radars, 0 or () for none.
        paths: of the communications channel; likewise.
        messages: ``shared``, ``block`` (thesis equation 57) or ``dense``.
        seed: of everything random.
        snr_db: mean power of the samples over the noise's; no noise without.
        basis: ``vandermonde``, ``gaussian``, ``dft`` or ``sign``.
        antennas: of the receiver; more than one makes the angle a third coordinate.
        symbol_ratio: duration of a message in pulse intervals: 1, a whole number, or one over it; other than 1 it
            says how messages spread, in place of ``messages``.
        lag: known lag of the communications clock, in units of a normalised delay.
        late_samples: lag beyond the cyclic prefix, in samples of an interval.
        separation: distance of two points in at least one coordinate, in all or per coordinate (delay, Doppler,
            angle); by default ``1/⌊(M−1)/2⌋``, ``1/⌊P/2⌋`` and ``1/⌊A/2⌋``.
        amplitudes: range of the paths' magnitudes, uniform.
        known_waveforms: every signal is known up to a factor: J becomes 1 (thesis table 8, plain super-resolution).
        known: of which transmitters it is: ``radar``, ``communications`` or ``both``; their channels stay unknown.

    Returns:
        The problem; its noise level is known to it.

    Raises:
        SettingError: sizes that are not positive or beyond what any receiver has, points that do not fit, SNR that is
            no number.
    """
    _check_known(known)
    _check_numbers({"M": M, "P": P, "J": J, "antennas": antennas}, seed, snr_db, amplitudes)
    radars, links = _transmitters(targets, paths)
    ratio = _ratio(symbol_ratio)
    unknowns = J * (P + 1 if messages == "dense" or late_samples else ratio.denominator)
    _check_limits(M, P, unknowns, antennas, radars + links)
    _check_spread(ratio, messages)
    rng, apart = np.random.default_rng(seed), _separation(separation, (M, P, antennas))
    absorbed = (ratio < 1 or P == 1 or (ratio == 1 and messages == "block")) and not late_samples
    sources, truth = [], []
    for name, points, gains in _channels(rng, radars, links, apart, absorbed, amplitudes):
        if is_radar(name):
            source = Source(name, random_rows(rng, M, J, basis), np.zeros(P, np.int64))
        else:
            source = message_source(rng, name, (P, M), J, basis, messages, ratio)
            source = _behind(rng, source, basis, lag, late_samples)
        waveform = unit_vector(rng, source.unknowns)
        if known_waveforms or known in ("both", name.rstrip(" 0123456789")):
            source, waveform = source.with_signal(waveform), np.ones(1, complex)
        sources.append(source)
        truth.append(Truth(points, gains, waveform))
    y, sigma = noisy(overlaid(sources, truth, antennas), snr_db, rng)
    return Problem(y, tuple(sources), sigma, tuple(truth))


def _check_known(known: str | None) -> None:
    """Raises SettingError for another transmitter than may be known."""
    if known == "channel":
        remedy = "a known channel with an unknown message has no solver here"
        raise SettingError("known", "'channel'", f"one of {', '.join(KNOWN)}", remedy)
    if known is not None:
        check_choice("known", known, KNOWN)


def _check_numbers(sizes: Mapping[str, int], seed: int, snr_db: float | None, amplitudes: tuple[float, float]) -> None:
    """Raises SettingError for numbers that are none of their kind."""
    for name, size in sizes.items():
        check_range(name, size, 1, whole=True)
    check_range("seed", seed, 0, whole=True)
    if snr_db is not None:
        check_range("snr_db", snr_db, -300, 300, unit="dB")
    if not 0 < amplitudes[0] <= amplitudes[1]:
        raise SettingError("amplitudes", f"{amplitudes}", "a range of positive magnitudes")


def _check_limits(M: int, P: int, unknowns: int, antennas: int, counts: Sequence[int]) -> None:
    """Raises SettingError for sizes beyond what any receiver has; ``unknowns`` of a signal, ``counts`` of paths."""
    check_range("M", M, high=MOST_FREQUENCIES)
    check_range("targets and paths", sum(counts), high=_MOST_PATHS)
    numbers = M * P * max(unknowns, antennas * max(counts))
    check_range("numbers of the bases", numbers, high=MOST_NUMBERS, remedy="take fewer of M, P, J, antennas or paths")


def _check_spread(ratio: Fraction, messages: str) -> None:
    """Raises SettingError for a symbol ratio beside another spread of messages."""
    if ratio != 1 and messages != "shared":
        remedy = "leave one of them out"
        raise SettingError("symbol_ratio", f"{ratio} with {messages} messages", "messages of a pulse each", remedy)


def _ratio(symbol_ratio: float | Fraction) -> Fraction:
    """The symbol ratio as a fraction."""
    if not np.isfinite(float(symbol_ratio)):
        raise SettingError("symbol_ratio", f"{symbol_ratio}", _RATIOS)
    return Fraction(symbol_ratio).limit_denominator(64)


def _transmitters(targets: Several, paths: Several) -> tuple[list[int], list[int]]:
    """How many targets each radar has, and how many paths each communications channel."""
    radars, links = _counts(targets, "targets"), _counts(paths, "paths")
    if not radars + links:
        raise SettingError("targets and paths", "none of either", "at least one")
    return radars, links


def _counts(several: Several, name: str) -> list[int]:
    counts = np.atleast_1d(several)
    if np.any((counts < 0) | (counts != counts.astype(int))):
        raise SettingError(name, f"{several}", "whole numbers of 0 or more")
    return [int(count) for count in counts if count]


def _separation(separation: float | Sequence[float] | None, sizes: tuple[int, int, int]) -> list[float]:
    """Per coordinate, infinite where one has no resolution."""
    halves = [(sizes[0] - 1) // 2, sizes[1] // 2, sizes[2] // 2]
    halves = halves if sizes[2] > 1 else halves[:2]
    if separation is None:
        return [1 / half if half else np.inf for half in halves]
    given = [separation] * len(halves) if isinstance(separation, float | int) else list(separation)
    if len(given) != len(halves):
        raise SettingError("separation", f"{len(given)} numbers", f"{len(halves)}: delay, Doppler and, if any, angle")
    for one in given:
        check_range("separation", one, 0)
    return [one if half else np.inf for one, half in zip(given, halves, strict=True)]


def _channels(
    rng: np.random.Generator, radars: list[int], links: list[int], apart: list[float], absorbed: bool,
    amplitudes: tuple[float, float],
) -> list[tuple[str, Real, Complex]]:  # fmt: skip
    """Name, points ``(L, 3)`` and gains of every source; ``absorbed`` Dopplers of links tell no two points apart."""
    counts, of_links = radars + links, [apart[0], np.inf if absorbed else apart[1], *apart[2:]]
    separations = [apart] * len(radars) + [of_links] * len(links)
    points = [separated_points(rng, *one) for one in zip(counts, separations, strict=True)]
    full = [np.pad(one, ((0, 0), (0, 3 - one.shape[1]))) for one in points]
    gains = [_gains(rng, count, amplitudes) for count in counts]
    names = _numbered("radar", len(radars)) + _numbered("communications", len(links))
    return list(zip(names, full, gains, strict=True))


def separated_points(rng: np.random.Generator, count: int, separation: Sequence[float]) -> Real:
    """``(count, D)`` uniform points, any two of which differ by ``separation`` in at least one of D coordinates.

    Infinite separation: this coordinate may not tell two points apart.
    """
    apart = np.asarray(separation)
    for _ in range(_TRIES):
        points = rng.random((count, len(apart)))
        far = (distance(points[:, None], points[None]) >= apart).any(-1)
        if np.all(far | np.eye(count, dtype=bool)):
            return points
    listed = ", ".join(f"{one:.3g}" for one in separation)
    raise SettingError("separation", f"{listed} for {count} points", "points that fit on the torus", "lower either")


def _gains(rng: np.random.Generator, count: int, amplitudes: tuple[float, float]) -> Complex:
    phases = np.exp(2j * np.pi * rng.random(count))
    low, high = amplitudes
    return phases if low == high == 1 else phases * (low + (high - low) * rng.random(count))


def _numbered(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name} {index + 1}" for index in range(count)]


def overlaid(sources: Sequence[Source], truth: Sequence[Truth], antennas: int) -> Complex:
    """``(A, P, M)``, the samples of known channels and signals without noise."""
    shape = (antennas, *sources[0].rows.shape[:2])
    channels = [Channel.true(*both, shape) for both in zip(sources, truth, strict=True)]
    return np.sum([one.amplitudes @ one.columns().T for one in channels], axis=0).reshape(shape)


def noisy(y: Complex, snr_db: float | None, rng: np.random.Generator) -> tuple[Complex, float]:
    """The samples with noise at ``snr_db`` where it is given, and its standard deviation."""
    if snr_db is None:
        return y, 0.0
    sigma = float(np.sqrt(np.mean(np.abs(y) ** 2) * 10 ** (-snr_db / 10)))
    noise = rng.standard_normal(y.shape) + 1j * rng.standard_normal(y.shape)
    return y + sigma * noise / np.sqrt(2), sigma


def random_rows(rng: np.random.Generator, count: int, subspace: int, kind: str = "vandermonde") -> Complex:
    """``(count, subspace)``, rows ``bₙᴴ`` of a random basis.

    ``vandermonde``: ``[1, e^(−j2πs), …]`` with s uniform (Chi, "Guaranteed blind sparse spikes deconvolution via
    lifting and convex optimization", 2016); ``gaussian``: complex with unit variance; ``dft``: rows of the Fourier
    matrix in random order; ``sign``: ±1.
    """
    check_choice("basis", kind, BASES)
    if kind == "gaussian":
        real, imaginary = rng.standard_normal((count, subspace)), rng.standard_normal((count, subspace))
        return (real + 1j * imaginary) / np.sqrt(2)
    if kind == "sign":
        return rng.choice([-1.0, 1.0], (count, subspace)) + 0j
    columns = np.arange(subspace)
    if kind == "vandermonde":
        return np.exp(-2j * np.pi * np.outer(rng.random(count), columns))
    size = max(count, subspace)
    return np.exp(-2j * np.pi * np.outer(rng.permutation(size)[:count], columns) / size)


def unit_vector(rng: np.random.Generator, size: int) -> Complex:
    """A complex direction, uniform on the sphere."""
    vector = rng.standard_normal(size) + 1j * rng.standard_normal(size)
    return vector / np.linalg.norm(vector)


def message_source(
    rng: np.random.Generator, name: str, size: tuple[int, int], subspace: int, basis: str, kind: str,
    ratio: Fraction = Fraction(1),
) -> Source:  # fmt: skip
    """A communications transmitter in random bases; ``size`` is pulses and frequencies.

    Args:
        kind: ``block``, unknown coefficients of their own in every pulse (thesis equation 57); ``shared``, one
            coefficient vector in bases that change from pulse to pulse; ``dense``, J P coefficients that mix in all.
        ratio: other than 1, symbols that last so many intervals, in place of ``kind``. Longer ones (2, 3, …): pulses
            share a coefficient vector, each through its own part of the basis, and their Doppler can be seen. Shorter
            ones (1/2, 1/3, …): one interval holds several symbols, each in its own window of time, with coefficients
            of their own.

    Raises:
        SettingError: another kind; a ratio that is neither whole nor the inverse of a whole number.
    """
    pulses, frequencies = size
    check_choice("messages", kind, MESSAGES)
    if 1 not in (ratio.numerator, ratio.denominator) or ratio <= 0:
        raise SettingError("symbol_ratio", f"{ratio}", _RATIOS)
    if ratio == 1 and kind != "block":
        columns = subspace * (pulses if kind == "dense" else 1)
        rows = random_rows(rng, pulses * frequencies, columns, basis)
        return Source(name, rows.reshape(pulses, frequencies, columns), np.zeros(pulses, np.int64))
    if ratio >= 1:
        rows = np.stack([random_rows(rng, frequencies, subspace, basis) for _ in range(pulses)])
        return Source(name, rows, np.arange(pulses) // ratio.numerator)
    transform, windows = fourier(frequencies), np.array_split(np.arange(frequencies), ratio.denominator)
    if len(windows[-1]) < subspace:
        short = f"{len(windows)} symbols of {len(windows[-1])} samples"
        raise SettingError("symbol_ratio", short, f"{subspace} samples or more for {subspace} coefficients each")
    rows = np.stack([
        np.hstack([transform[:, one] @ random_rows(rng, len(one), subspace, basis) for one in windows])
        for _ in range(pulses)
    ])  # fmt: skip
    return Source(name, rows, np.arange(pulses))


def fourier(frequencies: int) -> Complex:
    """The unitary transform from the samples of a pulse interval to ``n = −⌊M/2⌋ …``, ``(M, M)``."""
    phases = np.outer(carriers(frequencies), np.arange(frequencies)) / frequencies
    return np.exp(-2j * np.pi * phases) / np.sqrt(frequencies)


def carriers(frequencies: int) -> Whole:
    """The numbers of the frequencies, ``n = −⌊M/2⌋ …``."""
    return np.arange(frequencies) - frequencies // 2


def _behind(rng: np.random.Generator, source: Source, basis: str, lag: float, late_samples: int) -> Source:
    """The source with its clock behind the receiver's, in samples beyond the cyclic prefix and by a lag."""
    if late_samples:
        before = random_rows(rng, source.rows.shape[1], source.subspace, basis)
        source = beyond_prefix(source, before, late_samples)
    return lagged(source, lag) if lag else source


def lagged(source: Source, lag: float) -> Source:
    """The source with its clock ``lag`` behind the receiver's, in units of a normalised delay.

    A lag nobody knows only adds to all delays of the source.
    """
    ramp = np.exp(-2j * np.pi * carriers(source.rows.shape[1]) * lag)
    return replace(source, rows=source.rows * ramp[:, None])


def beyond_prefix(source: Source, before: Complex, samples: int) -> Source:
    """The source so late that the first ``samples`` samples of each interval still hold the message before.

    The cyclic prefix covers no delay of this size, so the spectrum is no longer multiplied by a ramp: each interval is
    ``C Γ D_{p−1} v_{p−1} + (1 − C) Γ D_p v_p`` with the window C of the first samples and the cyclic shift Γ.

    Args:
        source: a communications source.
        before: ``(M, J)``, the basis of the message before the first interval; it gets coefficients of its own unless
            all pulses share theirs, as many as are heard.
        samples: lag in samples of the interval, 0 to M.

    Raises:
        SettingError: a lag of more than an interval; messages that some pulses share.
    """
    pulses, frequencies, _ = source.rows.shape
    check_range("late_samples", samples, 0, frequencies, unit="samples", whole=True)
    if source.messages not in (1, pulses):
        raise SettingError("late_samples", "messages of several pulses", "shared or block messages")
    transform, numbers = fourier(frequencies), np.arange(frequencies)
    shift = np.exp(-2j * np.pi * carriers(frequencies) * samples / frequencies)
    window = (transform * (numbers < samples).astype(float)) @ transform.conj().T * shift
    earlier = window @ np.concatenate([before[None], source.rows[:-1]])
    later = (np.diag(shift) - window) @ source.rows
    if source.messages == 1:
        return replace(source, rows=earlier + later)
    ends, begins = [_heard(earlier[0]), *earlier[1:]], [*later[:-1], _heard(later[-1])]
    starts = np.cumsum([0, *(rows.shape[1] for rows in (*ends, begins[-1]))])
    rows = np.zeros((pulses, frequencies, starts[-1]), complex)
    for pulse, pair in enumerate(zip(ends, begins, strict=True)):
        rows[pulse, :, starts[pulse] : starts[pulse + 2]] = np.hstack(pair)
    return replace(source, rows=rows, message=np.zeros(pulses, np.int64))


def _heard(rows: Complex) -> Complex:
    """The rows of a message that is only heard in part, with fewer columns where coefficients do not show."""
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    shown = int(np.sum(sizes > 1e-9 * np.linalg.norm(rows) + 1e-12))
    return rows if shown == rows.shape[1] else left[:, :shown] * sizes[:shown]
