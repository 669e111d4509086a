"""One definition of every figure of merit."""

from __future__ import annotations

from tmca.metrics.cubes import (
    all_metrics,
    dd,
    ergas,
    light_field_metrics,
    psnr,
    psnr_per_view,
    sam,
    ssim,
    ssim_per_view,
    uiqi,
)
from tmca.metrics.depth import depth_mae, depth_rmse, within_bin
from tmca.metrics.disparity import disparity_error, estimate_disparity, moved_view

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


def __dir__() -> list[str]:
    return sorted(__all__)
