"""When the shutter runs against the aperture: from captures with one slot of each open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array

LARGEST_RESIDUAL = 0.1
"""Share of a whole slot's light that the fit may leave, root mean square."""
_STARTS = 4


@dataclass(frozen=True)
class Timing:
    """Slot j of the shutter runs from ``delay + ratio·j`` to ``delay + ratio·(j + 1)``, in slots of the aperture.

    Args:
        delay: of the shutter, slots; positive where it is late.
        ratio: duration of a slot of the shutter over one of the aperture.
        std: (2,) of both, from the fit.
        light: of a whole slot, units of the levels.
        residual: rms of what the fit leaves, as a share of ``light``.
        slots: K.
    """

    delay: float
    ratio: float
    std: Array
    light: float
    residual: float
    slots: int

    def overlap(self) -> Array:
        """(K, K) see ``slot_overlap``."""
        return slot_overlap(self.slots, self.delay, self.ratio)


def slot_overlap(slots: int, delay: float, ratio: float = 1.0) -> Array:
    """(K, K) time in which slot i of the aperture and slot j of the shutter are both on, in slots of the aperture."""
    aperture = np.arange(slots, dtype=np.float64)[:, None]
    shutter = delay + ratio * np.arange(slots, dtype=np.float64)
    end = np.minimum(aperture + 1, shutter + ratio)
    return np.clip(end - np.maximum(aperture, shutter), 0.0, None)


def measure_timing(levels: ArrayLike, *, source: object = "timing") -> Timing:
    """Fit delay, ratio and light to mean levels.

    Args:
        levels: (K, K) mean light above the dark with slot i of the aperture and slot j of the shutter alone open;
            NaN where it was not captured.
        source: named in errors.

    Raises:
        SettingError: not a square of two slots or more.
        DataError: hardly any light, or levels that no delay explains.
    """
    from scipy.optimize import least_squares

    seen = np.asarray(levels, dtype=np.float64)
    if seen.ndim != 2 or seen.shape[0] != seen.shape[1] or len(seen) < 2 or np.isfinite(seen).sum() < 4:
        raise SettingError("timing", f"levels of shape {seen.shape}", "(K, K) of two slots or more, four of them known")
    slots, known = len(seen), np.isfinite(seen)
    top = float(np.nanmax(seen))
    if not top > 0:
        raise DataError(source, "no light in any pair of slots", "light where both are open", "check both triggers")

    def residuals(values: Array) -> Array:
        return np.asarray((values[2] * slot_overlap(slots, values[0], values[1]) - seen / top)[known])

    tries = sorted(_starts(residuals, slots), key=lambda one: one[0])[:_STARTS]
    fits = [least_squares(residuals, start, xtol=1e-10, ftol=1e-12) for _, start in tries]
    found = min(fits, key=lambda fit: fit.cost)
    light = float(found.x[2] * top)
    residual = float(np.sqrt((found.fun**2).mean()) / max(found.x[2], 1e-12))
    if residual > LARGEST_RESIDUAL or not 0.2 < found.x[1] < 5:
        what = f"levels that no delay explains (a fit leaves {residual:.0%} of a slot's light)"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", "check which slots each capture had open")
    freedom = max(1, int(known.sum()) - 3)
    std = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))[:2] * float((found.fun**2).sum()) / freedom)
    return Timing(float(found.x[0]), float(found.x[1]), std, light, residual, slots)


def _starts(residuals: Callable[[Array], Array], slots: int) -> list[tuple[float, Array]]:
    """Misfit and place of a grid of delays and ratios: the levels have kinks, over which a fit does not climb."""
    grid = product(np.arange(-slots + 0.5, slots, 0.25), np.arange(0.6, 1.5, 0.1))
    places = [np.array([delay, ratio, 1 / max(1.0, ratio)]) for delay, ratio in grid]
    return [(float((residuals(place) ** 2).sum()), place) for place in places]
