"""Geometry of light fields: one plain disparity estimator for all, and the errors of disparity maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, ShapeError, check_range, check_shape
from tmca.metrics.cubes import Array, as_float64, pair

Image = NDArray[np.float32]

BAD_PIXEL = 0.07
"""Error above which a pixel is bad, px per view step (HCI 4-D light field benchmark)."""
_STRIP_BYTES = 1.2e8
_PREFILTER = 0.75
_GRADIENT_WEIGHT = np.float32(3.0)
_TRUNCATION = np.float32(0.025)
_REGULARISATION = np.float32(1e-3)
_HALF_SURE = 0.02
"""Margin of the best candidate, of the highest score there is, at which the confidence is one half."""


def estimate_disparity(
    light_field: Any, limits: tuple[float, float] = (-4.0, 4.0), *, labels: int = 8, window: int = 6
) -> Array:
    """Disparity of the centre view by plain matching, without learning and the same on every machine.

    The views are smoothed (Gaussian, σ = 0.75 pixels). Every candidate d moves all views onto the centre by cubic
    interpolation. Its score sums truncated absolute differences of brightness and gradient over the views above,
    below, left and right of the centre, each sum is smoothed by a guided filter of the centre view, and the best of
    the four counts: what one half of the aperture cannot see, the other can. The best candidate is refined by a
    parabola. It guesses where noise is stronger than texture.

    Sources: occlusion by halves Kang, Szeliski & Chai, CVPR 2001; cost and filter Rhemann et al., CVPR 2011;
    He et al., ECCV 2010.

    Args:
        light_field: ``(V, U, H, W)`` in [0, 1], V and U odd, not both 1; or ``(C, V, U, H, W)``, averaged over C.
        limits: lowest and highest disparity, px per view step.
        labels: candidates per pixel of disparity.
        window: radius of the filter, pixels.

    Returns:
        ``(H, W)`` float64, px per view step, positive = nearer than the plane in focus: what the centre shows at
        (y, x), view (v, u) shows at (y - v·d, x - u·d).

    Raises:
        ShapeError: not a light field of odd V and U with more than one view, or less than 4 × 4 pixels.
        SettingError: values that are not finite, limits that do not ascend, or labels or window below 1.
    """
    return match_views(light_field, limits, labels=labels, window=window)[0]


def match_views(
    light_field: Any, limits: tuple[float, float] = (-4.0, 4.0), *, labels: int = 8, window: int = 6
) -> tuple[Array, Array]:
    """Disparity as of `estimate_disparity`, with the same arguments and errors, and how sure it is.

    Returns:
        Disparity and confidence, ``(H, W)`` float64. The confidence is m / (m + 0.02), with m the margin by which the
        score stands above that of any candidate at least half a pixel away, of the highest score there is: 0 where
        another disparity fits as well, 1 where none does. It is no probability. Source: winner margin, Hu & Mordohai,
        IEEE TPAMI 34, 2012.
    """
    views, (low, high) = _grey_views(light_field), limits
    check_range("labels", labels, 1, whole=True)
    check_range("window", window, 1, whole=True)
    if not (np.isfinite(low) and np.isfinite(high) and high - low >= 2 / labels):  # a parabola needs three candidates
        expected = f"(lowest, highest) disparity in px per view step, at least {2 / labels:.3g} apart"
        raise SettingError("limits", repr(limits), expected)
    candidates = _Candidates(int(np.floor(low * labels)), int(np.ceil(high * labels)), labels)
    height, width = views.shape[2:]
    reach = max(-candidates.first, candidates.last) * max(views.shape[:2]) // (2 * labels)
    margin = 2 * window + reach + 4
    rows = max(2 * margin, int(_STRIP_BYTES / (16 * candidates.count * width)) - 2 * margin)
    result = np.empty((2, height, width))
    for first in range(0, height, rows):
        top, last = max(0, first - margin), min(height, first + rows)
        strip = _best(views[:, :, top : last + margin], candidates, window)
        result[:, first:last] = strip[:, first - top : last - top]
    return result[0], result[1]


def _grey_views(light_field: Any) -> Image:
    """``(V, U, H, W)`` float32 of a light field: mean over colours, checked and smoothed.

    Interpolation averages noise most half-way between pixels; without noise as fine as pixels it favours nothing.
    """
    from scipy.ndimage import gaussian_filter

    values = as_float64(light_field)
    shape = values.shape[-4:]
    odd = len(shape) == 4 and shape[0] % 2 == shape[1] % 2 == 1 and shape[0] * shape[1] > 1
    if values.ndim not in (4, 5) or values.size == 0 or not odd or min(shape[2:]) < 4:
        raise ShapeError(
            "light_field", f"shape {values.shape}", "(V, U, H, W) or (C, V, U, H, W), V and U odd, 4 × 4 pixels or more"
        )
    if not np.all(np.isfinite(values)):
        raise SettingError("light_field", "values that are not finite", "relative irradiance in [0, 1]")
    grey = (values if values.ndim == 4 else values.mean(0)).astype(np.float32)
    smooth: Image = gaussian_filter(grey, (0, 0, _PREFILTER, _PREFILTER), mode="nearest")
    return smooth


@dataclass(frozen=True)
class _Candidates:
    """Disparities ``first/per_pixel … last/per_pixel``, px per view step."""

    first: int
    last: int
    per_pixel: int

    @property
    def count(self) -> int:
        return self.last - self.first + 1


def _best(views: Image, candidates: _Candidates, window: int) -> Array:
    """Winner of the best half at every pixel, refined by a parabola, and its confidence: ``(2, H, W)``."""
    scores = _matching_scores(views, candidates)
    scores = _filtered(scores, views[views.shape[0] // 2, views.shape[1] // 2], window).max(axis=0)
    best = scores.argmax(axis=0)
    inner = best.clip(1, candidates.count - 2)
    before, peak, after = (
        np.take_along_axis(scores, (inner + step)[None], axis=0)[0].astype(np.float64) for step in (-1, 0, 1)
    )
    curvature = 2 * peak - before - after
    offset = np.where(curvature > 1e-9, (after - before) / (2 * np.maximum(curvature, 1e-9)), 0.0).clip(-0.5, 0.5)
    # at either end of the limits no parabola stands on both sides
    disparity = (candidates.first + best + np.where(best == inner, offset, 0.0)) / candidates.per_pixel
    return np.stack((disparity, _confidence(scores, best, max(1, candidates.per_pixel // 2))))


def _confidence(scores: Image, best: NDArray[np.intp], apart: int) -> Array:
    """See `match_views`; rivals are ``apart`` candidates from the best one, or more."""
    rival = np.zeros(best.shape, dtype=np.float32)
    for index, plane in enumerate(scores):
        np.maximum(rival, plane, out=rival, where=np.abs(best - index) >= apart)
    peak = np.take_along_axis(scores, best[None], axis=0)[0]
    margin = np.maximum(peak - rival, 0).astype(np.float64) / float(_TRUNCATION)
    return np.asarray(margin / (margin + _HALF_SURE), dtype=np.float64)


def _matching_scores(views: Image, labels: _Candidates) -> Image:
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
    # a grid of one row has nothing above or below: its empty halves stay at zero, below every other
    counts = np.maximum([rows * views.shape[1], columns * views.shape[0]], 1).repeat(2)
    scores /= counts.astype(np.float32)[:, None, None, None]
    return scores


def _add_view(
    scores: Image, halves: list[int], view: Image, place: tuple[int, int], centre: Image, labels: _Candidates
) -> None:
    """Candidates that are whole pixels apart share one interpolated view."""
    shape = view.shape
    for start in range(min(labels.per_pixel, labels.count)):
        base = labels.first + start
        (row, row_part), (column, column_part) = (divmod(-step * base, labels.per_pixel) for step in place)
        moved = _interpolated(view, row_part / labels.per_pixel, 0)
        moved = _features(_interpolated(moved, column_part / labels.per_pixel, 1))
        for turn, index in enumerate(range(start, labels.count, labels.per_pixel)):
            y, from_y = _overlap(shape[0], row - turn * place[0], row_part > 0)
            x, from_x = _overlap(shape[1], column - turn * place[1], column_part > 0)
            gain = _TRUNCATION - np.abs(moved[:, from_y, from_x] - centre[:, y, x]).sum(axis=0)
            np.maximum(gain, 0, out=gain)
            for half in halves:
                scores[half, index, y, x] += gain


def _features(image: Image) -> Image:
    """Brightness and weighted gradient, ``(3, H, W)``."""
    down, right = np.gradient(image)
    return np.stack((image, _GRADIENT_WEIGHT * down, _GRADIENT_WEIGHT * right))


def _filtered(scores: Image, guide: Image, radius: int) -> Image:
    """Guided filter of every plane of ``(..., H, W)`` along the edges of the guide ``(H, W)``."""
    from scipy.ndimage import uniform_filter

    def box(image: Image) -> Image:
        return uniform_filter(image, 2 * radius + 1, mode="nearest")

    mean = box(guide)
    variance = np.subtract(box(guide * guide), mean * mean, dtype=np.float32) + _REGULARISATION
    result = np.empty_like(scores)
    for plane in np.ndindex(scores.shape[:-2]):
        level = box(scores[plane])
        slope = np.divide(box(guide * scores[plane]) - mean * level, variance, dtype=np.float32)
        result[plane] = box(slope) * guide + box(level - slope * mean)
    return result


def _interpolated(image: Image, fraction: float, axis: int) -> Image:
    """``image`` at positions moved by ``fraction`` in [0, 1) along ``axis``, of the same shape.

    Cubic convolution of four pixels (Keys, IEEE TASSP 29, 1981); the edge pixels go on outside.
    """
    from scipy.ndimage import correlate1d

    if fraction == 0:
        return image
    f = fraction
    keys = ((-f + 2 * f**2 - f**3) / 2, (2 - 5 * f**2 + 3 * f**3) / 2, (f + 4 * f**2 - 3 * f**3) / 2, (f**3 - f**2) / 2)
    return correlate1d(image, keys, axis, mode="nearest", origin=-1)


def _overlap(length: int, offset: int, between: bool = False) -> tuple[slice, slice]:
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
        view = _interpolated(view, fraction, axis % view.ndim)
        slices.append(_overlap(view.shape[axis], offset, fraction > 0))
    (y, from_y), (x, from_x) = slices
    return view[..., from_y, from_x], (y, x)


def disparity_error(estimate: Any, truth: Any, mask: Any = None, *, bad: float = BAD_PIXEL) -> dict[str, float]:
    """Errors of a disparity map, px per view step.

    Args:
        estimate, truth: ``(H, W)``; pixels of unknown (not finite) truth never count.
        mask: ``(H, W)``, pixels to count.
        bad: error above which a pixel is bad.

    Returns:
        ``mae`` (mean absolute error), ``badpix`` (share in [0, 1] of pixels with an error above ``bad``),
        ``mse_x100`` (mean squared error × 100), ``pixels`` (how many counted), ``mae_of_constant`` (mean absolute error
        of the median of the truth, the best constant); ``nan`` where none counts.

    Raises:
        ShapeError: the shapes differ or are not those of maps.
    """
    x, y = pair(estimate, truth, ("H", "W"), optional=0)
    counted = np.isfinite(y)
    if mask is not None:
        chosen = as_float64(mask)
        check_shape("mask", chosen, y.shape)
        counted &= chosen != 0
    if not counted.any():
        return {"mae": np.nan, "badpix": np.nan, "mse_x100": np.nan, "pixels": 0.0, "mae_of_constant": np.nan}
    error, constant = np.abs(x[counted] - y[counted]), np.abs(y[counted] - np.median(y[counted]))
    return {
        "mae": float(error.mean()),
        "badpix": float((~(error <= bad)).mean()),  # an estimate that is not a number is a bad pixel, too
        "mse_x100": float(100 * (error**2).mean()),
        "pixels": float(counted.sum()),
        "mae_of_constant": float(constant.mean()),
    }
