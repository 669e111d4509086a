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

_SEARCHED = 160
_LEAST = 1.0
"""Px per view step, from the first step to the last: with less all pictures of a strip look alike."""
_AROUND, _TEXTURE = 7, 0.02


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
    """Disparities to focus on, px per view step, evenly over the range that the views show where there is texture.

    The estimator of `tmca.metrics` looks at views made smaller, to about 160 pixels along the shorter side.

    Args:
        light_field: (view_v, view_u, y, x), or with colours first.
        count: how many.

    Returns:
        From far to near, from the 5 % to the 95 % quantile and at least 1 wide; from -2 to 2 where there is a single
        view, fewer than 4 × 4 pixels, or no texture.
    """
    from tmca.metrics import estimate_disparity

    grey = light_field.mean("colour") if "colour" in light_field.dims else light_field
    scale = max(1, round(min(grey.shape[2:]) / _SEARCHED))
    small = grey.coarsen(y=scale, x=scale, boundary="trim").mean().values
    low, high = -2.0, 2.0
    if max(small.shape[:2]) > 1 and min(small.shape[2:]) >= 4 and (textured := _textured(small)).any():
        most = min(grey.shape[2:]) / (2 * max(grey.shape[:2]))  # beyond it views hardly overlap
        found = scale * estimate_disparity(small)[textured]
        low, high = (float(end) for end in np.quantile(found, (0.05, 0.95)).clip(-most, most))
    wider = max(0.0, (_LEAST - (high - low)) / 2)
    return [float(step) for step in np.linspace(low - wider, high + wider, count)]


def _textured(views: np.ndarray) -> np.ndarray:
    """Where the centre view varies within a few pixels, so that its disparity is more than a guess."""
    from scipy.ndimage import uniform_filter

    view = views[views.shape[0] // 2, views.shape[1] // 2].astype(np.float64)
    variance = uniform_filter(view**2, _AROUND) - uniform_filter(view, _AROUND) ** 2
    return np.asarray(variance > (_TEXTURE * brightest(views)) ** 2)


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
        figure.set_figheight(figure.get_figheight() + 0.3)
        figure.set_layout_engine("constrained", h_pad=0.1)
        figure.suptitle(title, fontsize=10)
    return figure
