"""Light fields as pictures: a view, slices through space and angle, all views, photographs refocused, animations."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, isqrt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.errors import OutputError
from tmca.metrics.refocusing import colour_views, disparity_range, has_parallax, refocus
from tmca.plots.style import bright_level, grid, image, mosaic

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure
    from PIL import Image

_ZOOMED, _LEAST = 0.25, 48
"""Share of each side that is enlarged, and pixels of the shorter side that it has at least."""
_STEPS, _STRETCH = 5, 1.0
"""Photographs of a strip, and px per view step from the first to the last: with less all of them look alike."""
_IN_A_ROW = 5
_PIXELS, _REPEATED = 2.4e6, 4e6
"""Of all frames together, about a megabyte; repeated pixels take half as many bytes."""
_SIDE = 360
"""Pixels along the longer side that small views are enlarged to."""
_COLOURS = 64


def brightest(light_field: np.ndarray) -> float:
    """Irradiance shown as white: the 99.5 % quantile of the centre view."""
    views = colour_views(light_field)
    return bright_level(views[views.shape[0] // 2, views.shape[1] // 2])


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
    places = []
    for activity in (across.mean(axis=1), along.mean(axis=0)):
        smooth, edge = uniform_filter1d(activity.astype(np.float64), 5), len(activity) // 8
        inner = smooth[edge : len(activity) - edge]
        # alike everywhere, as in a single view: the middle
        places.append(edge + int(inner.argmax()) if np.ptp(inner) > 0 else len(activity) // 2)
    return places[0], places[1]


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


def light_field_views(
    centre: np.ndarray, every: np.ndarray, disparity: np.ndarray | None, title: str, said: str = "true disparity"
) -> Figure:
    """Centre view, mosaic of views and disparity beside one another.

    Args:
        centre: a light field whose middle view is shown, ``(V, U, H, W)`` or ``(3, V, U, H, W)`` with colours first.
        every: a light field of which every view is shown.
        disparity: ``(H, W)``, px per view step, or None.
        title: of the centre view.
        said: above the disparity.
    """
    height, width = centre.shape[-2:]
    figure, axes = grid(1, 2 if disparity is None else 3, width=4.6, aspect=height / width)
    views = as_pictures(centre)
    image(axes[0, 0], views[views.shape[0] // 2, views.shape[1] // 2], title, "gray", 1.0)
    rows, columns = every.shape[-4:-2]
    image(axes[0, 1], mosaic(as_pictures(every), gap=2, fill=1.0), f"{rows}×{columns} views", "gray", 1.0)
    if disparity is not None:
        image(axes[0, 2], disparity, said, "turbo", bar="px per view step, nearer is positive", low=None)
    return figure


def as_pictures(light_field: np.ndarray) -> np.ndarray:
    """``(V, U, H, W)`` grey or ``(V, U, H, W, 3)`` colour, in [0, 1]."""
    values = np.clip(light_field, 0, 1)
    return np.moveaxis(values, 0, -1) if values.ndim == 5 else values


def focus_steps(light_field: xr.DataArray, disparity: np.ndarray | None = None, count: int = _STEPS) -> list[float]:
    """Some disparities to focus on, px per view step, evenly over the range that the views show where there is texture.

    Args:
        light_field: (view_v, view_u, y, x), or with colours first.
        disparity: (y, x) of the centre view, where it is known; estimated from smaller views without.
        count: how many, five without.

    Returns:
        From far to near, from the 5 % to the 95 % quantile and at least 1 wide; from -2 to 2 where there is a single
        view, fewer than 4 × 4 pixels, or no texture.
    """
    grey = light_field.mean("colour") if "colour" in light_field.dims else light_field
    seen = disparity_range(grey.values, disparity) if has_parallax(grey.values) else None
    most = min(grey.shape[2:]) / (2 * max(grey.shape[:2]))  # beyond it views hardly overlap
    low, high = (-2.0, 2.0) if seen is None else (min(max(end, -most), most) for end in seen)
    wider = max(0.0, (_STRETCH - (high - low)) / 2)
    return [float(step) for step in np.linspace(low - wider, high + wider, count)]


def refocus_strip(light_field: np.ndarray, disparities: Sequence[float], title: str = "") -> Figure:
    """The photograph focused on a few disparities, from far to near.

    Args:
        light_field: as in `tmca.metrics.refocus`.
        disparities: px per view step.
        title: what stands above the strip.
    """
    steps = sorted(disparities)
    made = np.stack([refocus(light_field, step) for step in steps])
    pictures = np.moveaxis(made if made.ndim == 4 else made[:, None], 1, -1)
    return strip_figure(pictures, steps, brightest(light_field), title)


def strip_figure(pictures: np.ndarray, disparities: Sequence[float], white: float, title: str = "") -> Figure:
    """Photographs ``(N, H, W, C)`` side by side, each with the disparity that it is focused on.

    Args:
        pictures: relative irradiance.
        disparities: px per view step, one for each.
        white: irradiance shown as white.
        title: what stands above the strip.
    """
    height, width = pictures.shape[1:3]
    columns = min(_IN_A_ROW, len(pictures))
    rows = -(-len(pictures) // columns)
    figure, axes = grid(rows, columns, width=3.0, aspect=min(height / width, 2.5))
    for axis, picture, disparity in zip(axes.flat, pictures, disparities, strict=False):
        image(axis, shown(picture, white), f"focus at {disparity:+.2f} px per view step")
    if title:
        figure.set_figheight(figure.get_figheight() + 0.3)
        figure.set_layout_engine("constrained", h_pad=0.1)
        figure.suptitle(title, fontsize=10)
    return figure


def border_walk(rows: int, columns: int) -> list[tuple[int, int]]:
    """Views along the border, one step at a time and back to the first; to and fro where there is only one line."""
    if min(rows, columns) == 1:
        line = [(v, u) for v in range(rows) for u in range(columns)]
        return line + line[-2:0:-1]
    top = [(0, u) for u in range(columns)]
    right = [(v, columns - 1) for v in range(1, rows)]
    bottom = [(rows - 1, u) for u in range(columns - 2, -1, -1)]
    left = [(v, 0) for v in range(rows - 2, 0, -1)]
    return top + right + bottom + left


def views_gif(
    light_field: np.ndarray,
    path: str | Path,
    *,
    seconds: float = 1.6,
    white: float | None = None,
    overwrite: bool = False,
) -> Path:
    """Write an animated GIF that goes once round the border views and starts again.

    The views share 64 colours without dithering. They are made smaller where they have more than 2.4 million pixels in
    all, and small ones are enlarged by a whole factor towards 360 pixels along the longer side: the file stays near a
    megabyte.

    Args:
        light_field: ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        path: ends in ``.gif``.
        seconds: of one round.
        white: irradiance shown as white; that of the centre view without it.
        overwrite: replace an earlier file.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
        ShapeError: not a light field.
    """
    from PIL import Image

    from tmca.data import atomic_path

    if Path(path).suffix.lower() != ".gif":
        raise OutputError(path, f"the suffix {Path(path).suffix!r}", ".gif", "rename the animation")
    views, white = colour_views(light_field), brightest(light_field) if white is None else white
    walk = border_walk(*views.shape[:2])
    pixels = len(walk) * views[0, 0, ..., 0].size
    scale = min(1.0, (_PIXELS / pixels) ** 0.5)
    times = max(1, min(ceil(_SIDE / max(views.shape[2:4])), isqrt(int(_REPEATED / pixels))))
    frames = [_frame(views[place], white, scale) for place in walk]
    palette = Image.fromarray(np.hstack([np.asarray(f) for f in frames[:: max(1, len(frames) // 4)]]))
    palette = palette.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
    size = times * frames[0].width, times * frames[0].height
    few = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    drawn = [frame.resize(size, Image.Resampling.NEAREST) for frame in few]
    with atomic_path(path, overwrite=overwrite) as temporary:
        duration = max(20, round(1000 * seconds / len(drawn)))
        drawn[0].save(temporary, format="GIF", save_all=True, append_images=drawn[1:], duration=duration, loop=0)
    return Path(path)


def _frame(view: np.ndarray, white: float, scale: float) -> Image.Image:
    """A view ``(H, W, C)`` as an 8-bit image, made smaller by ``scale``."""
    from PIL import Image

    frame = Image.fromarray((255 * shown(view, white)).round().astype(np.uint8))
    size = (max(1, round(scale * frame.width)), max(1, round(scale * frame.height)))
    return frame if scale == 1 else frame.resize(size, Image.Resampling.LANCZOS)
