"""Captures of two pairs of slots under each other's names: levels that a timing explains once they are exchanged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from tmca.errors import DataError
from tmca.lab.calibration.arrays import Array

Misfit = Callable[[Array, bool], Callable[[Array], Array]]
Pair = tuple[int, int]
_FEWER, _FREE, _FEWER_OF_FEW = 25.0, 5, 200.0
"""Times by which the fit's sum of squares falls where an exchange is what was wrong: a fifth of the residual. Where no
more than `_FREE` levels are left over, as of three slots, they can be close to a fit by chance: of lamps that flicker
by 3 % an exchange made it fall up to 100 times in 190 exposures."""
_FITTED, _MOST = 4, 9.0
"""Numbers that are fitted, and times the residual, were it that of two levels alone, up to which levels that differ are
tried: the fitted numbers do not hide more."""

_TRIED = 16
"""Levels that are tried, those of which the fit leaves most: of many levels a few that are exchanged hardly bend it."""


def check_exchanged(levels: Array, misfit: Misfit, starts: Sequence[Array], left: Array, source: object) -> None:
    """Refuse levels of which two are explained better, by far, in each other's place.

    Args:
        levels: (K, K) mean light, NaN where it was not captured; more than four.
        misfit: the residuals of such levels as a function of what is fitted, of an exposure alone or one that repeats.
        starts: from which to fit.
        left: (n,) what the fit leaves of the n levels that are known, row by row.
        source: named in errors.

    Raises:
        DataError: naming both pairs of slots.
    """
    known: list[Pair] = [(int(i), int(j)) for i, j in np.argwhere(np.isfinite(levels))]
    fewer = _FEWER if len(known) - _FITTED > _FREE else _FEWER_OF_FEW
    usual, enough = float(np.sqrt((left**2).mean())), float((left**2).sum()) / 2 / fewer
    most = _MOST * usual * float(np.sqrt(len(known) / 2)) * len(known) / (len(known) - _FITTED)
    worst = sorted(np.argsort(np.abs(left))[-_TRIED:])
    for one, other in combinations([known[n] for n in worst], 2):
        if not usual < abs(levels[one] - levels[other]) < most:
            continue
        changed = levels.copy()
        changed[one], changed[other] = levels[other], levels[one]
        if _least(changed, misfit, starts, enough) < enough:
            names = [f"aperture_{i}_shutter_{j}" for i, j in (one, other)]
            found = f"levels that a delay explains only with {names[0]} and {names[1]} exchanged"
            raise DataError(source, found, "frames under their own names", "check which slots each capture had open")


def _least(levels: Array, misfit: Misfit, starts: Sequence[Array], enough: float) -> float:
    """Half of the sum of squares that the best fit leaves, or one that is enough."""
    from scipy.optimize import least_squares

    bounds, best = ([-np.inf, -np.inf, -np.inf, 0.0], [np.inf, np.inf, np.inf, 1.0]), np.inf
    for repeats in (False, True):
        residuals = misfit(levels, repeats)
        for start in starts:
            fit = least_squares(residuals, start, bounds=bounds, xtol=1e-6, ftol=1e-6, max_nfev=25)
            best = min(best, float(fit.cost))
            if best < enough:
                return best
    return best
