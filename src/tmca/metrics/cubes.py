"""Figures of merit of cubes and light fields.

PSNR, SSIM and UIQI band by band, SAM, ERGAS and DD of spectra, PSNR and SSIM of views.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, ShapeError, check_choice, check_range, check_shape

Array = NDArray[np.float64]
Reduction = Literal["mean", "none"]
CUBE = ("B", "L", "H", "W")
LIGHT_FIELD = ("C", "V", "U", "H", "W")
SSIM_WINDOW, SSIM_SIGMA = 11, 1.5


def all_metrics(
    estimate: Any, truth: Any, *, data_range: float = 1.0, window: int = 32, ratio: float = 1.0
) -> dict[str, float]:
    """``psnr`` (dB), ``ssim``, ``uiqi``, ``sam`` (degrees), ``ergas`` and ``dd``, averaged over the batch.

    On images smaller than the windows UIQI takes the largest window that fits, and SSIM is not a number.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        data_range, window, ratio: as in :func:`psnr`, :func:`uiqi` and :func:`ergas`.
    """
    small = min(np.shape(truth)[-2:])
    return {
        "psnr": psnr(estimate, truth, data_range=data_range),
        "ssim": ssim(estimate, truth, data_range=data_range) if small >= SSIM_WINDOW else nan,
        "uiqi": uiqi(estimate, truth, window=min(window, small)),
        "sam": sam(estimate, truth),
        "ergas": ergas(estimate, truth, ratio=ratio),
        "dd": dd(estimate, truth),
    }


def psnr(estimate: Any, truth: Any, *, data_range: float = 1.0, reduction: Reduction = "mean") -> Any:
    """Peak signal-to-noise ratio in dB, ``10 log10(data_range² / MSE)``, over each whole cube.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        data_range: the span between black and white.
        reduction: ``"mean"`` over the batch (a float) or ``"none"`` (an array ``(B,)``).

    Returns:
        The figure of each image, then averaged; identical cubes have ``inf``.

    Raises:
        ShapeError: the shapes differ, are not those of cubes, or are smaller than a window.
        SettingError: an impossible ``data_range``, ``window``, ``ratio`` or ``reduction``.
    """
    check_range("data_range", data_range, above=0)
    x, y = pair(estimate, truth)
    mse = np.mean((x - y) ** 2, axis=(1, 2, 3))
    with np.errstate(divide="ignore"):
        return reduced(20 * np.log10(data_range) - 10 * np.log10(mse), reduction)


def ssim(estimate: Any, truth: Any, *, data_range: float = 1.0, reduction: Reduction = "mean") -> Any:
    """Structural similarity, mean over bands and pixels.

    Gaussian window of 11 × 11 with σ = 1.5, ``K1 = 0.01``, ``K2 = 0.03``, biased (co)variances. Only windows
    that lie wholly inside the image count, so no border is invented. Source: Wang et al., IEEE TIP 13, 2004.

    Arguments and errors as of :func:`psnr`.
    """
    check_range("data_range", data_range, above=0)
    x, y = pair(estimate, truth)
    _check_window(x, SSIM_WINDOW, "SSIM's window is fixed: compare larger images")
    from skimage.metrics import structural_similarity

    how = {"gaussian_weights": True, "sigma": SSIM_SIGMA, "use_sample_covariance": False, "data_range": data_range}
    return reduced(_over_bands(x, y, lambda a, b: structural_similarity(a, b, **how)), reduction)


def uiqi(estimate: Any, truth: Any, *, window: int = 32, reduction: Reduction = "mean") -> Any:
    """Universal image quality index: sliding uniform ``window × window``, mean over windows and bands.

    ``Q = 4 σ_xy x̄ ȳ / ((σ_x² + σ_y²)(x̄² + ȳ²))``. A window where the denominator is zero (both flat, or both
    of zero mean) counts 1 if the two are equal there, else 0. Source: Wang & Bovik, IEEE SPL 9(3), 2002.

    Arguments and errors as of :func:`psnr`.
    """
    check_range("window", window, 2, unit="pixels", whole=True)
    x, y = pair(estimate, truth)
    _check_window(x, window, "pass a smaller window= or compare larger images")
    return reduced(_over_bands(x, y, lambda a, b: _uiqi_band(a, b, window)), reduction)


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


def _check_window(cube: Array, window: int, remedy: str) -> None:
    height, width = cube.shape[-2:]
    if min(height, width) < window:
        raise ShapeError("estimate, truth", f"images of {height} × {width}", f"at least {window} × {window}", remedy)


def _over_bands(x: Array, y: Array, metric: Callable[[Array, Array], float]) -> Array:
    """(B,) mean over the bands of every cube."""
    return np.array([np.mean([metric(a, b) for a, b in zip(p, q, strict=True)]) for p, q in zip(x, y, strict=True)])


def sam(estimate: Any, truth: Any, *, reduction: Reduction = "mean", return_excluded: bool = False) -> Any:
    """Spectral angle mapper in degrees: mean over pixels of the angle between estimated and true spectrum.

    Pixels whose true spectrum is zero have no angle: they are left out, and counted. A zero estimate of a
    spectrum that is not zero counts 90°. Angles come from ``2 atan2(‖u - v‖, ‖u + v‖)``, precise near 0 too.

    Arguments and errors as of :func:`psnr`; with ``return_excluded`` it returns ``(angle, count)``, the number of
    pixels left out reduced by summing. An image without a single true spectrum has ``nan``.
    """
    x, y = pair(estimate, truth)
    excluded = ~np.any(y != 0, axis=1)
    angles = np.where(excluded, 0.0, _angles(x, y))
    counted = np.sum(~excluded, axis=(1, 2)).astype(np.float64)
    with np.errstate(invalid="ignore"):
        angle = reduced(np.degrees(angles.sum(axis=(1, 2)) / counted), reduction)
    if not return_excluded:
        return angle
    left_out = excluded.sum(axis=(1, 2))
    return angle, (left_out if reduction == "none" else int(left_out.sum()))


def _angles(x: Array, y: Array) -> Array:
    """Angles in radians along axis 1; a zero spectrum is at a right angle to everything."""
    u, v = _unit(x), _unit(y)
    angles = 2 * np.arctan2(np.linalg.norm(u - v, axis=1), np.linalg.norm(u + v, axis=1))
    zero = ~(np.any(x != 0, axis=1) & np.any(y != 0, axis=1))
    return np.where(zero, np.pi / 2, angles)


def _unit(spectra: Array) -> Array:
    # Scaling by the largest entry first keeps tiny spectra from underflowing when squared.
    largest = np.max(np.abs(spectra), axis=1, keepdims=True)
    scaled = spectra / np.where(largest == 0, 1.0, largest)
    norm = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(norm == 0, 1.0, norm)


def ergas(estimate: Any, truth: Any, *, ratio: float = 1.0, reduction: Reduction = "mean") -> Any:
    """Relative global error in synthesis, ``100/ratio · sqrt(mean_ℓ (RMSE_ℓ / mean_ℓ)²)``, the truth's means.

    ``ratio`` is that of the resolutions, as in pan-sharpening; 1 when both have the same. A band whose true mean is
    zero adds nothing if it is estimated exactly and makes the error infinite otherwise. Source: Wald, 2000.

    Arguments and errors as of :func:`psnr`.
    """
    check_range("ratio", ratio, above=0)
    x, y = pair(estimate, truth)
    mse = np.mean((x - y) ** 2, axis=(2, 3))
    squared_mean = np.mean(y, axis=(2, 3)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(mse == 0, 0.0, mse / squared_mean)
    return reduced(100 / ratio * np.sqrt(relative.mean(axis=1)), reduction)


def dd(estimate: Any, truth: Any, *, reduction: Reduction = "mean") -> Any:
    """Degree of distortion, ``‖x - x̂‖₁ / number of entries``; arguments and errors as of :func:`psnr`."""
    x, y = pair(estimate, truth)
    return reduced(np.mean(np.abs(x - y), axis=(1, 2, 3)), reduction)


def coverage_1s(estimate: Any, truth: Any, deviation: Any) -> float:
    """Share of values, in [0, 1], that lie at most one predicted standard deviation from the truth.

    0.68 is expected of normal errors: less says that the deviation is too small, as it is where scenes differ from
    those that the prior knows; more, that it is too large.

    Args:
        estimate, truth, deviation: of one shape, whichever it is.

    Raises:
        ShapeError: the shapes differ.
    """
    error, sigma = _errors(estimate, truth, deviation)
    return float(np.mean(error <= sigma))


def coverage_2s(estimate: Any, truth: Any, deviation: Any) -> float:
    """Share of values that lie at most two predicted standard deviations from the truth, as `coverage_1s`; 0.95 is
    expected of normal errors."""
    error, sigma = _errors(estimate, truth, deviation)
    return float(np.mean(error <= 2 * sigma))


def rank_correlation(estimate: Any, truth: Any, deviation: Any) -> float:
    """Spearman's rank correlation of predicted deviation and absolute error, in [-1, 1]; as `coverage_1s`.

    It says whether the deviation is large where the error is. Normal errors of exactly known deviation stay below 1:
    0.5 where the deviation's natural logarithm has a spread of 0.65. It is not a number where either is constant.
    """
    from scipy.stats import rankdata

    ranks = [rankdata(values) for values in _errors(estimate, truth, deviation)]
    centred = [rank - rank.mean() for rank in ranks]
    scale = np.sqrt(np.prod([np.sum(rank**2) for rank in centred]))
    return float(np.sum(centred[0] * centred[1]) / scale) if scale > 0 else nan


def certainty(estimate: Any, truth: Any, deviation: Any) -> dict[str, float]:
    """`coverage_1s`, `coverage_2s` and `rank_correlation` by name; arguments and errors as theirs."""
    measures = (coverage_1s, coverage_2s, rank_correlation)
    return {measure.__name__: measure(estimate, truth, deviation) for measure in measures}


def _errors(estimate: Any, truth: Any, deviation: Any) -> tuple[Array, Array]:
    """Absolute errors and their deviations, flat."""
    x, y, sigma = (as_float64(values) for values in (estimate, truth, deviation))
    check_shape("estimate", x, y.shape, "crop, resample or transpose one of them: metrics never broadcast")
    check_shape("deviation", sigma, y.shape)
    return np.abs(x - y).ravel(), sigma.ravel()


def light_field_metrics(estimate: Any, truth: Any, *, data_range: float = 1.0) -> dict[str, float]:
    """``psnr`` over the whole light field (dB), ``ssim`` (mean over views), ``psnr_min`` and ``psnr_max`` of a view.

    SSIM is not a number for views smaller than its window.

    Args:
        estimate, truth: ``(V, U, H, W)``, or ``(C, V, U, H, W)`` with colours first.
        data_range: the span between black and white.

    Raises:
        ShapeError: the shapes differ or are not those of light fields.
    """
    x, y = pair(estimate, truth, LIGHT_FIELD)
    views = psnr_per_view(x, y, data_range=data_range)
    flat = [values.reshape(-1, *x.shape[-2:]) for values in (x, y)]
    return {
        "psnr": psnr(*flat, data_range=data_range),
        "ssim": ssim(*flat, data_range=data_range) if min(x.shape[-2:]) >= SSIM_WINDOW else nan,
        "psnr_min": float(views.min()),
        "psnr_max": float(views.max()),
    }


def psnr_per_view(estimate: Any, truth: Any, *, data_range: float = 1.0) -> Array:
    """PSNR of every view in dB, ``(V, U)``, over all its colours; arguments as of :func:`light_field_metrics`."""
    return _per_view(psnr, estimate, truth, data_range)


def ssim_per_view(estimate: Any, truth: Any, *, data_range: float = 1.0) -> Array:
    """SSIM of every view, ``(V, U)``, mean over its colours; arguments as of :func:`light_field_metrics`."""
    return _per_view(ssim, estimate, truth, data_range)


def _per_view(metric: Callable[..., Any], estimate: Any, truth: Any, data_range: float) -> Array:
    """A figure of images, of the views as a batch of images ``(V·U, C, H, W)``."""
    x, y = pair(estimate, truth, LIGHT_FIELD)
    images = (np.moveaxis(v.reshape(len(v), -1, *v.shape[-2:]), 0, 1) for v in (x, y))
    values: Array = metric(*images, data_range=data_range, reduction="none")
    return values.reshape(x.shape[1:3])


def pair(estimate: Any, truth: Any, axes: Sequence[Any] = CUBE, optional: int = 1) -> tuple[Array, Array]:
    """Both with all axes, of which the first ``optional`` may be missing.

    Raises:
        ShapeError: the shapes differ, or are not those of the axes.
    """
    x, y = as_float64(estimate), as_float64(truth)
    check_shape("estimate", x, y.shape, "crop, resample or transpose one of them: metrics never broadcast")
    missing = len(axes) - x.ndim
    if 0 < missing <= optional:
        x, y = (values.reshape((1,) * missing + values.shape) for values in (x, y))
    check_shape("estimate, truth", x, axes)
    return x, y


def as_float64(values: Any) -> Array:
    """A float64 array from a torch tensor, a labelled array or anything numpy reads.

    Labelled arrays are first brought to the order ``(..., wavelength, y, x)``.
    """
    if hasattr(values, "dims") and hasattr(values, "transpose"):
        last = [name for name in ("wavelength", "y", "x") if name in values.dims]
        values = values.transpose(..., *last).values
    elif hasattr(values, "detach"):
        values = values.detach().cpu().double().numpy()
    array = np.asarray(values)
    if np.iscomplexobj(array) or array.dtype.kind not in "fiub":
        raise SettingError("metric", f"values of type {array.dtype}", "real numbers", "pass an intensity")
    return array.astype(np.float64, copy=False)


def reduced(per_image: Array, reduction: Reduction) -> Any:
    """The mean over the batch as a python float, or the array ``(B,)`` itself for ``"none"``."""
    check_choice("reduction", reduction, ("mean", "none"))
    return per_image if reduction == "none" else float(per_image.mean())
