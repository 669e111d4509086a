"""How well the views of a light field agree with its centre at each candidate disparity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tmca.metrics._subpixel import interpolated, overlap

Values = NDArray[np.float32]

_GRADIENT_WEIGHT = np.float32(3.0)
_TRUNCATION = np.float32(0.025)
_REGULARISATION = np.float32(1e-3)


@dataclass(frozen=True)
class Labels:
    """Candidates ``first/per_pixel … last/per_pixel``, px per view step."""

    first: int
    last: int
    per_pixel: int

    @property
    def count(self) -> int:
        return self.last - self.first + 1


def matching_scores(views: Values, labels: Labels) -> Values:
    """Agreement of the views above, below, left and right of the centre with it: ``(4, labels, H, W)``.

    A view adds between 0 and the truncation of the difference; what lies outside of it adds nothing.
    """
    rows, columns = views.shape[0] // 2, views.shape[1] // 2
    centre = _features(views[rows, columns])
    scores = np.zeros((4, labels.count, *views.shape[2:]), dtype=np.float32)
    for v in range(-rows, rows + 1):
        for u in range(-columns, columns + 1):
            halves = [half for half, inside in enumerate((v < 0, v > 0, u < 0, u > 0)) if inside]
            if halves:
                _add_view(scores, halves, views[v + rows, u + columns], (v, u), centre, labels)
    scores /= _views_per_half(views.shape[0], views.shape[1])
    return scores


def _views_per_half(rows: int, columns: int) -> Values:
    """A grid of one row has nothing above or below: its empty halves stay at zero, below every other."""
    vertical, horizontal = (rows // 2) * columns, (columns // 2) * rows
    counts = np.array([vertical, vertical, horizontal, horizontal], dtype=np.float32)
    return np.maximum(counts, np.float32(1))[:, None, None, None]


def _add_view(
    scores: Values, halves: list[int], view: Values, place: tuple[int, int], centre: Values, labels: Labels
) -> None:
    """Candidates that are whole pixels apart share one interpolated view."""
    shape = view.shape
    for start in range(min(labels.per_pixel, labels.count)):
        base = labels.first + start
        (row, row_part), (column, column_part) = (divmod(-step * base, labels.per_pixel) for step in place)
        moved = interpolated(view, row_part / labels.per_pixel, 0)
        moved = _features(interpolated(moved, column_part / labels.per_pixel, 1))
        for turn, index in enumerate(range(start, labels.count, labels.per_pixel)):
            y, from_y = overlap(shape[0], row - turn * place[0], row_part > 0)
            x, from_x = overlap(shape[1], column - turn * place[1], column_part > 0)
            gain = _TRUNCATION - np.abs(moved[:, from_y, from_x] - centre[:, y, x]).sum(axis=0)
            np.maximum(gain, 0, out=gain)
            for half in halves:
                scores[half, index, y, x] += gain


def _features(image: Values) -> Values:
    """Brightness and weighted gradient, ``(3, H, W)``."""
    down, right = np.gradient(image)
    return np.stack((image, _GRADIENT_WEIGHT * down, _GRADIENT_WEIGHT * right))


def filtered(scores: Values, guide: Values, radius: int) -> Values:
    """Guided filter of every plane of ``(..., H, W)`` along the edges of the guide ``(H, W)``."""
    mean = _box(guide, radius)
    variance = np.subtract(_box(guide * guide, radius), mean * mean, dtype=np.float32) + _REGULARISATION
    result = np.empty_like(scores)
    for plane in np.ndindex(scores.shape[:-2]):
        level = _box(scores[plane], radius)
        slope = np.divide(_box(guide * scores[plane], radius) - mean * level, variance, dtype=np.float32)
        result[plane] = _box(slope, radius) * guide + _box(level - slope * mean, radius)
    return result


def _box(image: Values, radius: int) -> Values:
    from scipy.ndimage import uniform_filter

    return uniform_filter(image, 2 * radius + 1, mode="nearest")
