"""One definition of every figure of merit."""

from __future__ import annotations

from tmca.metrics._subpixel import moved_view
from tmca.metrics.depth import depth_mae, depth_rmse, within_bin
from tmca.metrics.disparity import disparity_error, estimate_disparity
from tmca.metrics.light_field import light_field_metrics, psnr_per_view, ssim_per_view
from tmca.metrics.quality import psnr, ssim, uiqi
from tmca.metrics.spectra import dd, ergas, sam
from tmca.metrics.tables import all_metrics

__all__ = [
    "all_metrics",
    "dd",
    "depth_mae",
    "depth_rmse",
    "disparity_error",
    "ergas",
    "estimate_disparity",
    "light_field_metrics",
    "moved_view",
    "psnr",
    "psnr_per_view",
    "sam",
    "ssim",
    "ssim_per_view",
    "uiqi",
    "within_bin",
]
