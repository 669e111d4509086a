"""A first guess of where a mask falls on a sensor: shift by phase correlation, over flips, quarter turns and scales."""

from __future__ import annotations

from itertools import product

import numpy as np

from tmca.errors import DataError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.pattern_image import moved, seen_patterns

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
    target = _features(shares, lit)
    best, found = 0.0, np.zeros((2, 3))
    for factor, turn in product(_SCALES, _turns()):
        matrix = _centred(scale * factor * turn, shown.shape[1:], shares.shape[1:])
        matrix = moved(matrix, _shift(target, shown, matrix))
        score = _alike(target, shown, matrix, lit)
        if score > best:
            best, found = score, matrix
        if best > _SURE:
            break
    if best < _SEEN:
        what = f"patterns that are not seen (the best correlation is {best:.2f})"
        remedy = "check the light, the focus, the order of the frames and --scale"
        raise DataError(source, what, f"{_SEEN:g} or more", remedy)
    return found


def _turns() -> list[Array]:
    """The eight flips and quarter turns of a square, unturned first."""
    plain, flip = np.eye(2), np.diag([1.0, -1.0])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    return [np.linalg.matrix_power(quarter, n) @ other for other in (plain, flip) for n in range(4)]


def _centred(linear: Array, codes: tuple[int, ...], sensor: tuple[int, ...]) -> Array:
    """The linear map that lays the middle of the mask on the middle of the sensor."""
    middle, place = (np.array([(n - 1) / 2 for n in size]) for size in (codes, sensor))
    return np.hstack([linear, (place - linear @ middle)[:, None]])


def _features(images: Array, lit: np.ndarray | None = None) -> Array:
    """Blurred images without their mean, zero where there is no light."""
    from scipy.ndimage import gaussian_filter

    where = np.ones(images.shape[1:], bool) if lit is None else lit
    centred = np.where(where, images - images[:, where].mean(axis=1)[:, None, None], 0.0)
    return np.asarray(gaussian_filter(centred, (0, _BLUR, _BLUR), mode="constant"))


def _shift(target: Array, shown: Array, matrix: Array) -> Array:
    """Rows and columns by which the first pattern has to move, by cross-correlation."""
    from skimage.registration import phase_cross_correlation

    size = (int(target.shape[1]), int(target.shape[2]))
    seen = _masked(shown[:1], matrix, size)
    found = phase_cross_correlation(target[0], seen[0], normalization=None)[0]
    return np.asarray(found, dtype=np.float64)


def _masked(shown: Array, matrix: Array, size: tuple[int, int]) -> Array:
    """What is seen of the patterns, without the mean over the mask."""
    images = seen_patterns(np.concatenate([shown, np.ones((1, *shown.shape[1:]))]), matrix, size, samples=1)
    return _features(images[:-1], images[-1] > 0.5) if (images[-1] > 0.5).any() else images[:-1] * 0


def _alike(target: Array, shown: Array, matrix: Array, lit: np.ndarray) -> float:
    """Correlation of what is seen with what should be, over lit pixels."""
    seen = _masked(shown, matrix, (int(target.shape[1]), int(target.shape[2])))[:, lit]
    wanted = target[:, lit]
    return float((seen * wanted).sum() / max(np.sqrt((seen**2).sum() * (wanted**2).sum()), 1e-12))
