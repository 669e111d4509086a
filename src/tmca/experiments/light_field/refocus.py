"""Refocusing a light field after the exposure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tmca.experiments.figures import grid, image
from tmca.experiments.light_field.views import brightest, colour_views, shown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def refocus(light_field: np.ndarray, disparity: float) -> np.ndarray:
    """The photograph focused on a disparity: all views moved onto the centre, then their mean.

    At (y, x) it takes view (v, u) at (y - v·disparity, x - u·disparity), between pixels by cubic interpolation.
    Views that do not reach a border pixel do not count there. Source: Ng et al., Stanford CSTR 2005-02.

    Args:
        light_field: ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        disparity: px per view step.

    Returns:
        ``(H, W)``, or ``(3, H, W)``, float32.

    Raises:
        ShapeError: not a light field.
    """
    from tmca.metrics import moved_view

    views = np.moveaxis(colour_views(light_field), -1, 2).astype(np.float32)
    rows, columns, *shape = views.shape
    total, count = np.zeros(shape, dtype=np.float32), np.zeros(shape[-2:], dtype=np.float32)
    for v in range(rows):
        for u in range(columns):
            place = (v - rows // 2, u - columns // 2)
            moved, (y, x) = moved_view(views[v, u], place, disparity)
            total[:, y, x] += moved
            count[y, x] += 1
    # the centre view reaches every pixel
    total /= count
    return total if np.ndim(light_field) == 5 else total[0]


def focus_steps(light_field: xr.DataArray, count: int = 5) -> list[float]:
    """Disparities to focus on, px per view step, evenly over the range that blocks of the views show.

    Args:
        light_field: (view_v, view_u, y, x), or with colours first.
        count: how many.

    Returns:
        From far to near; from -2 to 2 where there are fewer than 3×3 views or no texture, and at least 0.5 wide.
    """
    from tmca.data import view_shifts

    grey = light_field.mean("colour") if "colour" in light_field.dims else light_field
    shifts = view_shifts(grey) if min(grey.shape[:2]) >= 3 else np.zeros((0, 2))
    most = min(grey.shape[2:]) / (2 * max(grey.shape[:2]))  # beyond it views hardly overlap
    low, high = np.clip(np.percentile(shifts, [5, 95]), -most, most) if shifts.size else (-2.0, 2.0)
    wider = max(0.0, 0.25 - (high - low) / 2)
    return [float(step) for step in np.linspace(low - wider, high + wider, count)]


def refocus_strip(light_field: np.ndarray, disparities: Sequence[float], title: str = "") -> Figure:
    """The photograph focused on a few disparities, from far to near.

    Args:
        light_field: as in :func:`refocus`.
        disparities: px per view step.
        title: what stands above the strip.
    """
    white = brightest(light_field)
    height, width = np.shape(light_field)[-2:]
    figure, axes = grid(1, len(disparities), width=3.0, aspect=min(height / width, 2.5))
    for axis, disparity in zip(axes[0], sorted(disparities), strict=True):
        photograph = refocus(light_field, disparity)
        picture = np.moveaxis(photograph if photograph.ndim == 3 else photograph[None], 0, -1)
        image(axis, shown(picture, white), f"focus at {disparity:+.2f} px per view step")
    if title:
        figure.suptitle(title, fontsize=10)
    return figure
