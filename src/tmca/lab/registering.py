"""Where mask and shutter of a real prototype lie, found from captures alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from tmca.errors import DataError, SettingError
from tmca.lab.frames import Array, check_size

Factor = Annotated[float, Field(gt=0.9, lt=1.1)]
_BROAD, _SMOOTH = 5.0, 4.0
"""Pixels: Gaussian width of the local mean, and of what counts as slow in mask and capture."""
_REACH, _MASK_BLUR = 1.6, 0.6
"""Pixels: largest displacement of a block that is looked at, and blur of the mask."""
_LEAST = 0.35
"""Share of a block that the mask has to explain."""


class MaskImage(BaseModel):
    """How the file of a mask becomes its image in a capture: scaled about the middle, moved, blurred.

    Args:
        scale: (along y, along x).
        shift: (along y, along x), pixels.
        blur: Gaussian standard deviation, pixels.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    scale: tuple[Factor, Factor] = (1.0, 1.0)
    shift: tuple[float, float] = (0.0, 0.0)
    blur: float = Field(default=0.0, ge=0)


def registered(mask: NDArray[np.floating], registration: MaskImage) -> Array:
    """(H, W) mask as the capture sees it, in [0, 1]; nearest values beyond its edge."""
    from scipy.ndimage import affine_transform, gaussian_filter

    values = np.asarray(mask, dtype=np.float64)
    values = gaussian_filter(values, registration.blur) if registration.blur else values
    if registration.scale == (1.0, 1.0) and registration.shift == (0.0, 0.0):
        return values
    inverse = 1 / np.array(registration.scale)
    middle = (np.array(values.shape) - 1) / 2
    offset = middle - inverse * (middle + np.array(registration.shift))
    return np.clip(affine_transform(values, inverse, offset, order=3, mode="nearest"), 0, 1)


def flattened(capture: NDArray[np.floating], black: float) -> Array:
    """A capture (H, W') above its black level, divided by its local mean."""
    from scipy.ndimage import gaussian_filter

    light = np.asarray(capture, dtype=np.float64) - black
    mean = gaussian_filter(light, _BROAD)
    return light / np.maximum(mean, max(float(np.quantile(mean, 0.5)), 1e-12))


def explained(block: Array, mask: Array, top: int, left: int, offsets: Sequence[int]) -> tuple[float, Array]:
    """Share of a block's fine structure that displaced copies of the mask explain, and their weights.

    Args:
        block: (h, w) of a flattened capture.
        mask: (H, W) with its slow part taken away.
        top, left: of the block in the capture.
        offsets: columns by which the copies are displaced, each inside the mask's frame or dark.
    """
    height, width = block.shape
    wide = max(max(offsets), 0), max(-min(offsets), 0) + width
    padded = np.pad(mask[top : top + height], ((0, 0), wide))
    copies = np.stack([padded[:, wide[0] + left - d : wide[0] + left - d + width].ravel() for d in offsets], axis=1)
    fine = block.ravel()
    weights = np.asarray(np.linalg.lstsq(copies, fine, rcond=None)[0], dtype=np.float64)
    rest = fine - copies @ weights
    return 1 - float(rest @ rest) / max(float(fine @ fine), 1e-30), weights


def fine_part(image: Array) -> Array:
    """An image without its slow part."""
    from scipy.ndimage import gaussian_filter

    return image - gaussian_filter(image, _SMOOTH)


