"""When the shutter runs against the aperture: from captures with one slot of each open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array

LARGEST_RESIDUAL = 0.1
"""Share of a whole slot's light that the fit may leave, root mean square."""
_STARTS = 4
_CLEARLY = 0.8
"""Below this share of the other's misfit an exposure is taken for one that repeats."""


@dataclass(frozen=True)
class Timing:
    """Slot j of the shutter runs from ``delay + ratio·j`` to ``delay + ratio·(j + 1)``, in slots of the aperture.

    Args:
        delay: of the shutter, slots; positive where it is late.
        ratio: duration of a slot of the shutter over one of the aperture.
        std: (2,) of both, from the fit.
        light: of a whole slot, units of the levels.
        residual: rms of what the fit leaves in a slot, as a share of ``light``.
        slots: K.
        repeats: the exposure repeats, so that before its first aperture comes the last one; else all is shut.
    """

    delay: float
    ratio: float
    std: Array
    light: float
    residual: float
    slots: int
    repeats: bool = False

    def overlap(self) -> Array:
        """(K, K) see ``slot_overlap``."""
        return slot_overlap(self.slots, self.delay, self.ratio, self.repeats)


def slot_overlap(slots: int, delay: float, ratio: float = 1.0, repeats: bool = False) -> Array:
    """(K, K) time in which slot i of the aperture and slot j of the shutter are both on, in slots of the aperture.

    Where the exposure ``repeats``, the apertures of those before and after it count as well.
    """
    shutter = delay + ratio * np.arange(slots, dtype=np.float64)
    turns = range(int(shutter.min() // slots), int((shutter.max() + ratio) // slots) + 1) if repeats else (0,)
    found = np.zeros((slots, slots))
    for turn in turns:
        aperture = turn * slots + np.arange(slots, dtype=np.float64)[:, None]
        end = np.minimum(aperture + 1, shutter + ratio)
        found += np.clip(end - np.maximum(aperture, shutter), 0.0, None)
    return found


def measure_timing(levels: ArrayLike, *, source: object = "timing") -> Timing:
    """Fit delay, ratio and light to mean levels, of an exposure that repeats or of one alone, whichever leaves less.

    Args:
        levels: (K, K) mean light above the dark with slot i of the aperture and slot j of the shutter alone open;
            NaN where it was not captured.
        source: named in errors.

    Raises:
        SettingError: not a square of two slots or more.
        DataError: hardly any light, or levels that no delay explains.
    """
    seen = np.asarray(levels, dtype=np.float64)
    if seen.ndim != 2 or seen.shape[0] != seen.shape[1] or len(seen) < 2 or np.isfinite(seen).sum() < 4:
        raise SettingError("timing", f"levels of shape {seen.shape}", "(K, K) of two slots or more, four of them known")
    slots, known = len(seen), np.isfinite(seen)
    top = float(np.nanmax(seen))
    if not top > 0:
        raise DataError(source, "no light in any pair of slots", "light where both are open", "check both triggers")

    def misfit(repeats: bool) -> Callable[[Array], Array]:
        def residuals(values: Array) -> Array:
            return np.asarray((values[2] * slot_overlap(slots, values[0], values[1], repeats) - seen / top)[known])

        return residuals

    alone, again = (_best_fit(misfit(repeats), slots) for repeats in (False, True))
    repeats = again.cost < _CLEARLY * alone.cost
    found = again if repeats else alone
    light = float(found.x[2] * top)
    residual = float(np.sqrt((found.fun**2).mean() * slots) / max(found.x[2], 1e-12))
    if residual > LARGEST_RESIDUAL or not 0.2 < found.x[1] < 5:
        what = f"levels that no delay explains (a fit leaves {residual:.0%} of a slot's light)"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", "check which slots each capture had open")
    freedom = max(1, int(known.sum()) - 3)
    std = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))[:2] * float((found.fun**2).sum()) / freedom)
    delay = (found.x[0] + slots / 2) % slots - slots / 2 if repeats else found.x[0]
    return Timing(float(delay), float(found.x[1]), std, light, residual, slots, repeats)


def _best_fit(residuals: Callable[[Array], Array], slots: int) -> Any:
    from scipy.optimize import least_squares

    starts = sorted(_starts(residuals, slots), key=lambda one: one[0])[:_STARTS]
    fits = [least_squares(residuals, start, xtol=1e-10, ftol=1e-12) for _, start in starts]
    return min(fits, key=lambda fit: fit.cost)


def _starts(residuals: Callable[[Array], Array], slots: int) -> list[tuple[float, Array]]:
    """Misfit and place of a grid of delays and ratios: the levels have kinks, over which a fit does not climb."""
    grid = product(np.arange(-slots + 0.5, slots, 0.25), np.arange(0.6, 1.5, 0.1))
    places = [np.array([delay, ratio, 1 / max(1.0, ratio)]) for delay, ratio in grid]
    return [(float((residuals(place) ** 2).sum()), place) for place in places]
