"""Coarse to fine: shifts tried one by one, the best of them climbed, then the best of these in all coordinates, with
less and less noise and more of the frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tmca.operators.block_layout import Places
from tmca.registration.evidence import MaskEvidence
from tmca.registration.placement import NAMES

REACH, _STEP = 2.4, 0.4
"""Pixels along each axis that shifts are tried up to, and from one to the next."""
_SCALES = np.array([0.1, 0.1, 0.15, 0.15, 0.15, 0.15, 0.2, 0.1])
"""Changes that matter about as much."""
_MOST = np.array([2.8, 2.8, 2.0, 2.0, 1.0, 1.0, 4.0, 1.5])
_LEAST = np.append(-_MOST[:-1], 0.0)
Progress = Callable[[float], None]


class Stage(NamedTuple):
    """One climb.

    Args:
        noise: least standard deviation of the snapshot that is reckoned with.
        share: of the frame's half side that blocks lie within.
        cells: parts along each side, each with a block.
        free: coordinates that are moved.
        steps: of L-BFGS at most.
        shift: pixels that a shift may move.
    """

    noise: float
    share: float
    cells: int
    free: tuple[int, ...]
    steps: int
    shift: float


_ALL = tuple(range(len(NAMES)))
_FIRST = (Stage(0.1, 0.3, 3, (0, 1, 6), 4, 0.4), Stage(0.1, 0.55, 4, (0, 1, 2, 3, 6), 6, 0.4))
LAST = Stage(0.0, 1.0, 6, _ALL, 12, 0.15)
_THEN = (Stage(0.03, 1.0, 5, _ALL, 8, 0.4), LAST)
_STARTS = 4
"""Shifts that are climbed: under a dispersion and a rotation that are not yet found, the most probable one may lie
beside the mask's place, with the right one next to it."""
ELSEWHERE = ((5, 7), (-7, 5), (11, -3), (-3, -11), (9, 9), (-8, -6), (-10, 8), (6, -9))
"""Pixels down and right to places where the mask does not lie."""
_STANDS_OUT = 0.8
"""Share of the signed ranks of blocks that have to be for the place where the search ended: in trials 1 behind right
masks, 0.54 at most of noise and behind other masks."""
_CENTRE = Stage(0.05, 0.25, 3, (), 0, 0.0)
_LEAST_GAIN = 1e-5
"""Relative, of log evidence: a step that gains less ends a climb, a tenth of a standard deviation short at most."""
_FEWEST = 6
"""Blocks, below which none of them tells a place from another."""


class Climbed(NamedTuple):
    """Where a search ended.

    Args:
        vector: (8,) as `NAMES` say.
        converged: the place stands out, and is within the limits of the search.
    """

    vector: np.ndarray
    converged: bool


def search(evidence: MaskEvidence, progress: Progress | None = None) -> Climbed:
    """The place of the mask under which a snapshot is most probable."""
    report = progress or (lambda share: None)
    half = max(evidence.size) / 2
    centre, *parts = [evidence.among(stage.share * half, stage.cells) for stage in (_CENTRE, *_FIRST, *_THEN)]
    if not centre or min(map(len, parts)) < 1 or len(parts[-1]) < _FEWEST:
        return Climbed(np.zeros(len(NAMES)), False)
    starts = best_shifts(evidence, centre, report)
    vector = best_climbed(evidence, starts, parts[: len(_FIRST)], report)
    for done, (stage, blocks) in enumerate(zip(_THEN, parts[len(_FIRST) :], strict=True), start=1):
        vector = climb(evidence, vector, blocks, stage)
        report(0.6 + 0.3 * done / len(_THEN))
    return judged(evidence, vector, parts[-1])


def judged(evidence: MaskEvidence, vector: np.ndarray, blocks: Places) -> Climbed:
    """The end of a climb, and whether it is a place of the mask."""
    inside = bool((np.abs(vector) < 0.98 * _MOST).all())
    return Climbed(vector, inside and standing(evidence, vector, blocks) > _STANDS_OUT)


