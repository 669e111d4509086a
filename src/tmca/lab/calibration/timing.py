"""When the shutter runs against the aperture: from captures with one slot of each open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.fitting import fit_std
from tmca.lab.frames import Array

LARGEST_RESIDUAL = 0.1
"""Share of a whole slot's light that the fit may leave, root mean square."""
LARGEST_LEAKAGE = 0.5
LARGEST_STD = 0.05
"""Slots by which the delay, and share by which the duration of a slot, may be uncertain: light that a calibrated
camera would take for that of a neighbouring slot, half of what the fit may leave."""
_PULL = 1e-2
"""Weight, beside the levels, of the leakage and of a ratio other than 1: it decides where levels have many causes."""
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
        residual: rms of what the fit leaves in a slot, as a share of the largest level.
        slots: K.
        repeats: the exposure repeats, so that before its first aperture comes the last one; else all is shut.
        leakage: share of the light that a closed shutter records.
        leakage_std: its standard deviation, from the fit and from that of the aperture's leakage.
    """

    delay: float
    ratio: float
    std: Array
    light: float
    residual: float
    slots: int
    repeats: bool = False
    leakage: float = 0.0
    leakage_std: float = 0.0

    def overlap(self) -> Array:
        """(K, K) see ``slot_overlap``."""
        return slot_overlap(self.slots, self.delay, self.ratio, self.repeats)


def slot_overlap(slots: int, delay: float, ratio: float = 1.0, repeats: bool = False, transfer: float = 0.0) -> Array:
    """(K, K) time in which slot i of the aperture and slot j of the shutter are both on, in slots of the aperture.

    Where the exposure ``repeats``, the apertures of those before and after it count as well. Of a slot of the shutter
    the share ``transfer`` at its beginning is lost.
    """
    begins = delay + ratio * np.arange(slots, dtype=np.float64)
    turns = range(int(begins.min() // slots), int((begins.max() + ratio) // slots) + 1) if repeats else (0,)
    shutter, ratio = begins + transfer * ratio, (1 - transfer) * ratio
    overlap = np.zeros((slots, slots))
    for turn in turns:
        aperture = turn * slots + np.arange(slots, dtype=np.float64)[:, None]
        end = np.minimum(aperture + 1, shutter + ratio)
        overlap += np.clip(end - np.maximum(aperture, shutter), 0.0, None)
    return overlap


def other_overlap(slots: int, delay: float, ratio: float, repeats: bool, transfer: float) -> Array:
    """(K, K) time in which slot i of the aperture and all slots of the shutter but j are on, in another bucket: the
    beginning of the slot after j is lost."""
    whole = slot_overlap(slots, delay, ratio, repeats)
    lost = whole - slot_overlap(slots, delay, ratio, repeats, transfer)
    return np.asarray(whole.sum(axis=1, keepdims=True) - whole - np.roll(lost, -1, axis=1))


def pair_light(overlap: ArrayLike, aperture: float = 0.0, shutter: float = 0.0) -> Array:
    """(K, K) light with slot i of the aperture and slot j of the shutter alone open, 1 for a whole slot without leaks.

    The integral of ``A_i(t) S_j(t)`` over the K slots of the aperture: each is 1 in its slot, and its leakage at all
    other times. That is the exposure; before and after it nothing leaks.

    Args:
        overlap: (K, K) see ``slot_overlap``.
        aperture: share of the light that passes where the aperture is closed.
        shutter: share of the light that is recorded where the shutter is closed.
    """
    both = np.asarray(overlap, dtype=np.float64)
    opened = (1 - aperture) * both + aperture * both.sum(axis=0)
    return (1 - shutter) * opened + shutter * (1 - aperture + aperture * len(both))


def measure_timing(
    levels: ArrayLike,
    *,
    aperture_leakage: float = 0.0,
    aperture_leakage_std: float = 0.0,
    others: ArrayLike | None = None,
    transfer: float = 0.0,
    source: object = "timing",
) -> Timing:
    """Fit delay, ratio, light and leakage to mean levels, of an exposure that repeats or of one alone, whichever leaves
    less.

    Four numbers are fitted: of three slots or more a fifth level has to say whether they explain the levels. Of two
    slots there are four in all, so that no standard deviation is known.

    A leakage adds the same to all levels: a pedestal (stray light, a dark of another exposure), and what the aperture
    leaks beside ``aperture_leakage``, cannot be told from it. Nor can a delay where no pair was captured that never
    meets, nor, of two slots, an exposure that repeats: then what needs less leakage, and slots more alike, is taken.

    Args:
        levels: (K, K) mean light above the dark with slot i of the aperture and slot j of the shutter alone open;
            NaN where it was not captured.
        aperture_leakage: share of the light that a closed aperture passes, as a registration measures it.
        aperture_leakage_std: its standard deviation: what it is too large by, the shutter's is too small by.
        others: (K, K) light of the other slots, in another bucket of the same pixels.
        transfer: share of a slot whose light a pixel loses that changes its bucket: with it the first bucket alone does
            not tell a delay.
        source: named in errors.

    Raises:
        SettingError: not a square of two slots or more, or too few levels.
        DataError: no light, levels that are all alike or that no delay explains, a delay that they do
            not tell, or a leakage above a half.
    """
    seen = _seen(levels, source)
    slots, top = len(seen), float(np.nanmax(seen))
    second = None if others is None else np.asarray(others, dtype=np.float64) / top
    fits = (_misfit(seen / top, second, aperture_leakage, repeats, transfer) for repeats in (False, True))
    alone, again = (_best_fit(misfit, seen / top) for misfit in fits)
    repeats = bool(again.cost < _CLEARLY * alone.cost)
    fit = again if repeats else alone
    delay, ratio, light, leakage = (float(value) for value in fit.x)
    left = fit.fun[:-2]
    # shares of the largest level that was seen: the light of a slot that hardly overlaps is a guess
    residual = float(np.sqrt((left**2).mean() * slots))
    std = fit_std(fit, left)
    delay = (delay + slots / 2) % slots - slots / 2 if repeats else delay
    _check((delay, ratio, leakage), residual, source)
    if slots > 2 and not std[:2].max() <= LARGEST_STD:
        what = f"levels that no delay explains alone (delay ± {std[0]:.2g} slots, ratio ± {std[1]:.2g})"
        remedy = "check which slots each capture had open, and both triggers"
        raise DataError(source, what, f"± {LARGEST_STD:g} at most", remedy)
    own_std = float(np.hypot(std[3], aperture_leakage_std))
    return Timing(delay, ratio, std[:2], light * top, residual, slots, repeats, leakage, own_std)


def _seen(levels: ArrayLike, source: object) -> Array:
    """The levels as they were given; errors as of ``measure_timing``."""
    seen = np.asarray(levels, dtype=np.float64)
    if seen.ndim != 2 or seen.shape[0] != seen.shape[1] or len(seen) < 2:
        raise SettingError("timing", f"levels of shape {seen.shape}", "(K, K) of two slots or more")
    finite, needed = int(np.isfinite(seen).sum()), 4 if len(seen) == 2 else 5
    if finite < needed:
        expected = f"{needed} or more, of which delay, ratio, light and leakage follow"
        raise SettingError("timing", f"{finite} levels that are known", expected, "capture neighbouring slots as well")
    if not np.nanmax(seen) > 0:
        raise DataError(source, "no light in any pair of slots", "light where both are open", "check both triggers")
    if np.nanmax(seen) - np.nanmin(seen) < LARGEST_RESIDUAL * np.nanmax(seen):
        found = f"levels that are all alike within {LARGEST_RESIDUAL:.0%}, which no delay explains"
        raise DataError(source, found, "pairs that meet and others that do not", "does the shutter close?")
    return seen


def _misfit(
    shares: Array, others: Array | None, aperture: float, repeats: bool, transfer: float
) -> Callable[[Array], Array]:
    """What delay, ratio, light and leakage leave of the known levels, and the pull on leakage and ratio."""
    finite = np.isfinite(shares)

    def residuals(values: Array) -> Array:
        delay, ratio, light, leakage = values
        when = (len(shares), delay, ratio, repeats, transfer)
        left = [light * pair_light(slot_overlap(*when), aperture, leakage) - shares]
        if others is not None:
            left.append(light * pair_light(other_overlap(*when), aperture) - others)
        return np.concatenate([*(one[finite] for one in left), [_PULL * leakage, _PULL * (ratio - 1)]])

    return residuals


def _check(values: tuple[float, float, float], residual: float, source: object) -> None:
    """Raises DataError for levels that no delay explains, and for a shutter that hardly closes."""
    _, ratio, leakage = values
    remedy = "check which slots each capture had open"
    if residual > LARGEST_RESIDUAL:
        what = f"levels that no delay explains (a fit leaves {residual:.0%} of a slot's light)"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", remedy)
    if not 0.2 < ratio < 5:
        what = f"levels that no delay explains but with slots of the shutter {ratio:.3g} times the aperture's"
        raise DataError(source, what, "0.2 to 5 times", remedy)
    if leakage > LARGEST_LEAKAGE:
        what = f"{leakage:.0%} of the light in closed slots"
        raise DataError(source, what, f"{LARGEST_LEAKAGE:.0%} at most", remedy)


def _best_fit(residuals: Callable[[Array], Array], shares: Array) -> Any:
    from scipy.optimize import least_squares

    # pairs of slots that never meet are the darkest
    closed = float(np.clip(np.nanmin(shares), 0.0, LARGEST_LEAKAGE))
    grids = [sorted(_starts(residuals, len(shares), share), key=lambda one: one[0]) for share in (0.0, closed)]
    bounds = ([-np.inf, -np.inf, -np.inf, 0.0], [np.inf, np.inf, np.inf, 1.0])
    starts = [start for grid in grids for _, start in grid[:_STARTS]]
    fits = [least_squares(residuals, start, bounds=bounds, xtol=1e-10, ftol=1e-12) for start in starts]
    return min(fits, key=lambda fit: fit.cost)


def _starts(residuals: Callable[[Array], Array], slots: int, leakage: float) -> list[tuple[float, Array]]:
    """Misfit and place of a grid of delays and ratios: the levels have kinks, over which a fit does not climb."""
    grid = product(np.arange(-slots + 0.5, slots, 0.25), np.arange(0.6, 1.5, 0.1))
    places = [np.array([delay, ratio, 1 / max(1.0, ratio), leakage]) for delay, ratio in grid]
    return [(float((residuals(place) ** 2).sum()), place) for place in places]
