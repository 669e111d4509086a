"""Random problems of the normalised model, thesis equation (58), with everything about them known."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from tmca.dbd.atoms import Atoms
from tmca.dbd.coordinates import Complex, separated_points
from tmca.dbd.messages import beyond_prefix, lagged, radar, random_rows, unit_vector, with_symbol_ratio
from tmca.dbd.messages import messages as message_source
from tmca.dbd.model import Problem, Source, Truth
from tmca.errors import SettingError

Several = int | Sequence[int]


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

    Returns:
        The problem; its noise level is known to it.

    Raises:
        SettingError: sizes that are not positive, points that do not fit, SNR that is no number.
    """
    _check({"M": M, "P": P, "J": J, "antennas": antennas}, seed, snr_db, amplitudes)
    radars, links = _counts(targets, "targets"), _counts(paths, "paths")
    if not radars + links:
        raise SettingError("targets and paths", "none of either", "at least one")
    ratio = _ratio(symbol_ratio)
    if ratio != 1 and messages != "shared":
        remedy = "leave one of them out"
        raise SettingError("symbol_ratio", f"{ratio} with {messages} messages", "messages of a pulse each", remedy)
    rng = np.random.default_rng(seed)
    blind_doppler = [False] * len(radars) + [_absorbs_doppler(messages, ratio, P) and not late_samples] * len(links)
    apart = _separation(separation, (M, P, antennas))
    points = [
        separated_points(rng, count, [apart[0], np.inf if blind else apart[1], *apart[2:]])
        for count, blind in zip(radars + links, blind_doppler, strict=True)
    ]
    gains = [_gains(rng, count, amplitudes) for count in radars + links]
    sources, truth = [], []
    names = _numbered("radar", len(radars)) + _numbered("communications", len(links))
    for index, name in enumerate(names):
        if index < len(radars):
            source = radar(rng, name, (P, M), J, basis)
        else:
            source = _link(rng, name, (P, M), J, basis, messages, ratio, lag, late_samples)
        waveform = unit_vector(rng, source.unknowns)
        if known_waveforms:
            source, waveform = source.with_signal(waveform), np.ones(1, complex)
        full = np.pad(points[index], ((0, 0), (0, 3 - points[index].shape[1])))
        sources.append(source)
        truth.append(Truth(full, gains[index], waveform))
    return overlaid(tuple(sources), tuple(truth), antennas, snr_db, rng)


def overlaid(
    sources: tuple[Source, ...], truth: tuple[Truth, ...], antennas: int, snr_db: float | None, rng: np.random.Generator
) -> Problem:
    """The samples of known channels and signals, with noise at ``snr_db`` where it is given."""
    shape = (antennas, *sources[0].rows.shape[:2])
    y = np.zeros(shape, complex)
    for source, channel in zip(sources, truth, strict=True):
        atoms = Atoms(source, shape, every_axis=True)
        signals = atoms.signals(atoms.seen(channel.points), channel.waveform)
        y += (channel.amplitudes @ signals).reshape(shape)
    sigma = 0.0
    if snr_db is not None:
        sigma = float(np.sqrt(np.mean(np.abs(y) ** 2) * 10 ** (-snr_db / 10)))
        y = y + sigma * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    return Problem(y, sources, sigma, truth)


def _check(sizes: dict[str, int], seed: int, snr_db: float | None, amplitudes: tuple[float, float]) -> None:
    for name, size in (*sizes.items(), ("seed", seed)):
        least = 0 if name == "seed" else 1
        if not isinstance(size, int | np.integer) or size < least:
            raise SettingError(name, f"{size}", f"a whole number of {least} or more")
    if snr_db is not None and not (isinstance(snr_db, int | float) and abs(snr_db) <= 300):
        raise SettingError("snr_db", f"{snr_db}", "decibels from -300 to 300, or None for no noise")
    if not 0 < amplitudes[0] <= amplitudes[1]:
        raise SettingError("amplitudes", f"{amplitudes}", "a range of positive magnitudes")


def _counts(several: Several, name: str) -> list[int]:
    counts = np.atleast_1d(several)
    if np.any((counts < 0) | (counts != counts.astype(int))):
        raise SettingError(name, f"{several}", "whole numbers of 0 or more")
    return [int(count) for count in counts if count]


def _ratio(given: float | Fraction) -> Fraction:
    if not np.isfinite(float(given)):
        raise SettingError("symbol_ratio", f"{given}", "a whole number, or one over a whole number")
    return Fraction(given).limit_denominator(64)


def _absorbs_doppler(messages: str, ratio: Fraction, pulses: int) -> bool:
    return ratio < 1 or (ratio == 1 and messages == "block") or pulses == 1


def _separation(separation: float | Sequence[float] | None, sizes: tuple[int, int, int]) -> list[float]:
    M, P, antennas = sizes
    halves = [(M - 1) // 2, P // 2, antennas // 2]
    halves = halves if antennas > 1 else halves[:2]
    if separation is None:
        return [1 / half if half else np.inf for half in halves]
    given = [separation] * len(halves) if isinstance(separation, float | int) else list(separation)
    if min(given) < 0 or not np.all(np.isfinite(given)):
        raise SettingError("separation", f"{separation}", "distances of zero or more")
    if len(given) != len(halves):
        raise SettingError("separation", f"{len(given)} numbers", f"{len(halves)}: delay, Doppler and, if any, angle")
    return [one if half else np.inf for one, half in zip(given, halves, strict=True)]


def _gains(rng: np.random.Generator, count: int, amplitudes: tuple[float, float]) -> Complex:
    phases = np.exp(2j * np.pi * rng.random(count))
    low, high = amplitudes
    return phases if low == high == 1 else phases * (low + (high - low) * rng.random(count))


def _numbered(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name} {index + 1}" for index in range(count)]


def _link(
    rng: np.random.Generator, name: str, size: tuple[int, int], J: int, basis: str, kind: str, ratio: Fraction,
    lag: float, late: int,
) -> Source:  # fmt: skip
    if ratio == 1:
        source = message_source(rng, name, size, J, basis, kind)
    else:
        source = with_symbol_ratio(rng, name, size, J, basis, ratio)
    if late:
        source = beyond_prefix(source, random_rows(rng, size[1], source.subspace, basis), late)
    return lagged(source, lag) if lag else source
