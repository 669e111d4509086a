"""Light fields as pictures: one view, and slices through space and angle."""

from __future__ import annotations

import numpy as np

from tmca.errors import ShapeError

_GAP = 3


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


def ortho_slices(views: np.ndarray, row: int, column: int, white: float) -> np.ndarray:
    """The centre view with the vertical slice at its right and the horizontal slice below, as a picture.

    Args:
        views: ``(V, U, H, W, C)``.
        row, column: where the slices are taken; their views are repeated to about an eighth of the picture.

    Returns:
        ``(H + gap + U·zoom, W + gap + V·zoom, 3)``, white between the parts.
    """
    v, u, height, width, _ = views.shape
    zoom = max(1, round(min(height, width) / (7 * max(v, u))))
    below = np.repeat(shown(horizontal_slice(views, row), white), zoom, axis=0)
    beside = np.repeat(shown(vertical_slice(views, column), white), zoom, axis=1)
    gap = max(1, round(_GAP * max(height, width) / 500))
    sheet = np.ones((height + gap + len(below), width + gap + beside.shape[1], 3))
    sheet[:height, :width] = shown(views[v // 2, u // 2], white)
    sheet[height + gap :, :width] = below
    sheet[:height, width + gap :] = beside
    return sheet
