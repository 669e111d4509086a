"""Where a pixel shutter's patterns lie on the sensor and with which slot the exposure begins, from a capture alone.

No decoder and no prior is in it. Where something moves, what a pixel sees depends on its slot; a shutter in the wrong
place gives pixels the slots of others, and the dependence is gone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError

_BLOCK, _BINS, _AROUND = 16, 16, 9
"""Pixels of a block, parts of the exposure, and pixels of the median that is taken for what stands still."""
_CLEAR = 6.0
"""Standard deviations of the other places by which the best one has to lead."""


@dataclass(frozen=True)
class ShutterPlace:
    """What a capture says of its shutter.

    Args:
        shift: rows and columns by which the patterns are displaced on the sensor.
        first_slot: with which the exposure began; slots before it come after the last one.
        lead: of the best shift over the others, in their standard deviations; infinite where it was known.
    """

    shift: tuple[int, int]
    first_slot: int
    lead: float


def shutter_place(
    values: NDArray[np.floating], shutter: NDArray[np.integer], reach: int = 6, known: tuple[int, int] | None = None
) -> ShutterPlace:
    """Find the shift whose slots explain most of a capture, and the seam between the exposure's end and beginning.

    Args:
        values: (H, W) of the capture.
        shutter: (H, W, K), every pixel open in one slot.
        reach: pixels up to which shifts are tried.
        known: shift, where another capture told it.

    Raises:
        SettingError: pixels that open in none or several slots, patterns of another size, or a known shift as large.
        DataError: no shift stands out: nothing moves, or patterns that repeat (a lattice fits at many places).
    """
    if shutter.ndim != 3 or shutter.shape[:2] != values.shape or not (shutter.sum(-1) == 1).all():
        raise SettingError("shutter", f"patterns of shape {shutter.shape}", "(H, W, K), every pixel open in one slot")
    if known is not None and any(abs(by) >= size for by, size in zip(known, values.shape, strict=True)):
        raise SettingError(
            "shift", f"{known[0]},{known[1]}", f"less than the capture's {'×'.join(map(str, values.shape))} pixels"
        )
    slots, rest, count = shutter.argmax(-1), _fine_part(values), shutter.shape[-1]
    shift, lead = (known, np.inf) if known is not None else _best_shift(rest, slots, count, reach)
    return ShutterPlace(shift, seam_of(*overlapping(rest, slots, shift), count), lead)


def _best_shift(
    rest: NDArray[np.floating], slots: NDArray[np.integer], count: int, reach: int
) -> tuple[tuple[int, int], float]:
    shifts = [(dy, dx) for dy, dx in product(range(-reach, reach + 1), repeat=2)]
    scores = np.array([explained_by_time(*overlapping(rest, slots, shift), count) for shift in shifts])
    best = int(scores.argmax())
    far = [np.abs(np.subtract(shift, shifts[best])).max() > 1 for shift in shifts]
    lead = float((scores[best] - np.median(scores[far])) / scores[far].std())
    if lead < _CLEAR:
        found = f"a best shift {lead:.1f} standard deviations above the others"
        raise DataError("shutter", found, f"{_CLEAR:g}", "take a capture of something that moves behind a random code")
    return shifts[best], lead


def overlapping(
    values: NDArray[Any], patterns: NDArray[Any], shift: tuple[int, int]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """The pixels of a capture (H, W) that displaced patterns (H, W, …) lie on, and those patterns."""
    own, of = zip(*(_parts(s, n) for s, n in zip(shift, values.shape, strict=True)), strict=True)
    return values[own], patterns[of]


def _parts(shift: int, size: int) -> tuple[slice, slice]:
    return slice(max(0, shift), size + min(0, shift)), slice(max(0, -shift), size + min(0, -shift))


def explained_by_time(rest: NDArray[np.floating], slots: NDArray[np.integer], count: int) -> float:
    """Chi-squared, less its expectation, of the means of blocks of pixels in parts of the exposure."""
    light, number = _sums(rest, slots * _BINS // count, _BINS)
    return float((light**2 / np.maximum(number, 1)).sum() - (number > 0).sum())


def seam_of(rest: NDArray[np.floating], slots: NDArray[np.integer], count: int) -> int:
    """The slot whose next ones differ most from those before it: there the scene of the end meets that of the
    beginning."""
    light, number = _sums(rest, slots, count)
    width = max(1, count // _BINS)
    before, after = (_running(light, number, width, step) for step in (-1, 0))
    differences = (after[0] - before[0]) ** 2 / (after[1] + before[1])
    return int(np.nansum(differences, axis=0).argmax())


def _running(
    light: NDArray[np.floating], number: NDArray[np.floating], width: int, step: int
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(blocks, K) mean over ``width`` slots from each one on (step 0), or up to it (-1), and its variance."""
    places = (np.arange(light.shape[1])[:, None] + step * width + np.arange(width)) % light.shape[1]
    many = np.maximum(number[:, places].sum(-1), 1.0)
    return np.asarray(light[:, places].sum(-1) / many), np.asarray(1 / many)


def _sums(
    rest: NDArray[np.floating], bins: NDArray[np.integer], count: int
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(blocks, count) sum of the standardised light of a block's pixels in every bin, and their number."""
    rows, columns = (np.arange(n) // _BLOCK for n in rest.shape)
    block = rows[:, None] * (columns[-1] + 1) + columns
    blocks = int(block.max()) + 1
    many = np.bincount(block.ravel(), minlength=blocks)
    mean = np.bincount(block.ravel(), rest.ravel(), blocks) / many
    spread = np.bincount(block.ravel(), (rest - mean[block]).ravel() ** 2, blocks) / many
    unit = (rest - mean[block]) / np.sqrt(np.maximum(spread[block], 1e-12 * max(float(spread.max()), 1e-300)))
    keys = (block * count + bins).ravel()
    total = blocks * count
    light = np.bincount(keys, unit.ravel(), total).reshape(blocks, count)
    number = np.bincount(keys, minlength=total).reshape(blocks, count)
    return np.asarray(light, dtype=np.float64), np.asarray(number, dtype=np.float64)


def _fine_part(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """A capture without what stands still over neighbouring pixels; stray values cut."""
    from scipy.ndimage import median_filter

    rest = np.asarray(values, dtype=np.float64) - median_filter(values, _AROUND)
    return np.clip(rest, *np.percentile(rest, [0.5, 99.5]))
