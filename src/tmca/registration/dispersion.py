"""The dispersion under which a snapshot is most probable, behind a mask that is nearly in place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tmca.cameras import Snapshot
from tmca.codes import Codes
from tmca.operators.block_layout import Places
from tmca.optics.spectral import on_columns
from tmca.registration.evidence import MaskEvidence
from tmca.registration.search import LAST, Climbed, climb, judged

MOST_DISPERSION = 0.015
"""Relative error of the dispersion that is looked for."""
_CELLS = 3
"""Parts of the frame along each side, each with a block, that dispersions are tried on."""
_ROUNDS, _NEARBY = 2, 0.002
"""Turns of mask and dispersion after the first, and how far a dispersion may move in one."""
_LEAST_DISPLACEMENT = 0.02
"""Pixels: a dispersion whose outermost bands move less is left as it is, one tap a band instead of two."""
_LEAST, _BEND = 1e-4, 5e-4
"""Relative error from which a side is tried, and the step of second differences."""


def with_dispersion(
    snapshot: Snapshot[Any], prior: Any, climbed: Climbed, evidence: MaskEvidence
) -> tuple[float, Climbed, MaskEvidence]:
    """The most probable dispersion for a mask that is nearly in place, and the mask behind it; the dispersion as it was
    drawn where the snapshot does not tell it, which ends at the limit or moves the mask to no place."""
    half, vector = max(evidence.size) / 2, climbed.vector
    few, many = evidence.among(half, _CELLS), evidence.among(LAST.share * half, LAST.cells)
    sides = [_stretched(snapshot, prior, vector, few, side, (0, MOST_DISPERSION)) for side in (-1, 1)]
    error = max(sides)[1]
    for _ in range(_ROUNDS):
        if abs(error) * np.ptp(snapshot.camera.dispersion.displacement) / 2 < _LEAST_DISPLACEMENT:
            return 1.0, climbed, evidence
        other = scaled(snapshot, prior, 1 + error)
        vector = climb(other, vector, many, LAST)
        around = (abs(error) - _NEARBY, min(abs(error) + _NEARBY, MOST_DISPERSION))
        error = _stretched(snapshot, prior, vector, many, int(np.sign(error)), around)[1]
    if abs(error) >= 0.98 * MOST_DISPERSION:
        return 1.0, climbed, evidence
    best = scaled(snapshot, prior, 1 + error)
    ended = judged(best, vector, many)
    return (1 + error, ended, best) if ended.converged else (1.0, climbed, evidence)


def _stretched(
    snapshot: Snapshot[Any], prior: Any, vector: np.ndarray, blocks: Places, side: int, within: tuple[float, float]
) -> tuple[float, float]:
    """Gain and relative error of the most probable dispersion that is smaller (-1) or larger (1) than was drawn.

    Both sides begin at their own zero: wider dispersions leave other measurements complete.
    """
    from scipy.optimize import minimize_scalar

    def cost(error: float) -> float:
        other = scaled(snapshot, prior, 1 + side * error)
        return -other.value(vector, blocks) / other.solver.model.measurements

    options, bounds = {"xatol": 1e-4, "maxiter": 6}, (max(_LEAST, within[0]), within[1])
    best = minimize_scalar(cost, bounds=bounds, method="bounded", options=options)
    return cost(_LEAST) - float(best.fun), side * float(best.x)


def dispersion_std(snapshot: Snapshot[Any], prior: Any, vector: np.ndarray, blocks: Places, error: float) -> float:
    """Standard deviation of a relative error of the dispersion while the mask stays where it is, by second differences
    on its side, no nearer to zero than their step; NaN where there is no maximum."""
    side, middle = int(np.sign(error)), max(abs(error), _LEAST + _BEND)
    around = [scaled(snapshot, prior, 1 + side * (middle + away)) for away in (-_BEND, 0.0, _BEND)]
    count = around[1].solver.model.measurements
    before, here, after = (count * one.value(vector, blocks) / one.solver.model.measurements for one in around)
    bend = (2 * here - before - after) / _BEND**2
    return 1 / math.sqrt(bend) if bend > 0 else math.nan


def scaled(snapshot: Snapshot[Any], prior: Any, factor: float) -> MaskEvidence:
    """The evidence where bands lie so many times as far from their middle."""
    drawn = snapshot.camera.dispersion
    bands = drawn.scaled(factor)
    first, width = drawn.origin - bands.origin, snapshot.camera.size[1] + bands.extent
    aperture, shutter = snapshot.camera.codes()
    camera = snapshot.camera.replace(dispersion=bands, codes=Codes(aperture, on_columns(shutter, first, width)))
    return MaskEvidence(camera, on_columns(snapshot.values, first, width), prior)
