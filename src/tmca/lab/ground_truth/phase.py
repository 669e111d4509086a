"""From phase-shifted frames to wrapped and to absolute phase."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError, ShapeError

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


_TURN = 2 * np.pi
_UNITS = 1000
"""Whole units of flow per unit of energy: scipy's flows are whole numbers."""
_MOVES = 200


def graph_cut_unwrap(phase: Array, inside: NDArray[np.bool_], start: Array, threshold: float = np.pi) -> Array:
    """Whole turns that make neighbours agree: the sum over neighbours of ``min(|difference|, threshold)²`` goes down.

    From ``start`` binary moves (some pixels a turn up, or a turn down) are found as minimum cuts until none lowers the
    energy: PUMA of Bioucas-Dias and Valadão, IEEE Trans. Image Process. 16, 2007. Without a threshold (``inf``) the
    energy is convex and the result its minimum; the truncation keeps true jumps, where pairs that no cut can express
    take the nearest energy above that one can (their majorise–minimise step). The cuts are
    `scipy.sparse.csgraph.maximum_flow`: the usual library for them, PyMaxflow, is under the GPL, which this package's
    licence cannot take in.

    Args:
        phase: ``(H, W)`` wrapped, radians.
        inside: the pixels to unwrap; the others keep ``start``.
        start: ``(H, W)`` an unwrapping to begin from; made congruent to ``phase`` first.
        threshold: of differences in radians; ``inf`` for none.

    Returns:
        ``(H, W)`` radians, congruent to ``phase`` inside.
    """
    first, second = _neighbours(inside)
    values = (phase + _TURN * np.round((start - phase) / _TURN))[inside]
    energy = _energy(values[first] - values[second], threshold).sum()
    quiet, up = 0, True
    for _ in range(_MOVES):
        moved = values + (_TURN if up else -_TURN) * _best_move(values, first, second, up, threshold)
        lower = _energy(moved[first] - moved[second], threshold).sum()
        if lower < energy * (1 - 1e-9) - 1e-9:
            values, energy, quiet = moved, lower, 0
        else:
            quiet, up = quiet + 1, not up
        if quiet == 2:
            break
    result = start.copy()
    result[inside] = values
    return result


def _energy(difference: Array, threshold: float) -> Array:
    return np.minimum(np.abs(difference), threshold) ** 2


