"""Where the image of the mask lies in a capture: its size and place, found from captures alone.

A mask is recorded without the disperser, often through other optics, so that its file and its image in a capture differ
by a part of a pixel. Where the scene is smooth, a capture divided by its local mean is a sum of displaced copies of the
mask: ``y ≈ Σ_ℓ c_ℓ M(m − v, n − d_ℓ)``. The vertical displacement v of a block is the one at which such a sum, its
weights c by least squares, explains most of the block. A line through the blocks' v gives scale and shift.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from tmca.errors import DataError, SettingError

Array = NDArray[np.float64]
Factor = Annotated[float, Field(gt=0.9, lt=1.1)]
_BROAD, _SMOOTH = 5.0, 4.0
"""Pixels: Gaussian width of the local mean, and of what counts as slow in mask and capture."""


class Registration(BaseModel):
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


def registered(mask: NDArray[np.floating], registration: Registration) -> Array:
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
    reach: float = 1.6,
    blur: float = 0.6,
) -> Array:
    """Vertical displacement of the mask in every block with light.

    Args:
        capture: (H, W').
        mask: (H, W).
        offsets: columns of the bands.
        black: level of the capture without light.
        side: of the blocks, pixels.
        reach: largest displacement looked at, pixels.
        blur: of the mask, pixels.

    Returns:
        (blocks, 4): row and column of the block's middle, displacement (pixels), share that is explained.
    """
    steps = np.arange(-reach, reach + 0.1, 0.2)
    masks = [fine_part(registered(mask, Registration(shift=(step, 0.0), blur=blur))) for step in steps]
    flat, found = fine_part(flattened(capture, black)), []
    for top, left in _blocks(np.asarray(capture, dtype=np.float64) - black, side, 0.1):
        block = flat[top : top + side, left : left + side]
        shares = np.array([explained(block, one, top, left, offsets)[0] for one in masks])
        best = int(np.clip(shares.argmax(), 1, len(steps) - 2))
        found.append((top + side / 2, left + side / 2, _peak(steps, shares, best), float(shares.max())))
    return np.array(found).reshape(-1, 4)


def register_mask(
    captures: Sequence[NDArray[np.floating]],
    mask: NDArray[np.floating],
    offsets: Sequence[int],
    *,
    black: float = 0.0,
    side: int = 72,
    least: float = 0.35,
) -> tuple[Registration, float]:
    """Vertical scale and shift of the mask's image in captures, and the blocks' deviation from them (pixels).

    Args:
        captures: (H, W') each, of any scenes.
        mask: (H, W) of the file.
        offsets: columns of the bands.
        black: level of the captures without light.
        side: of the blocks, pixels.
        least: share of a block that the mask has to explain.

    Raises:
        DataError: a mask of another size than the captures, or fewer than eight blocks that show it.
        SettingError: no captures.
    """
    if not captures:
        raise SettingError("captures", "none", "one or more")
    wide = (mask.shape[0], mask.shape[1] + max(max(offsets), 0) - min(min(offsets), 0))
    for capture in captures:
        if capture.shape != wide:
            found, wanted = ("×".join(map(str, size)) for size in (capture.shape, wide))
            remedy = "give the mask of these captures"
            raise DataError("captures", f"{found} pixels", f"{wanted}: the mask's and its bands' displacement", remedy)
    blocks = np.concatenate([block_shifts(one, mask, offsets, black=black, side=side) for one in captures])
    used = blocks[blocks[:, 3] >= least]
    if len(used) < 8:
        found = f"{len(used)} of {len(blocks)} blocks that show the mask"
        raise DataError("captures", found, "8 or more", "give brighter or smoother scenes, or another mask")
    middle = (mask.shape[0] - 1) / 2
    line, deviation = _line(used[:, 0] - 0.5 - middle, used[:, 2], used[:, 3])
    return Registration(scale=(1 + line[1], 1.0), shift=(line[0], 0.0)), deviation


def _peak(places: Array, values: Array, at: int) -> float:
    """Vertex of the parabola through three values."""
    before, here, after = values[at - 1 : at + 2]
    bend = before - 2 * here + after
    step = 0.0 if bend == 0 else 0.5 * (before - after) / bend
    return float(places[at] + np.clip(step, -1, 1) * (places[1] - places[0]))


def _line(x: Array, y: Array, weights: Array) -> tuple[Array, float]:
    """Intercept and slope of a line through points, three rounds without what lies three deviations away."""
    kept = np.ones(len(x), dtype=bool)
    line: Array = np.zeros(2)
    deviation = 0.0
    for _ in range(3):
        line = np.asarray(np.polynomial.polynomial.polyfit(x[kept], y[kept], 1, w=weights[kept]), dtype=np.float64)
        away = np.abs(y - line[0] - line[1] * x)
        deviation = float(np.sqrt(np.mean(away[kept] ** 2)))
        kept = away <= max(3 * deviation, 0.05)
    return line, deviation