def gain_over_drawn(evidence: MaskEvidence, vector: np.ndarray, blocks: Places) -> float:
    """Of log evidence over the mask as it was drawn, a block."""
    drawn = np.zeros(len(NAMES))
    drawn[6] = vector[6]
    return (evidence.value(vector, blocks) - evidence.value(drawn, blocks)) / len(blocks)


def standing(evidence: MaskEvidence, vector: np.ndarray, blocks: Places) -> float:
    """Share of the signed ranks (Wilcoxon) of blocks whose evidence is larger than at each of the places elsewhere.

    Evidence alone says little: under a prior that fits badly a wrong mask may gain much in a few bright blocks. The
    best place elsewhere is the rival of each block, as the place was the best of many, too.
    """
    others = [evidence.each(vector + np.pad(away, (0, len(vector) - 2)), blocks) for away in ELSEWHERE]
    gains = evidence.each(vector, blocks) - np.max(others, axis=0)
    ranks = np.abs(gains).argsort().argsort() + 1
    return float(ranks[gains > 0].sum() / ranks.sum())


def best_shifts(evidence: MaskEvidence, blocks: Places, report: Progress) -> np.ndarray:
    """(N, 8): the most probable of shifts in steps, the best first."""
    steps = np.arange(-REACH, REACH + _STEP / 2, _STEP)
    shifts = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    vectors = np.pad(shifts, ((0, 0), (0, len(NAMES) - 2)))
    values = np.empty(len(vectors))
    for at, vector in enumerate(vectors):
        values[at] = evidence.value(vector, blocks, _CENTRE.noise)
        report(0.3 * (at + 1) / len(vectors))
    return vectors[values.argsort()[::-1][:_STARTS]]


def best_climbed(evidence: MaskEvidence, starts: np.ndarray, parts: Sequence[Places], report: Progress) -> np.ndarray:
    """The most probable place that the first stages lead to from several shifts."""
    ends = []
    for done, vector in enumerate(starts, start=1):
        for stage, blocks in zip(_FIRST, parts, strict=True):
            vector = climb(evidence, vector, blocks, stage)
        ends.append((evidence.value(vector, parts[-1], _FIRST[-1].noise), vector))
        report(0.3 + 0.3 * done / len(starts))
    return max(ends, key=lambda end: end[0])[1]


def climb(evidence: MaskEvidence, vector: np.ndarray, blocks: Places, stage: Stage) -> np.ndarray:
    """A maximum near a vector, in the coordinates of a stage."""
    from scipy.optimize import minimize

    free = list(stage.free)
    scales = _SCALES[free]

    def cost(part: np.ndarray) -> tuple[float, np.ndarray]:
        whole = vector.copy()
        whole[free] = part * scales
        value, slope = evidence.slope(whole, blocks, stage.noise)
        return -value / len(blocks), -slope[free] * scales / len(blocks)

    reach = np.where(np.arange(len(vector)) < 2, stage.shift, np.inf)
    low, high = (np.maximum(_LEAST, vector - reach), np.minimum(_MOST, vector + reach))
    bounds = np.stack([low[free] / scales, high[free] / scales], 1)
    options = {"maxiter": stage.steps, "maxfun": stage.steps + 4, "ftol": _LEAST_GAIN, "maxls": 8}
    ended = minimize(cost, vector[free] / scales, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    found = vector.copy()
    found[free] = ended.x * scales
    return found


def deviations(evidence: MaskEvidence, vector: np.ndarray, blocks: Places) -> np.ndarray:
    """(8,) standard deviations from the second derivatives at a maximum, by differences: 0 of what is at its limit, NaN
    where there is no maximum."""
    free = (vector > _LEAST) & (vector < _MOST)
    steps, here = 0.05 * _SCALES, evidence.slope(vector, blocks)[1]
    ahead = np.array([evidence.slope(vector + away, blocks)[1] for away in np.diag(steps)[free]])
    bends = ((ahead - here) / steps[free, None])[:, free]
    values, vectors = np.linalg.eigh(-(bends + bends.T) / 2)
    std = np.zeros(len(vector))
    std[free] = np.sqrt((vectors**2 / values).sum(1)) if values.min() > 0 else np.nan
    return std
