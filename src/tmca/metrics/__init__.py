"""One definition of every figure of merit."""

from __future__ import annotations

from tmca.metrics.cubes import (
    all_metrics,
    certainty,
    coverage_1s,
    coverage_2s,
    dd,
    ergas,
    light_field_metrics,
    psnr,
    psnr_per_view,
    rank_correlation,
    sam,
    ssim,
    ssim_per_view,
    uiqi,
)
from tmca.metrics.depth import depth_mae, depth_rmse, within_bin
from tmca.metrics.disparity import disparity_error, estimate_disparity, match_views, moved_view
from tmca.metrics.merits import MERITS, Merit, beside_constant, meaning, with_unit
from tmca.metrics.refocusing import Geometry, all_in_focus, disparity_range, refocus, view_geometry

__all__ = [
    "MERITS",
    "Geometry",
    "Merit",
    "all_in_focus",
    "all_metrics",
    "beside_constant",
    "certainty",
    "coverage_1s",
    "coverage_2s",
    "dd",
    "depth_mae",
    "depth_rmse",
    "disparity_error",
    "disparity_range",
    "ergas",
    "estimate_disparity",
    "light_field_metrics",
    "match_views",
    "meaning",
    "moved_view",
    "psnr",
    "psnr_per_view",
    "rank_correlation",
    "refocus",
    "sam",
    "ssim",
    "ssim_per_view",
    "uiqi",
    "view_geometry",
    "with_unit",
    "within_bin",
]


def __dir__() -> list[str]:
    return sorted(__all__)
