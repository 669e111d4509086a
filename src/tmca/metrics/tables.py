"""All figures of merit of a reconstructed cube at once."""

from __future__ import annotations

from typing import Any

from tmca.metrics.quality import psnr, ssim, uiqi
from tmca.metrics.spectra import dd, ergas, sam


def all_metrics(
    estimate: Any, truth: Any, *, data_range: float = 1.0, window: int = 32, ratio: float = 1.0
) -> dict[str, float]:
    """``psnr`` (dB), ``ssim``, ``uiqi``, ``sam`` (degrees), ``ergas`` and ``dd``, averaged over the batch.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        data_range, window, ratio: as in :func:`psnr`, :func:`uiqi` and :func:`ergas`.

    Raises:
        ShapeError: the shapes differ, are not those of cubes, or are smaller than a window.
    """
    return {
        "psnr": psnr(estimate, truth, data_range=data_range),
        "ssim": ssim(estimate, truth, data_range=data_range),
        "uiqi": uiqi(estimate, truth, window=window),
        "sam": sam(estimate, truth),
        "ergas": ergas(estimate, truth, ratio=ratio),
        "dd": dd(estimate, truth),
    }
