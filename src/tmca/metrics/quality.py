"""Figures of merit of images, band by band: PSNR, SSIM, UIQI."""

from __future__ import annotations

from typing import Any

import numpy as np

from tmca.errors import SettingError, ShapeError
from tmca.metrics._pairs import Array, Reduction, cube_pair, reduced

SSIM_WINDOW, SSIM_SIGMA = 11, 1.5


def psnr(estimate: Any, truth: Any, *, data_range: float = 1.0, reduction: Reduction = "mean") -> Any:
    """Peak signal-to-noise ratio in dB, ``10 log10(data_range² / MSE)``, over each whole cube.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        data_range: the span between black and white.
        reduction: ``"mean"`` over the batch (a float) or ``"none"`` (an array ``(B,)``).

    Returns:
        PSNR per image, then averaged; identical cubes have ``inf``.

    Raises:
        ShapeError: the shapes differ or are not those of cubes.
        SettingError: ``data_range`` is not positive.
    """
    _require_positive("data_range", data_range)
    x, y = cube_pair(estimate, truth)
    mse = np.mean((x - y) ** 2, axis=(1, 2, 3))
    with np.errstate(divide="ignore"):
        return reduced(20 * np.log10(data_range) - 10 * np.log10(mse), reduction)


def ssim(estimate: Any, truth: Any, *, data_range: float = 1.0, reduction: Reduction = "mean") -> Any:
    """Structural similarity, mean over bands and pixels.

    Gaussian window of 11 × 11 with σ = 1.5, ``K1 = 0.01``, ``K2 = 0.03``, biased (co)variances. Only windows
    that lie wholly inside the image count, so no border is invented. Source: Wang et al., IEEE TIP 13, 2004.

    Args, Returns: as :func:`psnr`.

    Raises:
        ShapeError: shapes differ, are not those of cubes, or are smaller than the window.
        SettingError: ``data_range`` is not positive.
    """
    _require_positive("data_range", data_range)
    x, y = cube_pair(estimate, truth)
    _require_window(x, SSIM_WINDOW, "SSIM's window is fixed: compare larger images")
    c1, c2 = (0.01 * data_range) ** 2, (0.03 * data_range) ** 2
    per_image = [
        np.mean([_ssim_band(a, b, c1, c2) for a, b in zip(p, q, strict=True)]) for p, q in zip(x, y, strict=True)
    ]
    return reduced(np.array(per_image), reduction)


def _ssim_band(x: Array, y: Array, c1: float, c2: float) -> float:
    mean_x, mean_y = _gaussian_mean(x), _gaussian_mean(y)
    mean_xy, square = mean_x * mean_y, mean_x**2 + mean_y**2
    covariance = _gaussian_mean(x * y) - mean_xy
    variances = _gaussian_mean(x * x + y * y) - square
    index = (2 * mean_xy + c1) * (2 * covariance + c2) / ((square + c1) * (variances + c2))
    return float(index.mean())


def _gaussian_mean(image: Array) -> Array:
    """Gaussian-weighted means over the windows that lie inside an ``(H, W)`` image."""
    from scipy.ndimage import correlate1d

    radius = SSIM_WINDOW // 2
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / SSIM_SIGMA) ** 2)
    taps /= taps.sum()
    rows = correlate1d(image, taps, axis=0)[radius:-radius]
    return correlate1d(rows, taps, axis=1)[:, radius:-radius]


def uiqi(estimate: Any, truth: Any, *, window: int = 32, reduction: Reduction = "mean") -> Any:
    """Universal image quality index: sliding uniform ``window × window``, mean over windows and bands.

    ``Q = 4 σ_xy x̄ ȳ / ((σ_x² + σ_y²)(x̄² + ȳ²))``. A window where the denominator is zero (both flat, or both
    of zero mean) counts 1 if the two are equal there, else 0. Source: Wang & Bovik, IEEE SPL 9(3), 2002.

    Args, Returns: as :func:`psnr`, with ``window`` in pixels.

    Raises:
        ShapeError: shapes differ, are not those of cubes, or are smaller than the window.
        SettingError: ``window`` is below 2.
    """
    if window < 2 or window != int(window):
        raise SettingError("window", repr(window), "a whole number of pixels, 2 or more")
    x, y = cube_pair(estimate, truth)
    _require_window(x, window, "pass a smaller window= or compare larger images")
    per_image = [
        np.mean([_uiqi_band(a, b, window) for a, b in zip(p, q, strict=True)]) for p, q in zip(x, y, strict=True)
    ]
    return reduced(np.array(per_image), reduction)


def _uiqi_band(x: Array, y: Array, window: int) -> float:
    """Sums over n pixels instead of means: n² cancels between numerator and denominator."""
    n = window * window
    sum_x, sum_y = _window_sum(x, window), _window_sum(y, window)
    energy = n * _window_sum(x * x + y * y, window)
    squares = sum_x**2 + sum_y**2
    covariance = n * _window_sum(x * y, window) - sum_x * sum_y
    variances = energy - squares
    # Below rounding of the two subtractions a window is flat, or its mean zero.
    rounding = 64 * np.finfo(np.float64).eps * energy
    undefined = (variances <= rounding) | (squares <= rounding)
    equal = _window_sum((x != y).astype(np.float64), window) == 0
    denominator = np.where(undefined, 1.0, variances * squares)
    index = np.where(undefined, equal.astype(np.float64), 4 * covariance * sum_x * sum_y / denominator)
    return float(index.mean())


def _window_sum(image: Array, window: int) -> Array:
    """Sums over every ``window × window`` window inside an ``(H, W)`` image."""
    return _run_sum(_run_sum(image, window).T, window).T


def _run_sum(values: Array, length: int) -> Array:
    """Sums of ``length`` neighbours along axis 0 by doubling.

    Unlike cumulative sums it adds nothing from outside the window, so dark windows keep their precision.
    """
    count = values.shape[0] - length + 1
    total, offset, power, width = np.zeros((count, *values.shape[1:])), 0, values, 1
    while width <= length:
        if length & width:
            total += power[offset : offset + count]
            offset += width
        power = power[:-width] + power[width:] if 2 * width <= length else power
        width *= 2
    return total


def _require_window(cube: Array, window: int, remedy: str) -> None:
    height, width = cube.shape[-2:]
    if min(height, width) < window:
        raise ShapeError("estimate, truth", f"images of {height} × {width}", f"at least {window} × {window}", remedy)


def _require_positive(name: str, value: float) -> None:
    if not value > 0:
        raise SettingError(name, repr(value), "a positive number")
