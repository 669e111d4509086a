"""Pictures of what was measured: depth with its confidence, reflectance with its uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = ("#d1495b", "#00798c", "#edae49")


def depth_figure(measured: xr.Dataset, title: str) -> Figure:
    """Depth, its standard deviation, and why pixels have none, of `measure_depth`'s result."""
    from matplotlib.colors import ListedColormap

    axes = _panels(3, measured.sizes["y"] / measured.sizes["x"])
    _picture(axes[0], measured["depth"].values, title, "depth (m)", cmap="turbo_r")
    spread = measured["depth_std"].values * 1e3
    top = float(np.nanpercentile(spread, 98))
    _picture(axes[1], spread, "standard deviation", "mm", cmap="viridis", vmin=0, vmax=top)
    names = [part.split(" ", 1)[1] for part in str(measured["confidence"].attrs["reasons"]).split(", ")]
    colours = ListedColormap(["white", "#d1495b", "0.15", "#edae49", "#00798c", "0.6", "#8e6c8a"][: len(names)])
    values = measured["confidence"].values
    shown = axes[2].imshow(values, cmap=colours, vmin=-0.5, vmax=len(names) - 0.5, interpolation="nearest")
    _bare(axes[2], f"{(values == 0).mean():.1%} known")
    bar = axes[2].figure.colorbar(shown, ax=axes[2], ticks=range(len(names)), fraction=0.046, pad=0.03)
    bar.ax.set_yticklabels(names, fontsize=8)
    return axes[0].get_figure()


def reflectance_figure(measured: xr.Dataset, title: str) -> Figure:
    """Mean reflectance, spectra of three places with two standard deviations, and the share of bands left out."""
    cube, std = measured["reflectance"].values, measured["reflectance_std"].values
    nm, (height, width) = measured["wavelength_nm"].values, cube.shape[1:]
    axes = _panels(3, height / width)
    grey = np.nan_to_num(cube).mean(axis=0)
    _picture(axes[0], grey, title, "mean reflectance", cmap="gray", vmin=0)
    for colour, (y, x) in zip(_POINTS, [(0.3, 0.3), (0.5, 0.7), (0.75, 0.4)], strict=True):
        place = int(y * height), int(x * width)
        spectrum, spread = cube[:, *place], std[:, *place]
        axes[0].plot(place[1], place[0], "o", color=colour, markeredgecolor="white")
        axes[1].plot(nm, spectrum, color=colour)
        axes[1].fill_between(nm, spectrum - 2 * spread, spectrum + 2 * spread, color=colour, alpha=0.25, linewidth=0)
    axes[1].set_title("spectra ± 2 standard deviations", fontsize=9)
    axes[1].set_xlabel("wavelength (nm)", fontsize=8)
    axes[1].set_ylabel("reflectance", fontsize=8)
    axes[1].tick_params(labelsize=8)
    left_out = (measured["quality"].values > 0).mean(axis=0)
    _picture(axes[2], left_out, "saturated or dark", "share of the bands", cmap="magma", vmin=0, vmax=1)
    return axes[0].get_figure()


def _panels(count: int, aspect: float) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * count, max(2.4, 3.9 * aspect)), layout="constrained")
    return figure.subplots(1, count)


def _picture(axis: Axes, values: np.ndarray, title: str, bar: str, cmap: str, **limits: Any) -> None:
    from matplotlib import colormaps

    colours = colormaps[cmap].with_extremes(bad="0.75")
    shown = axis.imshow(np.ma.masked_invalid(values), cmap=colours, interpolation="nearest", **limits)
    _bare(axis, title)
    colour_bar = axis.figure.colorbar(shown, ax=axis, fraction=0.046, pad=0.03)
    colour_bar.set_label(bar, fontsize=8)
    colour_bar.ax.tick_params(labelsize=8)


def _bare(axis: Axes, title: str) -> None:
    axis.set_title(title, fontsize=9)
    axis.set_xticks([])
    axis.set_yticks([])
