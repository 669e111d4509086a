"""Figures of merit of light fields: PSNR and SSIM over all views and per view."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any

import numpy as np

from tmca.metrics._pairs import Array, pair
from tmca.metrics.cubes import SSIM_WINDOW, psnr, ssim

LIGHT_FIELD = ("C", "V", "U", "H", "W")


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
    flat = (-1, *x.shape[-2:])
    large = min(x.shape[-2:]) >= SSIM_WINDOW
    return {
        "psnr": psnr(x.reshape(flat), y.reshape(flat), data_range=data_range),
        "ssim": ssim(x.reshape(flat), y.reshape(flat), data_range=data_range) if large else nan,
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
