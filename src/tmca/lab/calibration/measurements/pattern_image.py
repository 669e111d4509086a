"""What a sensor sees of patterns on a mask, through an affine map: light integrated over the area of its pixels."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import SettingError, ShapeError
from tmca.lab.calibration.arrays import Array

SAMPLES = 3


def seen_patterns(
    patterns: ArrayLike, matrix: Array, size: tuple[int, int], blur: float = 0.0, samples: int = SAMPLES
) -> Array:
    """Share of the area of every sensor pixel that patterns leave open.

    Code pixel (i, j) falls on sensor pixel ``matrix @ (i, j, 1)``; both count from the middle of their first pixel. A
    sensor pixel is cut into ``samples``² parts, each integrated over a box along the axes of the mask: exact
    where the axes agree, in second order of the angle between them otherwise.

    Args:
        patterns: (P, h, w), 1 open; 0 beyond the mask.
        matrix: (2, 3), code pixels to sensor pixels, rows first.
        size: (H, W) of the sensor.
        blur: standard deviation of the relay's blur, sensor pixels.
        samples: parts of a sensor pixel along an axis, more where it covers many code pixels.

    Returns:
        (P, H, W).

    Raises:
        ShapeError: no stack of patterns.
        SettingError: a matrix that is not invertible.
    """
    planes = np.asarray(patterns, dtype=np.float64)
    if planes.ndim != 3:
        raise ShapeError("patterns", f"shape {planes.shape}", "(P, h, w)")
    back = inverse(matrix)
    reach = np.abs(back[:, :2]).sum(axis=1)
    samples = max(samples, ceil(reach.max()))
    places = _places(back, size, samples)
    fine = _integrated(planes, places, reach / samples)
    if blur > 0:
        from scipy.ndimage import gaussian_filter

        fine = gaussian_filter(fine, (0, blur * samples, blur * samples), mode="nearest")
    return np.asarray(fine.reshape(len(planes), size[0], samples, size[1], samples).mean(axis=(2, 4)))


def inverse(matrix: Array) -> Array:
    """(2, 3) map from sensor pixels back to code pixels.

    Raises:
        SettingError: a matrix that is none, or not invertible.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    if matrix.shape != (2, 3) or not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:, :2])) < 1e-9:
        raise SettingError("registration", str(matrix.tolist()), "an invertible (2, 3) matrix")
    turned = np.linalg.inv(matrix[:, :2])
    return np.hstack([turned, -turned @ matrix[:, 2:]])


def mapped(matrix: Array, rows: ArrayLike, columns: ArrayLike) -> tuple[Array, Array]:
    """Rows and columns of places through a (2, 3) map."""
    (a, b, y), (c, d, x) = np.asarray(matrix, dtype=np.float64)
    rows, columns = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
    return a * rows + b * columns + y, c * rows + d * columns + x


def moved(matrix: Array, shift: ArrayLike) -> Array:
    """The map followed by a shift (rows, columns) of the sensor's pixels."""
    found = np.array(matrix, dtype=np.float64)
    found[:, 2] += np.asarray(shift, dtype=np.float64)
    return found


def _places(back: Array, size: tuple[int, int], samples: int) -> tuple[Array, Array]:
    """Code coordinates (H·s, W·s) of the middles of all parts of all pixels."""
    rows, columns = ((np.arange(n * samples) + 0.5) / samples - 0.5 for n in size)
    return mapped(back, rows[:, None], columns)


def _integrated(planes: Array, places: tuple[Array, Array], width: Array) -> Array:
    """Mean of piecewise constant planes over boxes of ``width`` ≤ 1 code pixels around places."""
    padded = np.pad(planes, ((0, 0), (1, 2), (1, 2)))
    flat, columns = padded.reshape(len(planes), -1), padded.shape[2]
    (low_y, share_y), (low_x, share_x) = (
        _ramp(place, wide, n) for place, wide, n in zip(places, width, planes.shape[1:], strict=True)
    )
    corner = low_y * columns + low_x
    found = (1 - share_y) * (1 - share_x) * np.take(flat, corner, axis=1)
    found += (1 - share_y) * share_x * np.take(flat, corner + 1, axis=1)
    found += share_y * (1 - share_x) * np.take(flat, corner + columns, axis=1)
    found += share_y * share_x * np.take(flat, corner + columns + 1, axis=1)
    return np.asarray(found)


def _ramp(place: Array, width: float, length: int) -> tuple[np.ndarray, Array]:
    """Index, in a plane padded by one, of the pixel left of the nearest edge, and the share of the box beyond it."""
    left = np.floor(place)
    share = np.clip((place - left - 0.5) / width + 0.5, 0, 1)
    return np.clip(left + 1, 0, length + 1).astype(np.intp), np.where((left < -1) | (left > length), 0.0, share)
