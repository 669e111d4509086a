"""What a camera records and shows: snapshots, codes and masks, point spread functions, measures of a code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tmca.plots.cube import linear_srgb
from tmca.plots.style import BLUE, TITLE, add_bar, evenly, grid, image, mosaic, panels, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CORNER, _POINTS = 48, 10
"""Pixels of codes, and mask points, that are shown along each side."""
_CLEAR, _DARK = 0.85, 1e-3
"""Level of a clear filter on white paper, and light of a filter below which it has no colour to an eye."""
_Row = tuple[np.ndarray, list[str]]
"""Planes, and the title of each."""
_COLUMNS = 9
"""Most panels side by side: an odd number, so that the centre view is among them."""


def snapshot_figure(snapshot: np.ndarray, full_scale: float, channel: str, title: str) -> Figure:
    """The recorded image and how its values fill the sensor's range.

    Args:
        snapshot: ``(H, W')``, or ``(R, H, W')`` of R buckets, in units of one channel of a white scene.
        full_scale: value at which the sensor saturates.
        channel: what its channels are called: ``"band"`` or ``"view"``.
        title: of the image.
    """
    buckets = snapshot if snapshot.ndim == 3 else snapshot[None]
    figure, axes = grid(1, len(buckets) + 1, width=6.0, aspect=snapshot.shape[-2] / snapshot.shape[-1])
    top = float(buckets.max()) if len(buckets) > 1 else None
    for number, (axis, values) in enumerate(zip(axes[0], buckets, strict=False), start=1):
        name = title if len(buckets) == 1 else f"{title}, bucket {number}"
        image(axis, values, name, "gray", top, bar=f"snapshot (1 = one {channel} of a white scene)")
    share = np.clip(np.asarray(snapshot).ravel() / full_scale, -0.05, 1.1)
    axes[0, -1].hist(share, bins=120, color=BLUE)
    axes[0, -1].set_yscale("log")
    plain_axes(axes[0, -1], "levels", "share of full scale", "pixels")
    return figure


def codes_figure(
    aperture: np.ndarray,
    shutter: np.ndarray,
    code: np.ndarray,
    channels: Sequence[str],
    title: str,
    corner: int = CORNER,
) -> Figure:
    """Aperture T, shutter S and the code cube T̂ (thesis figure 19), a corner of ``corner`` pixels of each.

    Args:
        aperture: ``(K, Ha, Wa)``.
        shutter: ``(K, H, W')``, or ``(R, K, H, W')`` of R buckets.
        code: ``(L, H, W')``, or ``(R, L, H, W')``.
        channels: (L,) names of the code's channels.
        title: above all of them.
        corner: pixels along each side that are shown.
    """
    shutters, cubes = (part if part.ndim == 4 else part[None] for part in (shutter, code))
    if len(aperture) == 1 and len(shutters) == 1:
        rows = [_static_row(aperture, shutter, code, channels, corner)]
    else:
        rows = _rows(aperture, shutters, cubes, channels)
    columns = min(_COLUMNS, max(len(planes) for planes, _ in rows))
    figure, axes = grid(len(rows), columns, width=1.5, aspect=1.0)
    highest = max(float(cubes.max()), 1e-9)  # of all buckets, whose pictures are compared
    for row, (planes, titles) in zip(axes, rows, strict=True):
        chosen = evenly(len(planes), columns)
        top = highest if titles[0].startswith("T̂") else max(float(planes.max()), 1e-9)
        for axis, index in zip(row, chosen, strict=False):
            image(axis, planes[index, :corner, :corner], titles[index], "gray", top)
    add_bar(axes[-1, len(evenly(len(rows[-1][0]), columns)) - 1], axes[-1, 0].images[0], "transmittance")
    figure.suptitle(title, fontsize=9)
    return figure


def _rows(aperture: np.ndarray, shutters: np.ndarray, cubes: np.ndarray, channels: Sequence[str]) -> list[_Row]:
    """The aperture, then the shutters, then the code cubes of all buckets."""
    slots = [f"slot {k + 1} of {len(aperture)}" for k in range(len(aperture))]
    marks = ["" if len(shutters) == 1 else f"{r + 1}" for r in range(len(shutters))]  # the number of the bucket
    rows = [(aperture, [f"T, {s}" for s in slots])]
    rows += [(shown, [f"S{mark}, {s}" for s in slots]) for mark, shown in zip(marks, shutters, strict=True)]
    return rows + [(cube, [f"T̂{mark}, {name}" for name in channels]) for mark, cube in zip(marks, cubes, strict=True)]


def _static_row(
    aperture: np.ndarray, shutter: np.ndarray, code: np.ndarray, channels: Sequence[str], corner: int
) -> _Row:
    """Both planes and some channels of the code; one is larger, for dispersed light or the shear of the views."""
    height, width = (min(corner, aperture.shape[axis], shutter.shape[axis]) for axis in (1, 2))
    both = np.stack([plane[0, :height, :width] for plane in (aperture, shutter)])
    chosen = evenly(len(code), 6)
    few = code[chosen, :height, :width]
    return np.concatenate((both, few)), ["T", "S", *(f"T̂, {channels[index]}" for index in chosen)]


def phase_codes_figure(
    heights: np.ndarray,
    shutter: np.ndarray,
    cells: np.ndarray,
    filters: np.ndarray,
    response: np.ndarray,
    wavelengths: Sequence[float],
) -> Figure:
    """Height maps and shutters of every slot, filters over the pixels of a tile, and what filters and sensor pass.

    Args:
        heights: ``(K, Ha, Wa)`` metres.
        shutter: ``(R, K, H, W)`` of R buckets.
        cells: ``(h, w)`` number of the filter over each pixel of a tile.
        filters: ``(F, L)`` transmittance.
        response: ``(C, L)`` of the sensor.
        wavelengths: (L,) metres.
    """
    figure, axes = grid(1 + len(shutter), len(heights) + 1, width=2.2, aspect=1.0)
    slots = [f"slot {k + 1} of {len(heights)}" for k in range(len(heights))]
    limits, side = (float(heights.min()) * 1e9, float(heights.max()) * 1e9), 3 * cells.shape[0]
    for slot, height in enumerate(heights):
        bar = "height (nm)" if slot == len(heights) - 1 else ""
        image(axes[0, slot], height * 1e9, f"heights, {slots[slot]}", "coolwarm", limits[1], bar, limits[0])
        for bucket, shown in enumerate(shutter, start=1):
            name = "shutter" if len(shutter) == 1 else f"shutter S{bucket}"
            image(axes[bucket, slot], shown[slot, :side, :side], f"{name}, {slots[slot]}", "gray", 1.0)
    looks = _filter_colours(filters, wavelengths)
    image(axes[0, -1], looks[cells], f"filters of a tile of {cells.shape[0]} pixels")
    nanometres = np.asarray(wavelengths) * 1e9
    for look, values in zip(looks, filters, strict=True):
        axes[1, -1].plot(nanometres, values, color=look)
    for values in response:
        axes[1, -1].plot(nanometres, values, color="0.4", linestyle=":")
    axes[1, -1].set_ylim(0, 1.05)
    plain_axes(axes[1, -1], "filters; dotted: sensor", "wavelength (nm)", "transmittance")
    return figure


def _filter_colours(filters: np.ndarray, wavelengths: Sequence[float]) -> np.ndarray:
    """(F, 3) colours of even light through filters (F, L); grey of clear and of invisible ones."""
    if len(wavelengths) < 2:
        return np.full((len(filters), 3), _CLEAR)
    linear = np.nan_to_num(linear_srgb(filters.T[:, :, None], wavelengths)[..., 0].T.clip(0))
    top = linear.max(axis=1, keepdims=True)
    seen = np.divide(linear, top, out=np.ones_like(linear), where=top > _DARK)
    return _CLEAR * seen ** (1 / 2.2)


def psf_figure(rows: Mapping[str, np.ndarray], metres: Sequence[float]) -> Figure:
    """Point spread functions over depth (thesis figure 26), square roots.

    Args:
        rows: slot or pixel → ``(D, h, w)``.
        metres: (D,) depths.
    """
    height, width = next(iter(rows.values())).shape[-2:]
    figure, axes = grid(len(rows), len(metres), width=1.3, aspect=0.8 * height / width)
    for line, (row, (name, values)) in enumerate(zip(axes, rows.items(), strict=True)):
        for axis, value, z in zip(row, values, metres, strict=True):
            image(axis, np.sqrt(value), "" if line else f"{z:.2f} m", "inferno", low=None)
        row[0].set_ylabel(name, fontsize=8)
    said = "point spread functions over depth: square root of the intensity, each from its least (dark) to its most"
    figure.suptitle(said, fontsize=TITLE)
    return figure


def sub_images_figure(code: np.ndarray, name: str) -> Figure:
    """Sub-images, of V × U pixels each, of the mask points in the middle of a code (thesis figure 15).

    A static code answers alike to all rays through a mask point; a time-multiplexed one tells their angles apart. The
    ticks name the views of the first sub-image, from which its rays come.

    Args:
        code: ``(V, U, Hm, Wm)`` transmittance seen from the mask.
        name: in the title.
    """
    top, left = ((length - min(_POINTS, length)) // 2 for length in code.shape[2:])
    shown = code[:, :, top : top + _POINTS, left : left + _POINTS]
    sheet, (v, u, rows, columns) = mosaic(np.moveaxis(shown, (2, 3), (0, 1)), gap=1), shown.shape
    figure, axes = grid(1, 1, width=4.4, aspect=min(max(sheet.shape[0] / sheet.shape[1], 0.6), 2.5))
    title, highest = f"{name}\n{rows} × {columns} mask points, {v} × {u} angles each", float(np.nanmax(sheet)) or 1.0
    bar = "transmittance over the exposure"
    image(axes[0, 0], sheet, title, "gray", highest, bar, unknown="#8fb8de")
    _name_angles(axes[0, 0], (v, u))
    return figure


def _name_angles(axis: Axes, views: tuple[int, ...]) -> None:
    """Ticks at the outer views of the first sub-image, and at the centre's where there is room."""
    for count, ticks in zip(views, (axis.set_yticks, axis.set_xticks), strict=True):
        places = sorted({0, count - 1, *([count // 2] if count > 4 else [])})
        ticks(places, [f"{place - count // 2}" for place in places], fontsize=6)
    axis.set_xlabel("mask columns, in each the angles of views u", fontsize=8)
    axis.set_ylabel("mask rows, in each the angles of views v", fontsize=8)


def measures_figure(
    levels: Mapping[float, float],
    correlation: np.ndarray,
    singular_values: np.ndarray,
    slots: int,
    titles: tuple[str, str, str],
) -> Figure:
    """Levels of the code, correlation of its bands or views, and singular values of its blocks.

    Args:
        levels: value of T̂ → share.
        correlation: ``(L, L)``.
        singular_values: falling.
        slots: K, of which the levels are multiples of 1/K.
        titles: of the three.
    """
    figure, axes = panels(3, 11 / 3, 3.4)
    axes[0].bar(list(levels), list(levels.values()), width=0.6 / max(slots, 2))
    plain_axes(axes[0], titles[0], "value of T̂", "share")
    shown = axes[1].imshow(correlation, vmin=-1, vmax=1, cmap="RdBu_r", interpolation="nearest")
    axes[1].set_title(titles[1], fontsize=9)
    figure.colorbar(shown, ax=axes[1], shrink=0.8)
    axes[2].semilogy(
        np.arange(1, len(singular_values) + 1), singular_values.clip(1e-6 * singular_values.max()), ".-", markersize=3
    )
    plain_axes(axes[2], titles[2], "number", "value")
    return figure
