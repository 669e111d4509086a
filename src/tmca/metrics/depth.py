"""Figures of merit of depth maps: MAE and RMSE in metres, and the share of pixels within one depth bin."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, check_shape
from tmca.metrics.cubes import Array, Reduction, as_float64, pair, reduced


def depth_mae(estimate: Any, truth: Any, *, valid: Any = None, reduction: Reduction = "mean") -> Any:
    """Mean absolute error in metres over the valid pixels.

    Args:
        estimate, truth: depth in metres, ``(B, 1, H, W)``, ``(1, H, W)`` or ``(H, W)``.
        valid: pixels to count, same shape; those of unknown (not finite and positive) truth never count.
        reduction: ``"mean"`` over the batch (a float) or ``"none"`` (an array ``(B,)``).

    Returns:
        The error per image, then averaged; ``nan`` for an image without a valid pixel.

    Raises:
        ShapeError: the shapes differ or are not those of depth maps.
    """
    x, y, counted = _valid_pixels(estimate, truth, valid)
    return reduced(_mean_over(np.abs(x - y), counted), reduction)


def depth_rmse(estimate: Any, truth: Any, *, valid: Any = None, reduction: Reduction = "mean") -> Any:
    """Root mean square error in metres over the valid pixels; arguments as of :func:`depth_mae`."""
    x, y, counted = _valid_pixels(estimate, truth, valid)
    return reduced(np.sqrt(_mean_over((x - y) ** 2, counted)), reduction)


def within_bin(estimate: Any, truth: Any, planes: Any, *, valid: Any = None, reduction: Reduction = "mean") -> Any:
    """Share of valid pixels, in [0, 1], whose depth is at most one depth bin from the truth.

    Bins are counted in inverse depth, where depth planes are evenly spaced; between planes the count is
    interpolated, beyond the outermost it goes on at their spacing.

    Args:
        estimate, truth, valid, reduction: as of :func:`depth_mae`. An estimate that is not positive is outside.
        planes: ``(D,)`` depths of the planes in metres, at least two different ones.

    Raises:
        ShapeError: the shapes differ or are not those of depth maps.
        SettingError: fewer than two planes, or planes that are not positive and different.
    """
    depths = as_float64(planes).reshape(-1)
    if len(depths) < 2 or not np.all(depths > 0) or len(np.unique(depths)) < len(depths):
        raise SettingError("planes", f"{depths.tolist()}", "at least two different positive depths in metres")
    inverse = np.sort(1 / depths)
    x, y, counted = _valid_pixels(estimate, truth, valid)
    usable = np.isfinite(x) & (x > 0)
    distance = np.abs(_bin_index(1 / np.where(usable, x, 1.0), inverse) - _bin_index(1 / y, inverse))
    # Depths that lie one bin apart on paper may differ from it by rounding.
    return reduced(_mean_over((usable & (distance <= 1 + 1e-6)).astype(np.float64), counted), reduction)


def _bin_index(inverse_depth: Array, planes: Array) -> Array:
    """Position among ascending inverse depths ``(D,)``, as a real number."""
    lower = np.clip(np.searchsorted(planes, inverse_depth, side="right") - 1, 0, len(planes) - 2)
    return lower + (inverse_depth - planes[lower]) / (planes[lower + 1] - planes[lower])


def _valid_pixels(estimate: Any, truth: Any, valid: Any) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Estimate, truth with 1 m at unknown pixels, and which pixels count, each ``(B, pixels)``."""
    x, y = pair(estimate, truth, ("B", 1, "H", "W"), optional=2)
    counted = np.isfinite(y) & (y > 0)
    if valid is not None:
        mask = as_float64(valid)
        check_shape("valid", mask, np.shape(truth))
        counted &= mask.reshape(y.shape) != 0
    y = np.where(counted, y, 1.0)
    return x.reshape(len(x), -1), y.reshape(len(x), -1), counted.reshape(len(x), -1)


def _mean_over(values: Array, counted: NDArray[np.bool_]) -> Array:
    with np.errstate(invalid="ignore"):
        return np.sum(np.where(counted, values, 0.0), axis=1) / counted.sum(axis=1)
