"""What transmitters send: known subspaces, and how messages spread over the pulses of the receiver."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from tmca.dbd.coordinates import Complex, Whole
from tmca.dbd.model import Source
from tmca.errors import SettingError

BASES = ("vandermonde", "gaussian", "dft", "sign")
MESSAGES = ("shared", "block", "dense")


def random_rows(rng: np.random.Generator, count: int, subspace: int, kind: str = "vandermonde") -> Complex:
    """``count`` rows ``bₙᴴ`` of a random basis, ``(count, subspace)``.

    Args:
        rng: random numbers.
        count: rows.
        subspace: columns.
        kind: ``vandermonde``, ``[1, e^(−j2πs), …]`` with s uniform (Chi, "Guaranteed blind sparse spikes
            deconvolution via lifting and convex optimization", 2016); ``gaussian``, complex with unit variance;
            ``dft``, rows of the Fourier matrix in random order; ``sign``, ±1.

    Raises:
        SettingError: another kind.
    """
    columns = np.arange(subspace)
    if kind == "gaussian":
        real, imaginary = rng.standard_normal((count, subspace)), rng.standard_normal((count, subspace))
        return (real + 1j * imaginary) / np.sqrt(2)
    if kind == "vandermonde":
        return np.exp(-2j * np.pi * np.outer(rng.random(count), columns))
    if kind == "sign":
        return rng.choice([-1.0, 1.0], (count, subspace)) + 0j
    if kind == "dft":
        size = max(count, subspace)
        return np.exp(-2j * np.pi * np.outer(rng.permutation(size)[:count], columns) / size)
    raise SettingError("basis", f"{kind!r}", f"one of {', '.join(BASES)}")


def unit_vector(rng: np.random.Generator, size: int) -> Complex:
    """A complex direction, uniform on the sphere."""
    vector = rng.standard_normal(size) + 1j * rng.standard_normal(size)
    return vector / np.linalg.norm(vector)


def radar(rng: np.random.Generator, name: str, size: tuple[int, int], subspace: int, basis: str) -> Source:
    """The same unknown pulse in every interval (thesis equation 56a); ``size`` is pulses and frequencies."""
    rows = random_rows(rng, size[1], subspace, basis)
    return Source(name, rows, np.zeros(size[0], np.int64))


def messages(
    rng: np.random.Generator, name: str, size: tuple[int, int], subspace: int, basis: str, kind: str
) -> Source:
    """One message a pulse.

    Args:
        rng: random numbers.
        name: of the source.
        size: pulses P and frequencies M.
        subspace: J.
        basis: kind of random basis.
        kind: ``block``, unknown coefficients of their own in every pulse (thesis equation 57); ``shared``, one
            coefficient vector in bases that change from pulse to pulse; ``dense``, J P coefficients that mix in all.

    Raises:
        SettingError: another kind.
    """
    pulses, frequencies = size
    if kind == "block":
        blocks = [random_rows(rng, frequencies, subspace, basis) for _ in range(pulses)]
        return Source(name, np.stack(blocks), np.arange(pulses))
    if kind in ("shared", "dense"):
        columns = subspace * (pulses if kind == "dense" else 1)
        rows = random_rows(rng, pulses * frequencies, columns, basis)
        return Source(name, rows.reshape(pulses, frequencies, columns), np.zeros(pulses, np.int64))
    raise SettingError("messages", f"{kind!r}", f"one of {', '.join(MESSAGES)}")


def with_symbol_ratio(
    rng: np.random.Generator, name: str, size: tuple[int, int], subspace: int, basis: str, ratio: Fraction
) -> Source:
    """Messages whose symbols last ``ratio`` pulse intervals.

    Longer symbols (ratio 2, 3, …): pulses share a coefficient vector, each through its own part of the basis, and
    their Doppler can be seen. Shorter ones (1/2, 1/3, …): one interval holds several symbols, each in its own window
    of time, with coefficients of their own.

    Raises:
        SettingError: a ratio that is neither whole nor the inverse of a whole number.
    """
    pulses, frequencies = size
    if ratio >= 1 and ratio.denominator == 1:
        rows = np.stack([random_rows(rng, frequencies, subspace, basis) for _ in range(pulses)])
        return Source(name, rows, np.arange(pulses) // ratio.numerator)
    if ratio.numerator == 1:
        parts = ratio.denominator
        rows = np.stack([_symbols_in_window(rng, frequencies, parts, subspace, basis) for _ in range(pulses)])
        return Source(name, rows, np.arange(pulses))
    raise SettingError("symbol_ratio", f"{ratio}", "a whole number, or one over a whole number")


def fourier(frequencies: int) -> Complex:
    """The unitary transform from the samples of a pulse interval to ``n = −⌊M/2⌋ …``, ``(M, M)``."""
    phases = np.outer(carriers(frequencies), np.arange(frequencies)) / frequencies
    return np.exp(-2j * np.pi * phases) / np.sqrt(frequencies)


def carriers(frequencies: int) -> Whole:
    """The numbers of the frequencies, ``n = −⌊M/2⌋ …``."""
    return np.arange(frequencies) - frequencies // 2


def _symbols_in_window(rng: np.random.Generator, frequencies: int, parts: int, subspace: int, basis: str) -> Complex:
    """Rows of ``parts`` symbols after each other in one interval: ``(M, J parts)``."""
    transform = fourier(frequencies)
    windows = np.array_split(np.arange(frequencies), parts)
    if min(len(window) for window in windows) < subspace:
        short = f"{parts} symbols of {len(windows[-1])} samples"
        raise SettingError("symbol_ratio", short, f"{subspace} samples or more for {subspace} coefficients each")
    return np.hstack([transform[:, w] @ random_rows(rng, len(w), subspace, basis) for w in windows])


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
    if samples != int(samples) or not 0 <= samples <= frequencies:
        raise SettingError("late_samples", f"{samples}", f"a whole number up to {frequencies}, an interval")
    earlier, later = _windows(frequencies, samples)
    previous = np.concatenate([before[None], source.rows[:-1]])
    if source.messages == 1:
        return replace(source, rows=earlier @ previous + later @ source.rows)
    if source.messages != pulses:
        raise SettingError("late_samples", "messages of several pulses", "shared or block messages")
    rows = _overlapping(earlier @ previous, later @ source.rows)
    return replace(source, rows=rows, message=np.zeros(pulses, np.int64))


def _overlapping(before: Complex, after: Complex) -> Complex:
    """``(P, M, ·)`` rows of intervals that each hold the end of one message and the start of the next."""
    ends, begins = [_heard(before[0]), *before[1:]], [*after[:-1], _heard(after[-1])]
    sizes = [rows.shape[1] for rows in (*ends, begins[-1])]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    rows = np.zeros((*after.shape[:2], starts[-1]), complex)
    for pulse, pair in enumerate(zip(ends, begins, strict=True)):
        rows[pulse, :, starts[pulse] : starts[pulse + 2]] = np.hstack(pair)
    return rows


def _heard(rows: Complex) -> Complex:
    """The rows of a message that is only heard in part, with fewer columns where coefficients do not show."""
    left, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    shown = int(np.sum(sizes > 1e-9 * np.linalg.norm(rows) + 1e-12))
    return rows if shown == rows.shape[1] else left[:, :shown] * sizes[:shown]


def _windows(frequencies: int, samples: int) -> tuple[Complex, Complex]:
    """``C Γ`` and ``(1 − C) Γ`` on spectra."""
    transform = fourier(frequencies)
    shift = np.exp(-2j * np.pi * carriers(frequencies) * samples / frequencies)
    early = (np.arange(frequencies) < samples).astype(float)
    late = (transform * early) @ transform.conj().T * shift
    return late, np.diag(shift) - late
