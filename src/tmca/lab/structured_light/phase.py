"""From phase-shifted frames to wrapped phase, modulation and their noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import ShapeError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Phases:
    """What each frequency's frames say of each pixel, coarse to fine.

    ``phase`` ``(F, H, W)`` in (-π, π]; ``modulation`` and ``offset`` ``(F, H, W)`` and ``noise`` (the standard
    deviation of a frame) in digital numbers; ``std`` ``(F, H, W)`` of the phase, radians; ``misfit`` ``(F, H, W)``, the
    share of a pixel's variation over the steps that is no cosine (0 of three steps, which always are one).
    """

    phase: Array
    modulation: Array
    offset: Array
    misfit: Array
    noise: float
    std: Array


def measure_phases(frames: NDArray[Any], noise: float | None = None) -> Phases:
    """Fit ``offset + modulation cos(phase - 2πn/N)`` to N equidistant steps by least squares.

    ``phase = atan2(S, C)``, ``modulation = 2/N sqrt(S² + C²)`` with ``S, C = Σ I_n sin, cos(2πn/N)`` (synchronous
    detection: Bruning et al., Appl. Opt. 13, 1974).

    Args:
        frames: ``(F, N, H, W)`` digital numbers.
        noise: standard deviation of a frame; estimated from what the fits leave over without it.

    Raises:
        ShapeError: not four axes, or fewer than three steps.
    """
    if frames.ndim != 4 or frames.shape[1] < 3:
        raise ShapeError("frames", f"shape {frames.shape}", "(frequencies, steps ≥ 3, H, W)")
    steps = frames.shape[1]
    angle = 2 * np.pi * np.arange(steps) / steps
    values = frames.astype(np.float64)
    sine, cosine = (np.einsum("n,fnyx->fyx", wave(angle), values) for wave in (np.sin, np.cos))
    offset, modulation = values.mean(axis=1), 2 / steps * np.hypot(sine, cosine)
    variation = ((values - offset[:, None]) ** 2).sum(axis=1)
    left = np.maximum(variation - steps / 2 * modulation**2, 0)
    sigma = _noise(left, offset, steps) if noise is None else float(noise)
    misfit = left / np.maximum(variation, np.finfo(float).tiny)
    std = phase_std(modulation, sigma, steps)
    return Phases(np.arctan2(sine, cosine), modulation, offset, misfit, sigma, std)


def phase_std(modulation: NDArray[Any], noise: float, steps: int) -> Array:
    """``σ_φ = sqrt(2/N) σ / modulation`` in radians, infinite without modulation, for noise below the modulation.

    It is the Cramér–Rao bound of the phase of N equidistant samples in white noise; the fit reaches it.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt(2 / steps) * noise / np.asarray(modulation, dtype=np.float64))


def _noise(left: Array, offset: Array, steps: int) -> float:
    """Standard deviation from what the cosines leave over, and from offsets that should agree between frequencies.

    The median pixel speaks: pixels on edges or with moving shadows leave more over than noise.
    """
    from scipy.stats import chi2

    frequencies = len(left)
    freedom = frequencies * (steps - 3) + frequencies - 1
    if not freedom:
        return 0.0
    squares = left.sum(axis=0) + steps * ((offset - offset.mean(axis=0)) ** 2).sum(axis=0)
    return float(np.sqrt(np.median(squares) / chi2.median(freedom)))