def _neighbours(inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of pixels inside, side by side or one above the other, by their number among those inside."""
    number = np.cumsum(inside).reshape(inside.shape) - 1
    across, down = inside[:, 1:] & inside[:, :-1], inside[1:] & inside[:-1]
    first = np.concatenate([number[:, :-1][across], number[:-1][down]])
    return first, np.concatenate([number[:, 1:][across], number[1:][down]])


def _best_move(
    values: Array, first: NDArray[np.int64], second: NDArray[np.int64], up: bool, threshold: float
) -> NDArray[np.bool_]:
    """The pixels that a turn up (down) moves to the lowest energy, by a minimum cut."""
    step = _TURN if up else -_TURN
    difference = values[first] - values[second]
    stay = _energy(difference, threshold)
    alone, other = _energy(difference + step, threshold), _energy(difference - step, threshold)
    # a cut can express the pair only if both moves alone cost at least as much as none: raise the dearer one
    lack = np.maximum(2 * stay - alone - other, 0)
    alone, other = alone + np.where(alone >= other, lack, 0), other + np.where(alone >= other, 0, lack)
    # pair energy: stay + (alone - stay) x₁ + (stay - alone) x₂ + (alone + other - 2 stay) x₂ (1 - x₁)
    cost = np.bincount(first, alone - stay, len(values)).astype(np.float64)
    cost -= np.bincount(second, alone - stay, len(values))
    return _cut(cost, first, second, alone + other - 2 * stay)


def _cut(cost: Array, first: NDArray[np.int64], second: NDArray[np.int64], weight: Array) -> NDArray[np.bool_]:
    """The x in {0, 1} that minimises ``Σ cost x + Σ weight x₂ (1 - x₁)``: x is 1 on the sink's side."""
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    count = len(cost)
    source, sink, pixel = count, count + 1, np.arange(count)
    paid, won = cost > 0, cost < 0
    tails = np.concatenate([first, np.full(paid.sum(), source), pixel[won]])
    heads = np.concatenate([second, pixel[paid], np.full(won.sum(), sink)])
    flows = np.concatenate([weight, cost[paid], -cost[won]])
    room = coo_array((np.round(flows * _UNITS).astype(np.int32), (tails, heads)), shape=(count + 2,) * 2).tocsr()
    left = csr_array(room - maximum_flow(room, source, sink).flow)
    left.eliminate_zeros()
    reached = breadth_first_order(left, source, return_predecessors=False)
    moved = np.ones(count + 2, dtype=bool)
    moved[reached] = False
    return moved[:count]


Unwrapping = Literal["temporal", "spatial", "graph-cut"]
Rung = tuple[int, NDArray[np.int64]]
"""How many fringes, and the whole-numbered sum of the measured phases that has as many."""


def wrapped(phase: NDArray[np.float64]) -> Array:
    """The phase in [-π, π)."""
    return np.asarray((phase + np.pi) % _TURN - np.pi)


def ladder(fringes: tuple[int, ...]) -> list[Rung]:
    """From one fringe to the finest, by measured phases and, where one is missing, beats of neighbours (heterodyne).

    Raises:
        SettingError: the fringes do not lead to one fringe.
    """
    measured = [(f, np.eye(len(fringes), dtype=np.int64)[i]) for i, f in enumerate(fringes)]
    beats, rungs = list(measured), {f: c for f, c in measured}
    while 1 not in rungs and len(beats) > 1:
        beats = sorted(((g - f, d - c) for (f, c), (g, d) in pairwise(beats)), key=lambda rung: rung[0])
        rungs = {f: c for f, c in beats if f > 0} | rungs
        beats = [rung for rung in beats if rung[0] > 0]
    if 1 not in rungs:
        remedy = "add 1, or fringes whose differences lead to 1, such as 59,64,70"
        raise SettingError("fringes", ",".join(map(str, fringes)), "fringes that lead to one", remedy)
    return sorted(rungs.items())


def temporal_unwrap(phases: Phases, fringes: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Absolute phase of the finest fringes, rung by rung from one fringe (Huntley and Saldner, Appl. Opt. 32, 1993).

    Returns:
        The phase ``(H, W)`` in [0, 2π·finest), radians; the disagreement ``(H, W)``, the largest difference between a
        rung and what the one below it predicts, in standard deviations of that difference; and the largest of those
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


def _mixed(phases: Phases, coefficients: NDArray[np.int64]) -> tuple[Array, Array]:
    """Phase of a sum of measured phases, and its standard deviation."""
    with np.errstate(invalid="ignore"):
        variance = sum(float(c * c) * s**2 for c, s in zip(coefficients, phases.std, strict=True) if c)
    return wrapped(np.einsum("f,fyx->yx", coefficients.astype(float), phases.phase)), np.sqrt(np.asarray(variance))


def spatial_unwrap(phases: Phases, fringes: tuple[int, ...], inside: NDArray[np.bool_], how: Unwrapping) -> Array:
    """Absolute phase of the finest fringes by their own phase over connected pixels.

    ``"spatial"`` is scikit-image's `unwrap_phase` (Herráez et al., Appl. Opt. 41, 2002), ``"graph-cut"`` is PUMA on top
    of it (see `tmca.lab.ground_truth.phase`). Whole fringes are counted from the coarser frequencies, one
    number for each connected region: a jump of more than half a fringe inside a region is lost.

    Returns:
        ``(H, W)`` radians, NaN where a pixel is not ``inside``.

    Raises:
        SettingError: see `ladder`.
        DataError: no pixel inside.
    """
    from scipy.ndimage import label
    from skimage.restoration import unwrap_phase

    ladder(fringes)
    if not inside.any():
        raise DataError("phase", "no pixel with fringes", "some", "check the light and the order of frames")
    finest = phases.phase[-1]
    unwrapped = unwrap_phase(np.ma.masked_array(finest, ~inside), rng=0)
    relative = np.asarray(np.ma.filled(unwrapped, 0.0), dtype=np.float64)
    if how == "graph-cut":
        relative = graph_cut_unwrap(finest, inside, relative)
    coarse, _, _ = temporal_unwrap(phases, fringes)
    regions, count = label(inside)
    for region in range(1, count + 1):
        here = regions == region
        relative[here] += _TURN * np.round(np.median(coarse[here] - relative[here]) / _TURN)
    return np.where(inside, relative, np.nan)
