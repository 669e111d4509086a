"""What views show together: disparity with its confidence, photographs refocused, and one with everything in focus."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tmca.errors import ShapeError, check_shape
from tmca.metrics.cubes import Array, as_float64
from tmca.metrics.disparity import Image, match_views, moved_view

_AROUND, _TEXTURE = 7, 0.02
"""Pixels within which the centre view varies, and by which share of its brightest, where there is texture."""
_SEARCHED, _LOOKED_AT = 120, 160
"""Pixels along the shorter side of the views that a range of disparities is searched in, and read from."""
_SPREAD, _LEAST = 0.5, 2.0
"""Px per view step that a search goes beyond the range, and that it is wide at least."""
_ALIKE = 5
"""Side of the windows in which a view is compared with the centre one, pixels."""


class Geometry(NamedTuple):
    """What the views of a light field show of the scene, seen from the centre view.

    Args:
        disparity: ``(H, W)`` px per view step, positive = nearer than the plane in focus.
        confidence: ``(H, W)`` from 0 to 1, see `tmca.metrics.match_views`.
        all_in_focus: ``(H, W)``, or ``(3, H, W)`` in colour, relative irradiance.
    """

    disparity: Array
    confidence: Array
    all_in_focus: Image


def has_parallax(light_field: Any) -> bool:
    """Whether disparity can be estimated: an odd grid of more than one view, 4 × 4 pixels or more, finite values."""
    shape = np.shape(light_field)
    if len(shape) not in (4, 5):
        return False
    rows, columns, height, width = shape[-4:]
    odd = rows % 2 == columns % 2 == 1 and rows * columns > 1 and min(height, width) >= 4
    return odd and bool(np.isfinite(light_field).all())


def view_geometry(light_field: Any) -> Geometry:
    """Disparity, its confidence, and the photograph with everything in focus.

    Args:
        light_field: ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first, V and U odd.

    Raises:
        ShapeError, SettingError: as of `tmca.metrics.estimate_disparity`.
    """
    values = np.asarray(light_field)
    limits = _search_limits(values) if has_parallax(values) else (-1.0, 1.0)  # what has none is refused by the next
    disparity, confidence = match_views(values, limits)
    return Geometry(disparity, confidence, all_in_focus(values, disparity))


def disparity_range(light_field: Any, disparity: Any = None) -> tuple[float, float] | None:
    """The 5 and 95 % quantiles of the disparity, px per view step, where there is texture; None where there is none.

    Args:
        light_field: as in `view_geometry`; without a disparity it is made smaller, to about 160 pixels, for the search.
        disparity: ``(H, W)``, where it is known.
    """
    views = _grey(light_field)
    if disparity is None:
        seen = _seen(views, _scale(views, _LOOKED_AT))
    else:
        seen = np.asarray(disparity)[_textured(views)]
    if not seen.size:
        return None
    low, high = (float(end) for end in np.quantile(seen, (0.05, 0.95)))
    return low, high


def _search_limits(light_field: Array) -> tuple[float, float]:
    """Ends of the search for a disparity at full size, from one in small views, which reaches as far as they overlap.

    What is nearer or farther than almost everything with texture is cut off.
    """
    views = _grey(light_field)
    scale = _scale(views, _SEARCHED)
    seen = _seen(views, scale) if scale > 1 else np.empty(0)
    if not seen.size:
        return -4.0 * scale, 4.0 * scale
    low, high = (float(end) for end in np.quantile(seen, (0.002, 0.998)))
    wider = max(_SPREAD, (_LEAST - (high - low)) / 2)
    return low - wider, high + wider


def _scale(views: Array, side: int) -> int:
    """Pixels per axis that are averaged into one for views of about ``side`` pixels."""
    return max(1, round(min(views.shape[2:]) / side))


def _seen(views: Array, scale: int) -> Array:
    """Disparities, px per view step, of all that has texture, from views that are made smaller."""
    small = _smaller(views, scale)
    textured = _textured(small)
    found: Array = scale * match_views(small)[0][textured] if textured.any() else np.empty(0)
    return found


def _grey(light_field: Any) -> Array:
    """``(V, U, H, W)`` float64, mean over colours."""
    values = as_float64(light_field)
    return values if values.ndim == 4 else values.mean(0)


def _smaller(views: Array, scale: int) -> Array:
    """Views whose pixels are means of ``scale`` × ``scale``; what is left over at the end is cut off."""
    height, width = (side // scale for side in views.shape[2:])
    cut = views[:, :, : height * scale, : width * scale]
    return cut.reshape(*views.shape[:2], height, scale, width, scale).mean((3, 5))


def _textured(views: Array) -> Any:
    """Where the centre view varies within a few pixels, so that its disparity is more than a guess."""
    from scipy.ndimage import uniform_filter

    view = views[views.shape[0] // 2, views.shape[1] // 2]
    variance = uniform_filter(view**2, _AROUND) - uniform_filter(view, _AROUND) ** 2
    bright = float(np.quantile(view, 0.995))
    return variance > (_TEXTURE * (bright if bright > 0 else 1.0)) ** 2


def colour_views(light_field: Any) -> Any:
    """``(V, U, H, W)`` or ``(3, V, U, H, W)`` with colours first → ``(V, U, H, W, C)``, C = 1 or 3.

    Raises:
        ShapeError: another shape, or V or U even where there is more than one row.
    """
    values = np.asarray(light_field)
    values = values[None] if values.ndim == 4 else values
    grid_of = values.ndim == 5 and values.size > 0 and (values.shape[1] == 1 or values.shape[1] & values.shape[2] & 1)
    if not grid_of or len(values) not in (1, 3):
        expected = "(V, U, H, W) or (3, V, U, H, W), V and U odd"
        raise ShapeError("light_field", f"shape {np.shape(light_field)}", expected)
    return np.moveaxis(values, 0, -1)


def refocus(light_field: Any, disparity: float) -> Image:
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
    views = np.moveaxis(colour_views(light_field), -1, 2).astype(np.float32)
    rows, columns, *shape = views.shape
    total, count = np.zeros(shape, dtype=np.float32), np.zeros(shape[-2:], dtype=np.float32)
    for v in range(rows):
        for u in range(columns):
            place = (v - rows // 2, u - columns // 2)
            moved, (y, x) = moved_view(views[v, u], place, disparity)
            total[:, y, x] += moved
            count[y, x] += 1
    total /= count  # the centre view reaches every pixel
    return total if np.ndim(light_field) == 5 else total[0]


def all_in_focus(light_field: Any, disparity: Any) -> Image:
    """The photograph that is sharp everywhere: every pixel is a mean over the views, focused on its own disparity.

    A view counts by exp(-(d/σ)²/2), d its mean difference from the centre view within 5 × 5 pixels and σ a robust
    spread of all of them: where it sees another surface, or the disparity is wrong, the centre view stays. It has less
    noise than the centre view; views that were estimated together share their errors, of which it removes little.

    Args:
        light_field: ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        disparity: ``(H, W)`` px per view step.

    Returns:
        ``(H, W)``, or ``(3, H, W)``, float32.

    Raises:
        ShapeError: not a light field, or a disparity of another size.
    """
    views = np.moveaxis(colour_views(light_field), -1, 2).astype(np.float32)
    shift = as_float64(disparity)
    check_shape("disparity", shift, views.shape[3:])
    rows, columns = views.shape[0] // 2, views.shape[1] // 2
    centre = views[rows, columns]
    moved, inside = _onto_centre(views, shift)
    if len(moved):
        apart = _differences(moved, centre)
        spread = max(1.4826 * float(np.median(np.abs(apart))), 1e-6)
        weights = np.exp(-((apart / np.float32(spread)) ** 2) / 2) * inside
        centre = (centre + np.einsum("nhw,nchw->chw", weights, moved)) / (1 + weights.sum(0))
    result: Image = centre.astype(np.float32)
    return result if np.ndim(light_field) == 5 else result[0]


def _onto_centre(views: Image, disparity: Array) -> tuple[Image, Any]:
    """All views but the centre one at (y - v·disparity, x - u·disparity), ``(N, C, H, W)``, and where they reach."""
    from scipy.ndimage import map_coordinates

    rows, columns, colours, height, width = views.shape
    y, x = np.mgrid[:height, :width]
    places = [(v, u) for v in range(rows) for u in range(columns) if (v, u) != (rows // 2, columns // 2)]
    moved = np.empty((len(places), colours, height, width), dtype=np.float32)
    inside = np.empty((len(places), height, width), dtype=bool)
    for index, (v, u) in enumerate(places):
        at = y - (v - rows // 2) * disparity, x - (u - columns // 2) * disparity
        inside[index] = (at[0] >= 0) & (at[0] <= height - 1) & (at[1] >= 0) & (at[1] <= width - 1)
        for colour in range(colours):
            map_coordinates(views[v, u, colour], at, moved[index, colour], order=3, mode="nearest")
    return moved, inside


def _differences(moved: Image, centre: Image) -> Image:
    """Means over colours and windows of what views differ from the centre one, ``(N, H, W)``."""
    from scipy.ndimage import uniform_filter

    apart: Image = uniform_filter((moved - centre).mean(1), (0, _ALIKE, _ALIKE))
    return apart
