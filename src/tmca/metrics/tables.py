"""All figures of merit of a reconstructed cube at once."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np

from tmca.metrics.quality import psnr, ssim, uiqi
from tmca.metrics.spectra import dd, ergas, sam

_SSIM_WINDOW = 11


def all_metrics(
    estimate: Any, truth: Any, *, data_range: float = 1.0, window: int = 32, ratio: float = 1.0
) -> dict[str, float]:
    """``psnr`` (dB), ``ssim``, ``uiqi``, ``sam`` (degrees), ``ergas`` and ``dd``, averaged over the batch.

    On images smaller than the windows UIQI takes the largest window that fits, and SSIM is not a number.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        data_range, window, ratio: as in :func:`psnr`, :func:`uiqi` and :func:`ergas`.

    Raises:
        ShapeError: the shapes differ or are not those of cubes.
    """
    small = min(np.shape(truth)[-2:])
    return {
        "psnr": psnr(estimate, truth, data_range=data_range),
        "ssim": ssim(estimate, truth, data_range=data_range) if small >= _SSIM_WINDOW else nan,
        "uiqi": uiqi(estimate, truth, window=min(window, small)),
        "sam": sam(estimate, truth),
        "ergas": ergas(estimate, truth, ratio=ratio),
        "dd": dd(estimate, truth),
    }
