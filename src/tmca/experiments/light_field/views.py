"""Light fields as pictures: one view, and slices through space and angle."""

from __future__ import annotations

import numpy as np

from tmca.errors import ShapeError

_ZOOMED, _LEAST = 0.25, 48
"""Share of each side that is enlarged, and pixels of the shorter side that it has at least."""


def colour_views(light_field: np.ndarray) -> np.ndarray:
    """``(V, U, H, W)`` or ``(3, V, U, H, W)`` with colours first → ``(V, U, H, W, C)``, C = 1 or 3.

    Raises:
        ShapeError: another shape, or V or U even.
    """
    values = np.asarray(light_field)
    values = values[None] if values.ndim == 4 else values
    if values.ndim != 5 or len(values) not in (1, 3) or values.size == 0 or not (values.shape[1] & values.shape[2] & 1):
        expected = "(V, U, H, W) or (3, V, U, H, W), V and U odd"
        raise ShapeError("light_field", f"shape {np.shape(light_field)}", expected)
    return np.moveaxis(values, 0, -1)


def brightest(light_field: np.ndarray) -> float:
    """Irradiance shown as white: the 99.5 % quantile of the centre view."""
    views = colour_views(light_field)
    level = float(np.quantile(views[views.shape[0] // 2, views.shape[1] // 2], 0.995))
    return level if level > 0 else 1.0


def shown(values: np.ndarray, white: float) -> np.ndarray:
    """``(..., C)`` irradiance → ``(..., 3)`` picture in [0, 1]."""
    return np.broadcast_to(np.clip(values / white, 0, 1), (*values.shape[:-1], 3))


def horizontal_slice(views: np.ndarray, row: int) -> np.ndarray:
    """Epipolar image of a row: the centre row of views ``(V, U, H, W, C)`` → ``(U, W, C)``."""
    return views[views.shape[0] // 2, :, row]


def vertical_slice(views: np.ndarray, column: int) -> np.ndarray:
    """Epipolar image of a column: the centre column of views ``(V, U, H, W, C)`` → ``(H, V, C)``."""
    return np.moveaxis(views[:, views.shape[1] // 2, :, column], 0, 1)


def liveliest(light_field: np.ndarray) -> tuple[int, int]:
    """The row and the column, away from the border, where the views differ most."""
    from scipy.ndimage import uniform_filter1d

    views = colour_views(light_field)
    rows, columns = views.shape[0] // 2, views.shape[1] // 2
    across, along = views[rows].std(axis=0).mean(axis=-1), views[:, columns].std(axis=0).mean(axis=-1)
    found = []
    for activity in (across.mean(axis=1), along.mean(axis=0)):
        smooth, edge = uniform_filter1d(activity.astype(np.float64), 5), len(activity) // 8
        inner = smooth[edge : len(activity) - edge]
        # alike everywhere, as in a single view: the middle
        found.append(edge + int(inner.argmax()) if np.ptp(inner) > 0 else len(activity) // 2)
    return found[0], found[1]


def zoom_window(light_field: np.ndarray) -> tuple[slice, slice]:
    """The part of the views that is worth enlarging: where they differ most.

    Returns:
        Rows and columns: a quarter of each side, more of views below 192 pixels, all of those below 48.
    """
    from scipy.ndimage import uniform_filter

    views = colour_views(light_field)
    v, u, height, width, _ = views.shape
    share = min(1.0, max(_ZOOMED, _LEAST / min(height, width)))
    h, w = round(share * height), round(share * width)
    activity = (views[v // 2].std(axis=0) + views[:, u // 2].std(axis=0)).mean(axis=-1).astype(np.float64)
    means = uniform_filter(activity, (h, w), mode="constant")
    centres = means[h // 2 : h // 2 + height - h + 1, w // 2 : w // 2 + width - w + 1]
    top, left = (int(place) for place in np.unravel_index(centres.argmax(), centres.shape))
    return slice(top, top + h), slice(left, left + w)
