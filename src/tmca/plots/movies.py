"""Frames of a scene that changes within the exposure, in a row and as an animation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tmca.metrics.refocusing import colour_views
from tmca.plots.cube import rgb_composite, white_level
from tmca.plots.style import grid, image
from tmca.plots.views import brightest, shown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_SHOWN = 8
"""Frames in a row at most."""


def movie_views(frames: xr.DataArray, white: float | None = None) -> np.ndarray:
    """Frames ``(G, …)`` as views in a row: of cubes ``(3, 1, G, H, W)`` colour composites in [0, 1], of light fields
    ``(1, G, H, W)`` or ``(3, 1, G, H, W)`` the middle views.

    Args:
        frames: with the axes of a labelled scene.
        white: irradiance of cubes that is shown as white; that of the middle frame if None.
    """
    if "wavelength" in frames.dims:
        cubes, waves = frames.transpose(..., "wavelength", "y", "x").values, frames["wavelength"].values.tolist()
        white = white_level(cubes[len(cubes) // 2], waves) if white is None else white
        return np.moveaxis(np.stack([rgb_composite(cube, waves, white) for cube in cubes]), -1, 0)[:, None]
    middle = frames.isel(view_v=frames.sizes["view_v"] // 2, view_u=frames.sizes["view_u"] // 2)
    if "colour" in middle.dims:
        return np.asarray(middle.transpose("colour", ..., "y", "x").values[:, None])
    return np.asarray(middle.transpose(..., "y", "x").values[None])


def movie_figure(movies: Mapping[str, xr.DataArray]) -> Figure:
    """Movies of equal length, a row each, all as bright as the last row.

    Args:
        movies: name → frames ``(G, …)``, see `movie_views`.
    """
    last = list(movies.values())[-1]
    cubes, middle = "wavelength" in last.dims, last[len(last) // 2].transpose(..., "y", "x")
    white = white_level(middle.values, last["wavelength"].values.tolist()) if cubes else None
    views = {name: movie_views(frames, white) for name, frames in movies.items()}
    count = next(iter(views.values())).shape[-3]
    chosen = np.linspace(0, count - 1, min(count, _SHOWN)).round().astype(int)
    height, width = next(iter(views.values())).shape[-2:]
    figure, axes = grid(len(views), len(chosen), width=2.4, aspect=height / width)
    top = 1.0 if cubes else brightest(list(views.values())[-1])
    for row, (name, movie) in zip(axes, views.items(), strict=True):
        for axis, frame in zip(row, chosen, strict=True):
            title = f"{name}, frame {frame + 1} of {count}" if axis is row[0] else f"frame {frame + 1}"
            image(axis, shown(colour_views(movie)[0, frame], top), title)
    return figure
