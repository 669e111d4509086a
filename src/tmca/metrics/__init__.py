"""One definition of every figure of merit."""

from __future__ import annotations

from tmca.metrics.depth import depth_mae, depth_rmse, within_bin
from tmca.metrics.quality import psnr, ssim, uiqi
from tmca.metrics.spectra import dd, ergas, sam
from tmca.metrics.tables import all_metrics

__all__ = [
    "all_metrics",
    "dd",
    "depth_mae",
    "depth_rmse",
    "ergas",
    "psnr",
    "sam",
    "ssim",
    "uiqi",
    "within_bin",
]
