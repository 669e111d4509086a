"""What a sensor sees of patterns on a mask through an affine map, and a first guess of that map."""

from __future__ import annotations

from itertools import product
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.fitting import whole_shift
from tmca.lab.frames import Array

SAMPLES = 3
_FARTHEST = 4.0
"""Reach of the blur, standard deviations."""


def seen_patterns(
    patterns: ArrayLike,
    matrix: Array,
    size: tuple[int, int],
    blur: float = 0.0,
    samples: int = SAMPLES,
    part: tuple[slice, slice] | None = None,
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
        part: rows and columns of the sensor that are wanted, all of them if None.

    Returns:
        (P, H, W), or of the part.

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
    wanted = part or (slice(0, size[0]), slice(0, size[1]))
    margin = ceil(_FARTHEST * blur) + 1
    around = [slice(max(0, w.start - margin), min(n, w.stop + margin)) for w, n in zip(wanted, size, strict=True)]
    places = _places(back, around, samples)
    fine = _integrated(planes, places, reach / samples)
    if blur > 0:
        from scipy.ndimage import gaussian_filter

        fine = gaussian_filter(fine, (0, blur * samples, blur * samples), mode="nearest", truncate=_FARTHEST)
    height, width = (a.stop - a.start for a in around)
    seen = np.asarray(fine.reshape(len(planes), height, samples, width, samples).mean(axis=(2, 4)))
    rows, columns = (slice(w.start - a.start, w.stop - a.start) for w, a in zip(wanted, around, strict=True))
    return seen[:, rows, columns]


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
    shifted = np.array(matrix, dtype=np.float64)
    shifted[:, 2] += np.asarray(shift, dtype=np.float64)
    return shifted


def _places(back: Array, around: list[slice], samples: int) -> tuple[Array, Array]:
    """Code coordinates (H·s, W·s) of the middles of all parts of all pixels around."""
    rows, columns = ((np.arange(a.start * samples, a.stop * samples) + 0.5) / samples - 0.5 for a in around)
    return mapped(back, rows[:, None], columns)


def _integrated(planes: Array, places: tuple[Array, Array], width: Array) -> Array:
    """Mean of piecewise constant planes over boxes of ``width`` ≤ 1 code pixels around places."""
    padded = np.pad(planes, ((0, 0), (1, 2), (1, 2)))
    flat, columns = padded.reshape(len(planes), -1), padded.shape[2]
    (low_y, share_y), (low_x, share_x) = (
        _ramp(place, wide, n) for place, wide, n in zip(places, width, planes.shape[1:], strict=True)
    )
    corner = low_y * columns + low_x
    mean = (1 - share_y) * (1 - share_x) * np.take(flat, corner, axis=1)
    mean += (1 - share_y) * share_x * np.take(flat, corner + 1, axis=1)
    mean += share_y * (1 - share_x) * np.take(flat, corner + columns, axis=1)
    mean += share_y * share_x * np.take(flat, corner + columns + 1, axis=1)
    return np.asarray(mean)


def _ramp(place: Array, width: float, length: int) -> tuple[np.ndarray, Array]:
    """Index, in a plane padded by one, of the pixel left of the nearest edge, and the share of the box beyond it."""
    left = np.floor(place)
    share = np.clip((place - left - 0.5) / width + 0.5, 0, 1)
    return np.clip(left + 1, 0, length + 1).astype(np.intp), np.where((left < -1) | (left > length), 0.0, share)


_SCALES = (1.0, 0.97, 1.03, 0.94, 1.06)
_BLUR = 2.0
_SEEN = 0.3
"""Correlation of blurred images from which on the patterns count as seen."""
_SURE = 0.85


def find_coarse(shares: Array, shown: Array, lit: np.ndarray, scale: float, source: object) -> Array:
    """(2, 3) map under which patterns are most like what was seen.

    Args:
        shares: (P, H, W) seen, shares of the open light.
        shown: (P, h, w).
        lit: (H, W) pixels that count.
        scale: sensor pixels per mask pixel.
        source: named in errors.

    Raises:
        DataError: no place at which they are alike.
    """
    target, size = _features(shares, lit), (int(shares.shape[1]), int(shares.shape[2]))
    best, coarse = 0.0, np.zeros((2, 3))
    for factor, turn in product(_SCALES, _turns()):
        matrix = centred(scale * factor * turn, shown.shape[1:], shares.shape[1:])
        matrix = moved(matrix, whole_shift(target[0], _masked(shown[:1], matrix, size)[0]))
        score = _alike(target, shown, matrix, lit)
        if score > best:
            best, coarse = score, matrix
        if best > _SURE:
            break
    if best < _SEEN:
        what = f"patterns that are not seen (the best correlation is {best:.2f})"
        remedy = "check the light, the focus, the order of the frames and --scale"
        raise DataError(source, what, f"{_SEEN:g} or more", remedy)
    return coarse


def _turns() -> list[Array]:
    """The eight flips and quarter turns of a square, unturned first."""
    plain, flip = np.eye(2), np.diag([1.0, -1.0])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    return [np.linalg.matrix_power(quarter, n) @ other for other in (plain, flip) for n in range(4)]


def centred(linear: Array, codes: tuple[int, ...], sensor: tuple[int, ...]) -> Array:
    """The linear map that lays the middle of the mask on the middle of the sensor."""
    middle, place = (np.array([(n - 1) / 2 for n in size]) for size in (codes, sensor))
    return np.hstack([linear, (place - linear @ middle)[:, None]])


def _features(images: Array, lit: np.ndarray | None = None) -> Array:
    """Blurred images without their mean, zero where there is no light."""
    from scipy.ndimage import gaussian_filter

    where = np.ones(images.shape[1:], bool) if lit is None else lit
    centred = np.where(where, images - images[:, where].mean(axis=1)[:, None, None], 0.0)
    return np.asarray(gaussian_filter(centred, (0, _BLUR, _BLUR), mode="constant"))


def _masked(shown: Array, matrix: Array, size: tuple[int, int]) -> Array:
    """What is seen of the patterns, without the mean over the mask."""
    images = seen_patterns(np.concatenate([shown, np.ones((1, *shown.shape[1:]))]), matrix, size, samples=1)
    return _features(images[:-1], images[-1] > 0.5) if (images[-1] > 0.5).any() else images[:-1] * 0


def _alike(target: Array, shown: Array, matrix: Array, lit: np.ndarray) -> float:
    """Correlation of what is seen with what should be, over lit pixels."""
    seen = _masked(shown, matrix, (int(target.shape[1]), int(target.shape[2])))[:, lit]
    wanted = target[:, lit]
    return float((seen * wanted).sum() / max(np.sqrt((seen**2).sum() * (wanted**2).sum()), 1e-12))