def _blocks(light: Array, side: int, brightest: float) -> Iterator[tuple[int, int]]:
    """Corners of the blocks with light, every half side."""
    level = brightest * float(np.quantile(light, 0.99))
    for top in range(0, light.shape[0] - side + 1, side // 2):
        for left in range(0, light.shape[1] - side + 1, side // 2):
            if np.median(light[top : top + side, left : left + side]) > level:
                yield top, left


def block_shifts(
    capture: NDArray[np.floating],
    mask: NDArray[np.floating],
    offsets: Sequence[int],
    *,
    black: float = 0.0,
    side: int = 72,
) -> Array:
    """Vertical displacement of the mask in every block with light.

    Args:
        capture: (H, W').
        mask: (H, W).
        offsets: columns of the bands.
        black: level of the capture without light.
        side: of the blocks, pixels.

    Returns:
        (blocks, 4): row and column of the block's middle, displacement (pixels), share that is explained.
    """
    steps = np.arange(-_REACH, _REACH + 0.1, 0.2)
    masks = [fine_part(registered(mask, MaskImage(shift=(step, 0.0), blur=_MASK_BLUR))) for step in steps]
    flat, blocks = fine_part(flattened(capture, black)), []
    for top, left in _blocks(np.asarray(capture, dtype=np.float64) - black, side, 0.1):
        block = flat[top : top + side, left : left + side]
        shares = np.array([explained(block, one, top, left, offsets)[0] for one in masks])
        best = int(np.clip(shares.argmax(), 1, len(steps) - 2))
        blocks.append((top + side / 2, left + side / 2, _peak(steps, shares, best), float(shares.max())))
    return np.array(blocks).reshape(-1, 4)


def register_mask(
    captures: Sequence[NDArray[np.floating]],
    mask: NDArray[np.floating],
    offsets: Sequence[int],
    *,
    black: float = 0.0,
    side: int = 72,
) -> tuple[MaskImage, float]:
    """Vertical scale and shift of the mask's image in captures, and the blocks' deviation from them (pixels).

    Args:
        captures: (H, W') each, of any scenes.
        mask: (H, W) of the file.
        offsets: columns of the bands.
        black: level of the captures without light.
        side: of the blocks, pixels.

    Raises:
        DataError: a mask of another size than the captures, or fewer than eight blocks that show it.
        SettingError: no captures.
    """
    if not captures:
        raise SettingError("captures", "none", "one or more")
    wide = (mask.shape[0], mask.shape[1] + max(max(offsets), 0) - min(min(offsets), 0))
    for capture in captures:
        remedy = "give the mask of these captures: its width and its bands' displacement are theirs"
        check_size("captures", "one", capture.shape, wide, remedy)
    blocks = np.concatenate([block_shifts(one, mask, offsets, black=black, side=side) for one in captures])
    used = blocks[blocks[:, 3] >= _LEAST]
    if len(used) < 8:
        found = f"{len(used)} of {len(blocks)} blocks that show the mask"
        raise DataError("captures", found, "8 or more", "give brighter or smoother scenes, or another mask")
    middle = (mask.shape[0] - 1) / 2
    line, deviation = _line(used[:, 0] - 0.5 - middle, used[:, 2], used[:, 3])
    return MaskImage(scale=(1 + line[1], 1.0), shift=(line[0], 0.0)), deviation


def _peak(places: Array, values: Array, at: int) -> float:
    """Vertex of the parabola through three values."""
    before, here, after = values[at - 1 : at + 2]
    bend = before - 2 * here + after
    step = 0.0 if bend == 0 else 0.5 * (before - after) / bend
    return float(places[at] + np.clip(step, -1, 1) * (places[1] - places[0]))


def _line(x: Array, y: Array, weights: Array) -> tuple[Array, float]:
    """Intercept and slope of a line through points, three rounds without what lies three deviations away."""
    inliers = np.ones(len(x), dtype=bool)
    line, deviation = np.zeros(2), 0.0
    for _ in range(3):
        line = np.asarray(np.polynomial.polynomial.polyfit(x[inliers], y[inliers], 1, w=weights[inliers]))
        away = np.abs(y - line[0] - line[1] * x)
        deviation = float(np.sqrt(np.mean(away[inliers] ** 2)))
        inliers = away <= max(3 * deviation, 0.05)
    return line, deviation


_BLOCK, _BINS, _AROUND = 16, 16, 9
"""Pixels of a block, parts of the exposure, and pixels of the median that is taken for what stands still."""
_CLEAR = 6.0
"""Standard deviations of the other places by which the best one has to lead."""


def shutter_place(
    values: NDArray[np.floating], shutter: NDArray[np.integer], reach: int = 6, fixed: tuple[int, int] | None = None
) -> tuple[tuple[int, int], int]:
    """Find the shift whose slots explain most of a capture, and the seam between the exposure's end and beginning.

    Args:
        values: (H, W) of the capture.
        shutter: (H, W, K), every pixel open in one slot.
        reach: pixels up to which shifts are tried.
        fixed: the shift, where another capture told it.

    Returns:
        Rows and columns by which the patterns are displaced on the sensor, and the slot with which the exposure began:
        those before it come after the last one.

    Raises:
        SettingError: pixels that open in none or several slots, patterns of another size, or a known shift as large.
        DataError: no shift stands out: nothing moves, or patterns that repeat (a lattice fits at many places).
    """
    if shutter.ndim != 3 or shutter.shape[:2] != values.shape or not (shutter.sum(-1) == 1).all():
        raise SettingError("shutter", f"patterns of shape {shutter.shape}", "(H, W, K), every pixel open in one slot")
    if fixed is not None and any(abs(by) >= size for by, size in zip(fixed, values.shape, strict=True)):
        expected = f"less than the capture's {'×'.join(map(str, values.shape))} pixels"
        raise SettingError("shift", f"{fixed[0]},{fixed[1]}", expected)
    slots, rest, count = shutter.argmax(-1), _fine_part(values), shutter.shape[-1]
    shift = fixed or _best_shift(rest, slots, count, reach)
    return shift, seam_of(*overlapping(rest, slots, shift), count)


def _best_shift(rest: Array, slots: np.ndarray, count: int, reach: int) -> tuple[int, int]:
    shifts = [(dy, dx) for dy, dx in product(range(-reach, reach + 1), repeat=2)]
    scores = np.array([explained_by_time(*overlapping(rest, slots, shift), count) for shift in shifts])
    best = int(scores.argmax())
    far = [np.abs(np.subtract(shift, shifts[best])).max() > 1 for shift in shifts]
    lead = float((scores[best] - np.median(scores[far])) / scores[far].std())
    if lead < _CLEAR:
        found = f"a best shift {lead:.1f} standard deviations above the others"
        raise DataError("shutter", found, f"{_CLEAR:g}", "take a capture of something that moves behind a random code")
    return shifts[best]


def overlapping(values: np.ndarray, patterns: np.ndarray, shift: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The pixels of a capture (H, W) that displaced patterns (H, W, …) lie on, and those patterns."""
    inside, of = zip(*(_parts(s, n) for s, n in zip(shift, values.shape, strict=True)), strict=True)
    return values[inside], patterns[of]


def _parts(shift: int, size: int) -> tuple[slice, slice]:
    return slice(max(0, shift), size + min(0, shift)), slice(max(0, -shift), size + min(0, -shift))


def explained_by_time(rest: Array, slots: np.ndarray, count: int) -> float:
    """Chi-squared, less its expectation, of the means of blocks of pixels in parts of the exposure."""
    light, number = _sums(rest, slots * _BINS // count, _BINS)
    return float((light**2 / np.maximum(number, 1)).sum() - (number > 0).sum())


def seam_of(rest: Array, slots: np.ndarray, count: int) -> int:
    """The slot whose next ones differ most from those before it: there the scene of the end meets that of the
    beginning."""
    light, number = _sums(rest, slots, count)
    width = max(1, count // _BINS)
    before, after = (_running(light, number, width, step) for step in (-1, 0))
    differences = (after[0] - before[0]) ** 2 / (after[1] + before[1])
    return int(np.nansum(differences, axis=0).argmax())


def _running(light: Array, number: Array, width: int, step: int) -> tuple[Array, Array]:
    """(blocks, K) mean over ``width`` slots from each one on (step 0), or up to it (-1), and its variance."""
    places = (np.arange(light.shape[1])[:, None] + step * width + np.arange(width)) % light.shape[1]
    many = np.maximum(number[:, places].sum(-1), 1.0)
    return np.asarray(light[:, places].sum(-1) / many), np.asarray(1 / many)


def _sums(rest: Array, bins: np.ndarray, count: int) -> tuple[Array, Array]:
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


def _fine_part(values: NDArray[np.floating]) -> Array:
    """A capture without what stands still over neighbouring pixels; stray values cut."""
    from scipy.ndimage import median_filter

    rest = np.asarray(values, dtype=np.float64) - median_filter(values, _AROUND)
    return np.clip(rest, *np.percentile(rest, [0.5, 99.5]))
