"""Geometry of light fields: one plain disparity estimator for all, and the errors of disparity maps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, ShapeError
from tmca.metrics._matching import Labels, filtered, matching_scores
from tmca.metrics._pairs import Array, as_float64, require_same_shape

BAD_PIXEL = 0.07
"""Error above which a pixel is bad, px per view step (HCI 4-D light field benchmark)."""
_STRIP_BYTES = 1.2e8
_PREFILTER = 0.75


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
    views = _smoothed(grey_views(light_field))
    candidates = _candidates(limits, labels, window)
    height, width = views.shape[2:]
    reach = max(-candidates.first, candidates.last) * max(views.shape[:2]) // (2 * labels)
    margin = 2 * window + reach + 4
    rows = max(2 * margin, int(_STRIP_BYTES / (16 * candidates.count * width)) - 2 * margin)
    result = np.empty((height, width))
    for first in range(0, height, rows):
        top, last = max(0, first - margin), min(height, first + rows)
        strip = _best(views[:, :, top : last + margin], candidates, window)
        result[first:last] = strip[first - top : last - top]
    return result


def _smoothed(views: NDArray[np.float32]) -> NDArray[np.float32]:
    """Interpolation averages noise most half-way between pixels; without noise as fine as pixels it favours nothing."""
    from scipy.ndimage import gaussian_filter

    smooth: NDArray[np.float32] = gaussian_filter(views, (0, 0, _PREFILTER, _PREFILTER), mode="nearest")
    return smooth


def grey_views(light_field: Any) -> NDArray[np.float32]:
    """``(V, U, H, W)`` float32 of a light field, mean over colours, checked.

    Raises:
        ShapeError, SettingError: see :func:`estimate_disparity`.
    """
    values = as_float64(light_field)
    shape = values.shape[-4:]
    odd = len(shape) == 4 and shape[0] % 2 == shape[1] % 2 == 1 and shape[0] * shape[1] > 1
    if values.ndim not in (4, 5) or values.size == 0 or not odd or min(shape[2:]) < 4:
        raise ShapeError(
            "light_field", f"shape {values.shape}", "(V, U, H, W) or (C, V, U, H, W), V and U odd, 4 × 4 pixels or more"
        )
    if not np.all(np.isfinite(values)):
        raise SettingError("light_field", "values that are not finite", "relative irradiance in [0, 1]")
    return (values if values.ndim == 4 else values.mean(0)).astype(np.float32)


def _candidates(limits: tuple[float, float], labels: int, window: int) -> Labels:
    for name, value in (("labels", labels), ("window", window)):
        if value < 1 or value != int(value):
            raise SettingError(name, repr(value), "a whole number, 1 or more")
    low, high = limits
    # a parabola needs three candidates
    if not (np.isfinite(low) and np.isfinite(high) and high - low >= 2 / labels):
        expected = f"(lowest, highest) disparity in px per view step, at least {2 / labels:.3g} apart"
        raise SettingError("limits", repr(limits), expected)
    return Labels(int(np.floor(low * labels)), int(np.ceil(high * labels)), labels)


def _best(views: NDArray[np.float32], candidates: Labels, window: int) -> Array:
    """Winner of the best half at every pixel, refined by a parabola."""
    scores = matching_scores(views, candidates)
    scores = filtered(scores, views[views.shape[0] // 2, views.shape[1] // 2], window).max(axis=0)
    best = scores.argmax(axis=0)
    inner = best.clip(1, candidates.count - 2)
    before, peak, after = (
        np.take_along_axis(scores, (inner + step)[None], axis=0)[0].astype(np.float64) for step in (-1, 0, 1)
    )
    curvature = 2 * peak - before - after
    offset = np.where(curvature > 1e-9, (after - before) / (2 * np.maximum(curvature, 1e-9)), 0.0).clip(-0.5, 0.5)
    # at either end of the limits no parabola stands on both sides
    return (candidates.first + best + np.where(best == inner, offset, 0.0)) / candidates.per_pixel


def disparity_error(estimate: Any, truth: Any, mask: Any = None, *, bad: float = BAD_PIXEL) -> dict[str, float]:
    """Errors of a disparity map, px per view step.

    Args:
        estimate, truth: ``(H, W)``; pixels of unknown (not finite) truth never count.
        mask: ``(H, W)``, pixels to count.
        bad: error above which a pixel is bad.

    Returns:
        ``mae`` (mean absolute error), ``badpix`` (share in [0, 1] of pixels with an error above ``bad``),
        ``mse_x100`` (mean squared error × 100), ``pixels`` (how many counted); ``nan`` where none counts.

    Raises:
        ShapeError: the shapes differ or are not those of maps.
    """
    x, y = as_float64(estimate), as_float64(truth)
    require_same_shape(x, y)
    if x.ndim != 2 or x.size == 0:
        raise ShapeError("estimate, truth", f"shape {x.shape}", "(H, W)")
    known = np.isfinite(y)
    if mask is not None:
        chosen = as_float64(mask)
        require_same_shape(chosen, y)
        known &= chosen != 0
    count = int(known.sum())
    error = np.abs(x[known] - y[known])
    # an estimate that is not a number is a bad pixel, too
    found = (
        {"mae": error.mean(), "badpix": (~(error <= bad)).mean(), "mse_x100": 100 * (error**2).mean()} if count else {}
    )
    return {name: float(found.get(name, np.nan)) for name in ("mae", "badpix", "mse_x100")} | {"pixels": float(count)}
