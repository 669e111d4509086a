"""Shifting images by fractions of a pixel, without inventing what lies outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


def interpolated(image: Image, fraction: float, axis: int) -> Image:
    """``image`` at positions moved by ``fraction`` in [0, 1) along ``axis``, of the same shape.

    Cubic convolution of four pixels (Keys, IEEE TASSP 29, 1981); the edge pixels go on outside.
    """
    if fraction == 0:
        return image
    padding = [(0, 0)] * image.ndim
    padding[axis] = (1, 2)
    wide, length = np.pad(image, padding, mode="edge"), image.shape[axis]
    result = np.zeros_like(image)
    for place, weight in enumerate(_keys(fraction)):
        window = [slice(None)] * image.ndim
        window[axis] = slice(place, place + length)
        result += np.float32(weight) * wide[tuple(window)]
    return result


def _keys(f: float) -> tuple[float, float, float, float]:
    """Weights of the pixels at -1, 0, 1 and 2 for the position f."""
    return (
        (-f + 2 * f**2 - f**3) / 2,
        (2 - 5 * f**2 + 3 * f**3) / 2,
        (f + 4 * f**2 - 3 * f**3) / 2,
        (f**3 - f**2) / 2,
    )


def overlap(length: int, offset: int, between: bool = False) -> tuple[slice, slice]:
    """Where ``target[i] = source[i + offset]`` has a source: the two slices, empty if nowhere.

    With ``between``, the source lies between pixel i + offset and the next one, which has to exist, too.
    """
    first = min(max(0, -offset), length)
    last = max(first, min(length, length - offset - between))
    return slice(first, last), slice(first + offset, last + offset) if last > first else slice(0, 0)


def moved_view(view: Image, place: tuple[int, int], disparity: float) -> tuple[Image, tuple[slice, slice]]:
    """A view moved onto the centre of its light field: its values at (y - v·disparity, x - u·disparity).

    Args:
        view: ``(..., H, W)``.
        place: (v, u), counted from the centre view.
        disparity: px per view step.

    Returns:
        The values where the view has them, and the rows and columns of the centre view where that is.
    """
    slices = []
    for axis, step in zip((-2, -1), place, strict=True):
        offset = int(np.floor(-step * disparity))
        fraction = -step * disparity - offset
        view = interpolated(view, fraction, axis % view.ndim)
        slices.append(overlap(view.shape[axis], offset, fraction > 0))
    (y, from_y), (x, from_x) = slices
    return view[..., from_y, from_x], (y, x)
