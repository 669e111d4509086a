"""Pictures of the report on real captures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.real.records import Geometry
from tmca.plots import BLUE, COLOURS, RED, bare, grid, image, linear_srgb, plain_axes, shown_level, srgb_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (RED, BLUE, *COLOURS[2:])
_STYLES = ("-", "--", "-.", ":")


def upright(picture: np.ndarray, degrees: int) -> np.ndarray:
    """A picture (H, W, …) turned by a multiple of 90°."""
    return np.rot90(picture, degrees // 90, axes=(0, 1))


def upright_place(place: tuple[int, int], size: tuple[int, int], degrees: int) -> tuple[int, int]:
    """Where a pixel of the capture lies in the upright picture."""
    row, column = place
    for _ in range(degrees // 90):
        row, column, size = size[1] - 1 - column, row, (size[1], size[0])
    return row, column


def scene_figure(
    capture: np.ndarray,
    estimates: Mapping[str, np.ndarray],
    wavelengths: Sequence[float],
    points: Mapping[str, tuple[int, int]],
    mask_spectra: Mapping[str, np.ndarray],
    turned: int,
) -> Figure:
    """The capture, the scene in the colours of every decoder, and spectra at points.

    Args:
        capture: (H, W') values.
        estimates: decoder → (L, H, W).
        wavelengths: (L,) metres.
        points: name → (row, column) of the scene, marked by their number.
        mask_spectra: name → (L,) weights of the mask's copies around a point, drawn as dots.
        turned: degrees to stand upright.
    """
    columns = max(len(estimates), len(points)) + 1
    figure, axes = grid(2, columns, width=3.6, aspect=capture.shape[0] / capture.shape[1])
    top = np.quantile(capture, 0.995)
    shown = upright(np.clip(capture / top, 0, 1) ** 0.5, turned)
    image(axes[0, 0], shown, "capture", colours="gray", top=1.0)
    first = linear_srgb(next(iter(estimates.values())), wavelengths)
    for axis, (name, cube) in zip(axes[0, 1:], estimates.items(), strict=False):
        axis.imshow(upright(srgb_picture(cube, wavelengths, level=shown_level(first)), turned))
        bare(axis, name)
        for number, place in enumerate(points.values(), 1):
            row, column = upright_place(place, (cube.shape[1], cube.shape[2]), turned)
            mark = {"boxstyle": "circle,pad=0.15", "facecolor": "0.15", "edgecolor": "white", "linewidth": 0.8}
            axis.text(column, row, str(number), color="white", fontsize=7, ha="center", va="center", bbox=mark)
    for axis in axes[0, len(estimates) + 1 :]:
        axis.set_axis_off()
    _spectra_row(axes[1], estimates, wavelengths, points, mask_spectra)
    return figure


def _spectra_row(axes: Any, estimates: Any, wavelengths: Any, points: Any, mask_spectra: Any) -> None:
    nm = np.asarray(wavelengths) * 1e9
    for number, (axis, (name, place)) in enumerate(zip(axes, points.items(), strict=False), 1):
        for colour, style, (decoder, cube) in zip(_COLOURS, _STYLES, estimates.items(), strict=False):
            spectrum = around(cube, place)
            axis.plot(nm, spectrum / max(spectrum.max(), 1e-12), style, color=colour, label=decoder, linewidth=1.5)
        if name in mask_spectra:
            dots = mask_spectra[name]
            axis.plot(nm, dots / max(dots.max(), 1e-12), ".", color="0.35", label="mask regression")
        plain_axes(axis, f"{number} {name}", "wavelength (nm)", "of its maximum")
    for axis in axes[len(points) :]:
        axis.set_axis_off()
    axes[len(points)].legend(*axes[0].get_legend_handles_labels(), fontsize=9, loc="center left", frameon=False)


def around(cube: np.ndarray, place: tuple[int, int], reach: int = 6) -> np.ndarray:
    """(L,) mean spectrum of a small square."""
    row, column = place
    part = cube[:, max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    return part.mean((1, 2))


def geometry_figure(found: Geometry, blocks: Mapping[str, np.ndarray], size: int) -> Figure:
    """Where light falls behind the mask, and how far the mask is displaced from row to row."""
    figure, axes = grid(1, 2, width=5.2, aspect=0.6)
    axes[0, 0].plot(found["offsets"], found["light"], ".-", color=_COLOURS[1])
    axes[0, 0].axvspan(0, 54, color="0.93", zorder=0)
    plain_axes(axes[0, 0], "light by displacement of the mask", "columns", "mean weight, of its maximum")
    for colour, (name, places) in zip(_COLOURS, blocks.items(), strict=False):
        used = places[places[:, 3] > 0.35]
        axes[0, 1].plot(used[:, 0], used[:, 2], ".", color=colour, label=name)
    fit = found["registration"]
    rows = np.array([0, size - 1])
    line = fit["shift"][0] + (fit["scale"][0] - 1) * (rows - (size - 1) / 2)
    axes[0, 1].plot(rows, line, color="0.2", label="line through all")
    plain_axes(axes[0, 1], "mask in the capture, from its file", "row of the block", "displacement along y (pixels)")
    axes[0, 1].legend(fontsize=7)
    return figure
