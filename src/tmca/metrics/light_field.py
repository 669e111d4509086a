"""Figures of merit of light fields: PSNR and SSIM over all views and per view."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np

from tmca.errors import ShapeError
from tmca.metrics._pairs import Array, as_float64, require_same_shape
from tmca.metrics.quality import SSIM_WINDOW, psnr, ssim


def light_field_metrics(estimate: Any, truth: Any, *, data_range: float = 1.0) -> dict[str, float]:
    """``psnr`` over the whole light field (dB), ``ssim`` (mean over views), ``psnr_min`` and ``psnr_max`` of a view.

    SSIM is not a number for views smaller than its window.

    Args:
        estimate, truth: ``(V, U, H, W)``, or ``(C, V, U, H, W)`` with colours first.
        data_range: the span between black and white.

    Raises:
        ShapeError: the shapes differ or are not those of light fields.
    """
    x, y = _pair(estimate, truth)
    views = psnr_per_view(x, y, data_range=data_range)
    flat = (-1, *x.shape[-2:])
    large = min(x.shape[-2:]) >= SSIM_WINDOW
    return {
        "psnr": psnr(x.reshape(flat), y.reshape(flat), data_range=data_range),
        "ssim": ssim(x.reshape(flat), y.reshape(flat), data_range=data_range) if large else nan,
        "psnr_min": float(views.min()),
        "psnr_max": float(views.max()),
    }


def psnr_per_view(estimate: Any, truth: Any, *, data_range: float = 1.0) -> Array:
    """PSNR of every view in dB, ``(V, U)``, over all its colours; arguments as :func:`light_field_metrics`."""
    x, y = (_views_as_batch(values) for values in _pair(estimate, truth))
    values: Array = psnr(x, y, data_range=data_range, reduction="none")
    return values.reshape(np.shape(truth)[-4:-2])


def ssim_per_view(estimate: Any, truth: Any, *, data_range: float = 1.0) -> Array:
    """SSIM of every view, ``(V, U)``, mean over its colours; arguments as :func:`light_field_metrics`."""
    x, y = (_views_as_batch(values) for values in _pair(estimate, truth))
    values: Array = ssim(x, y, data_range=data_range, reduction="none")
    return values.reshape(np.shape(truth)[-4:-2])


def _views_as_batch(values: Array) -> Array:
    """``(C, V, U, H, W)`` → ``(V·U, C, H, W)``."""
    return np.moveaxis(values.reshape(len(values), -1, *values.shape[-2:]), 0, 1)


def _pair(estimate: Any, truth: Any) -> tuple[Array, Array]:
    """Both as ``(C, V, U, H, W)``."""
    x, y = as_float64(estimate), as_float64(truth)
    require_same_shape(x, y)
    if x.ndim not in (4, 5) or x.size == 0:
        raise ShapeError("estimate, truth", f"shape {x.shape}", "(V, U, H, W) or (C, V, U, H, W)")
    return (x, y) if x.ndim == 5 else (x[None], y[None])
