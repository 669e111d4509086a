"""What the bench measures: depth with its confidence, reflectance with its uncertainty, spectra; what devices show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tmca.plots.style import (
    BLUE,
    GREY,
    RED,
    bare,
    curve_with_band,
    grid,
    image,
    panels,
    plain_axes,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = {(0.3, 0.3): RED, (0.5, 0.7): BLUE, (0.75, 0.4): "#edae49"}
"""Colours of places whose spectra are shown, shares of height and width."""
_REASONS = ("white", RED, "0.15", "#edae49", BLUE, "0.6", "#8e6c8a")


def measured_depth_figure(measured: xr.Dataset, reasons: Sequence[str], title: str) -> Figure:
    """Depth, its standard deviation, and why pixels have none.

    Args:
        measured: ``depth`` and ``depth_std`` (y, x), metres, NaN where unknown; ``confidence`` (y, x), index of the
            reason why a pixel has no depth, 0 where it has one.
        reasons: their names.
        title: of the depth map.
    """
    from matplotlib.colors import ListedColormap

    depth, deviation, reason = (measured[name].values for name in ("depth", "depth_std", "confidence"))
    figure, axes = _pictures(depth.shape)
    image(axes[0], depth, title, "turbo_r", bar="depth (m)", low=None, unknown=GREY)
    top = float(np.nanpercentile(deviation * 1e3, 98))
    image(axes[1], deviation * 1e3, "standard deviation", top=top, bar="mm", unknown=GREY)
    colours = ListedColormap(_REASONS[: len(reasons)])
    shown = axes[2].imshow(reason, cmap=colours, vmin=-0.5, vmax=len(reasons) - 0.5, interpolation="nearest")
    bare(axes[2], f"{(reason == 0).mean():.1%} known")
    bar = figure.colorbar(shown, ax=axes[2], ticks=range(len(reasons)), fraction=0.046, pad=0.03)
    bar.ax.set_yticklabels(reasons, fontsize=8)
    return figure


def reflectance_figure(measured: xr.Dataset, title: str) -> Figure:
    """Mean reflectance, spectra of three places with two standard deviations, and the share of bands left out.

    Args:
        measured: ``reflectance`` and ``reflectance_std`` (wavelength, y, x), NaN where unknown; ``quality``
            (wavelength, y, x), not 0 where a band is left out.
        title: of the picture.
    """
    cube, deviation, nm = (measured[name].values for name in ("reflectance", "reflectance_std", "wavelength_nm"))
    height, width = cube.shape[1:]
    figure, axes = _pictures((height, width))
    image(axes[0], np.nan_to_num(cube).mean(axis=0), title, "gray", bar="mean reflectance")
    for (y, x), colour in _POINTS.items():
        row, column = int(y * height), int(x * width)
        axes[0].plot(column, row, "o", color=colour, markeredgecolor="white")
        curve_with_band(axes[1], nm, cube[:, row, column], 2 * deviation[:, row, column], colour)
    plain_axes(axes[1], "spectra ± 2 standard deviations", "wavelength (nm)", "reflectance")
    left_out = (measured["quality"].values > 0).mean(axis=0)
    image(axes[2], left_out, "saturated or dark", "magma", top=1.0, bar="share of the bands")
    return figure


def _pictures(size: tuple[int, ...]) -> tuple[Figure, np.ndarray]:
    return panels(3, 4.6, max(2.4, 3.9 * size[0] / size[1]))


def compared_spectra_figure(spectra: Mapping[str, tuple[np.ndarray, ...]]) -> Figure:
    """A panel per point: measured with its spread over the box, and the reference.

    Args:
        spectra: title → wavelengths in nm, mean spectrum, standard deviation over the box, reference, all ``(L,)``.
    """
    figure, axes = panels(len(spectra), 3.4, 2.9)
    for axis, (title, (nm, spectrum, spread, reference)) in zip(axes, spectra.items(), strict=True):
        curve_with_band(axis, nm, spectrum, spread, BLUE, "scan")
        axis.plot(nm, reference, "--", color="0.2", label="spectrometer")
        axis.set_ylim(0, 1.15 * max((spectrum + spread).max(), reference.max()))
        plain_axes(axis, title, "wavelength (nm)", "reflectance" if axis is axes[0] else "")
        axis.legend(fontsize=8, loc="upper left")
    return figure


def shown_figure(rows: Mapping[str, Sequence[tuple[str, np.ndarray, Sequence[int] | None]]]) -> Figure:
    """What devices show in the first slots: frames, or Zernike terms as bars.

    Args:
        rows: plane and device → for every slot its title, the frame ``(H, W)`` or the terms ``(N,)`` in metres rms of
            surface, and of terms their Noll indices.
    """
    columns = max(len(slots) for slots in rows.values())
    figure, axes = grid(len(rows), columns, width=2.6, aspect=0.79)
    for row, (name, slots) in zip(axes, rows.items(), strict=True):
        for axis, (title, values, noll) in zip(row, slots, strict=True):
            if noll is None:
                image(axis, values, title, "gray", low=None)
            else:
                _draw_terms(axis, values, noll, title)
        row[0].set_ylabel(name, fontsize=8)
    return figure


def _draw_terms(axis: Axes, terms: np.ndarray, noll: Sequence[int], title: str) -> None:
    axis.bar(np.arange(len(noll)), terms * 1e9, color="tab:blue")
    axis.set_xticks(np.arange(len(noll)), [str(index) for index in noll])
    plain_axes(axis, title, "Noll index; nm rms of surface", "")


def frames_figure(movies: Mapping[str, np.ndarray], captures: Mapping[str, np.ndarray], shown: int = 8) -> Figure:
    """Captures, and some of the frames behind each of them, a row each.

    Args:
        movies: name → ``(F, H, W)`` frames.
        captures: name → ``(H, W)``, of the same names.
        shown: frames in a row.
    """
    figure, axes = grid(len(movies), shown + 1, width=1.55, aspect=1.0)
    for row, (name, frames) in zip(axes, movies.items(), strict=True):
        image(row[0], captures[name], "capture", colours="gray", top=1.0)
        for axis, index in zip(row[1:], np.linspace(0, len(frames) - 1, shown).round().astype(int), strict=True):
            title = f"{name}: {index + 1}" if axis is row[1] else f"frame {index + 1}"
            image(axis, np.clip(frames[index], 0, 1), title, colours="gray", top=1.0)
    return figure
