"""The picture of a light field that is looked at as it is: centre view, all views, true disparity."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.experiments.figures import add_bar, bare, grid

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_MOSAIC_PX = 1100
"""Sides of the mosaic, about: what a picture of this width can show."""


def light_field_picture(
    path: str | Path,
    variable: str | None = None,
    *,
    pattern: str | None = None,
    lens: tuple[int, int] | None = None,
) -> Figure:
    """The picture of a file or folder that `tmca.data.describe`, called with the same arguments, calls a light field.

    Raises:
        DataError: it cannot be read.
    """
    from tmca.data import describe, read_disparity, read_light_field

    how: dict[str, Any] = {"pattern": pattern, "lens": lens}
    facts = describe(path, variable, **how)["light_field"]
    most = min(facts["views"])
    views, shortest = most - (most % 2 == 0), min(facts["size"])
    scale = min(shortest, max(1, round(max(facts["size"]) * views / _MOSAIC_PX)))
    small = read_light_field(path, views=views, scale=scale, colour=facts["colour"], variable=variable, **how)
    centre = read_light_field(path, views=1, colour=facts["colour"], variable=variable, **how)
    truth = facts["disparity"]
    known = truth is not None and truth["min"] is not None
    return light_field_views(centre, small, read_disparity(path, pattern=pattern) if known else None, Path(path).name)


def light_field_views(centre: xr.DataArray, mosaic: xr.DataArray, disparity: xr.DataArray | None, title: str) -> Figure:
    """Centre view, mosaic of views and disparity beside one another.

    Args:
        centre: a light field whose middle view is shown, grey or colour.
        mosaic: a light field of which every view is shown.
        disparity: (y, x), px per view step, or None.
        title: of the centre view.
    """
    height, width = centre.shape[-2:]
    figure, axes = grid(1, 2 if disparity is None else 3, width=4.6, aspect=height / width)
    views = as_pictures(centre)
    axes[0, 0].imshow(views[views.shape[0] // 2, views.shape[1] // 2], cmap="gray", vmin=0, vmax=1)
    bare(axes[0, 0], title)
    sheet = mosaic_of(as_pictures(mosaic))
    axes[0, 1].imshow(sheet, cmap="gray", vmin=0, vmax=1)
    bare(axes[0, 1], f"{mosaic.sizes['view_v']}×{mosaic.sizes['view_u']} views")
    if disparity is not None:
        shown = axes[0, 2].imshow(disparity.values, cmap="turbo")
        bare(axes[0, 2], "true disparity")
        add_bar(axes[0, 2], shown, "px per view, nearer is positive")
    return figure


def as_pictures(light_field: xr.DataArray) -> np.ndarray:
    """``(V, U, H, W)`` grey or ``(V, U, H, W, 3)`` colour, in [0, 1]."""
    values = np.clip(light_field.values, 0, 1)
    return np.moveaxis(values, 0, -1) if values.ndim == 5 else values


def mosaic_of(views: np.ndarray, gap: int = 2) -> np.ndarray:
    """All views of ``(V, U, H, W[, 3])`` in one picture, white gaps between them."""
    edges = [(0, 0), (0, 0), (0, gap), (0, gap), *((0, 0) for _ in views.shape[4:])]
    padded = np.pad(views, edges, constant_values=1.0)
    rows, columns, height, width = padded.shape[:4]
    sheet = np.moveaxis(padded, 2, 1).reshape(rows * height, columns * width, *views.shape[4:])
    return np.asarray(sheet[: rows * height - gap, : columns * width - gap])
