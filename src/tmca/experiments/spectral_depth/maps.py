"""The picture of a scene beside its depth map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.experiments.composite import rgb_composite
from tmca.experiments.figures import add_bar, bare, grid, mark, spectra, spread_points

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def rgbd_picture(path: str | Path) -> Figure:
    """Picture and depth of an RGB-D scene that `tmca.data.read_rgbd` reads."""
    from tmca.data import read_rgbd
    from tmca.data.srgb import encoded

    scene = read_rgbd(path)
    figure, axes = grid(1, 2, width=5.0, aspect=scene.sizes["y"] / scene.sizes["x"])
    axes[0, 0].imshow(np.moveaxis(encoded(scene["rgb"].values), 0, -1))
    bare(axes[0, 0], str(scene.attrs["name"]))
    depth_map(axes[0, 1], scene["depth"].values, bool(scene.attrs["metric"]))
    return figure


def spectral_depth_picture(path: str | Path, variable: str | None = None) -> Figure:
    """Colour composite, depth, and spectra of a few points of a scene that `tmca.data.read_spectral_depth` reads."""
    from tmca.data import read_spectral_depth

    scene = read_spectral_depth(path, variable=variable, negative="keep")
    cube, wavelengths = scene["radiance"].values, scene["wavelength"].values.tolist()
    figure, axes = grid(1, 3, width=4.6, aspect=scene.sizes["y"] / scene.sizes["x"])
    points = spread_points(cube)
    axes[0, 0].imshow(rgb_composite(cube, wavelengths))
    bare(axes[0, 0], Path(path).name)
    mark(axes[0, 0], points)
    depth_map(axes[0, 1], scene["depth"].values, bool(scene.attrs["metric"]))
    spectra(axes[0, 2], {"": cube}, wavelengths, points)
    return figure


def depth_map(
    axis: Axes,
    depth: xr.DataArray | np.ndarray,
    metric: bool = True,
    title: str = "depth",
    limits: tuple[float | None, float | None] = (None, None),
) -> None:
    """A depth map ``(H, W)`` in metres with its colour bar; what is near is warm, unknown pixels are grey.

    Args:
        axis: to draw on.
        depth: NaN where unknown.
        metric: whether the metres are more than a name.
        title: above it.
        limits: of the colours, metres; those of the map without.
    """
    from matplotlib import colormaps

    values = np.asarray(depth)
    shown = axis.imshow(
        np.ma.masked_invalid(values), cmap=colormaps["turbo_r"].with_extremes(bad="0.75"), interpolation="nearest",
        vmin=limits[0], vmax=limits[1],
    )  # fmt: skip
    bare(axis, title)
    label = "depth (m)" if metric else "depth (m up to an affine map of 1/depth)"
    add_bar(axis, shown, label if np.isfinite(values).all() else f"{label}, grey: unknown")
