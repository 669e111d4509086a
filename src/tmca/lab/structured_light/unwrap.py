"""From wrapped to absolute phase: over frequencies (temporal), or over neighbours (spatial, graph cut)."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError
from tmca.lab.structured_light.graph_cut import graph_cut_unwrap
from tmca.lab.structured_light.phase import Array, Phases

Unwrapping = Literal["temporal", "spatial", "graph-cut"]
Rung = tuple[int, NDArray[np.int64]]
"""How many fringes, and the whole-numbered sum of the measured phases that has as many."""
_TURN = 2 * np.pi


def wrapped(phase: NDArray[np.float64]) -> Array:
    """The phase in [-π, π)."""
    return np.asarray((phase + np.pi) % _TURN - np.pi)


def ladder(fringes: tuple[int, ...]) -> list[Rung]:
    """From one fringe to the finest, by measured phases and, where one is missing, beats of neighbours (heterodyne).

    Raises:
        SettingError: the fringes do not lead to one fringe.
    """
    own = [(f, np.eye(len(fringes), dtype=np.int64)[i]) for i, f in enumerate(fringes)]
    beats, found = list(own), {f: c for f, c in own}
    while 1 not in found and len(beats) > 1:
        beats = sorted(((g - f, d - c) for (f, c), (g, d) in pairwise(beats)), key=lambda rung: rung[0])
        found = {f: c for f, c in beats if f > 0} | found
        beats = [rung for rung in beats if rung[0] > 0]
    if 1 not in found:
        remedy = "add 1, or fringes whose differences lead to 1, such as 59,64,70"
        raise SettingError("fringes", ",".join(map(str, fringes)), "fringes that lead to one", remedy)
    return sorted(found.items())


def temporal_unwrap(phases: Phases, fringes: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Absolute phase of the finest fringes, rung by rung from one fringe (Huntley and Saldner, Appl. Opt. 32, 1993).

    Args:
        phases: of the frequencies ``fringes``.
        fringes: over the projector's extent, coarse to fine.

    Returns:
        The phase ``(H, W)`` in [0, 2π·finest), radians; the disagreement ``(H, W)``, the largest difference between a
        rung and what the one below it foretells, in standard deviations of that difference; and the largest of those
        standard deviations ``(H, W)``, radians: fringes are numbered wrongly where it comes near half a turn.

    Raises:
        SettingError: see `ladder`.
    """
    rungs = ladder(fringes)
    (_, first), above = rungs[0], rungs[1:]
    absolute, std = _mixed(phases, first)
    absolute, below = absolute % _TURN, 1
    worst, risk = np.zeros(absolute.shape), np.zeros(absolute.shape)
    for count, coefficients in above:
        phase, own_std = _mixed(phases, coefficients)
        ratio = count / below
        off = wrapped(phase - ratio * absolute)
        expected = np.hypot(own_std, ratio * std)
        risk = np.maximum(risk, expected)
        worst = np.maximum(worst, np.abs(off) / np.maximum(expected, np.finfo(float).tiny))
        # one fringe that starts again at the projector's edge is the same phase
        absolute, std, below = (ratio * absolute + off) % (_TURN * count), own_std, count
    return absolute, worst, risk


def rung_offsets(phases: Phases, fringes: tuple[int, ...], inside: NDArray[np.bool_]) -> list[tuple[int, complex]]:
    """How each rung agrees with the one below: mean of ``exp(i difference)``, which is near 1 for frames in order.

    Rungs too far above the one below for noise to leave a mean are left out.
    """
    offsets, rungs = [], ladder(fringes)
    (absolute, std), below = _mixed(phases, rungs[0][1]), 1
    for count, coefficients in rungs[1:]:
        phase, own_std = _mixed(phases, coefficients)
        off = wrapped(phase - count / below * (absolute % (_TURN * below)))
        if np.median(np.hypot(own_std, count / below * std)[inside]) < 1:
            offsets.append((count, complex(np.exp(1j * off[inside]).mean())))
        absolute, std, below = count / below * (absolute % (_TURN * below)) + off, own_std, count
    return offsets


def _mixed(phases: Phases, coefficients: NDArray[np.int64]) -> tuple[Array, Array]:
    """Phase of a sum of measured phases, and its standard deviation."""
    with np.errstate(invalid="ignore"):
        variance = sum(float(c * c) * s**2 for c, s in zip(coefficients, phases.std, strict=True) if c)
    return wrapped(np.einsum("f,fyx->yx", coefficients.astype(float), phases.phase)), np.sqrt(np.asarray(variance))


def spatial_unwrap(phases: Phases, fringes: tuple[int, ...], inside: NDArray[np.bool_], how: Unwrapping) -> Array:
    """Absolute phase of the finest fringes by their own phase over connected pixels.

    ``"spatial"`` is scikit-image's `unwrap_phase` (Herráez et al., Appl. Opt. 41, 2002), ``"graph-cut"`` is PUMA on top
    of it (see `tmca.lab.structured_light.graph_cut`). Whole fringes are counted from the coarser frequencies, one
    number for each connected region: a jump of more than half a fringe inside a region is lost.

    Args:
        phases: of the frequencies ``fringes``.
        fringes: coarse to fine.
        inside: ``(H, W)``, the pixels with a phase.
        how: ``"spatial"`` or ``"graph-cut"``.

    Returns:
        ``(H, W)`` radians, NaN outside.

    Raises:
        SettingError: see `ladder`.
        DataError: no pixel inside.
    """
    from scipy.ndimage import label

    ladder(fringes)
    if not inside.any():
        raise DataError("phase", "no pixel with fringes", "some", "check the light and the order of frames")
    finest = phases.phase[-1]
    relative = _over_neighbours(finest, inside)
    if how == "graph-cut":
        relative = graph_cut_unwrap(finest, inside, relative)
    coarse, _, _ = temporal_unwrap(phases, fringes)
    regions, count = label(inside)
    for region in range(1, count + 1):
        here = regions == region
        relative[here] += _TURN * np.round(np.median(coarse[here] - relative[here]) / _TURN)
    return np.where(inside, relative, np.nan)


def _over_neighbours(phase: Array, inside: NDArray[np.bool_]) -> Array:
    from skimage.restoration import unwrap_phase

    found = unwrap_phase(np.ma.masked_array(phase, ~inside), rng=0)
    return np.asarray(np.ma.filled(found, 0.0), dtype=np.float64)
