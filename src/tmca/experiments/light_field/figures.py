"""Pictures of reconstructed light fields: centre view, a part enlarged with its epipolar slices, errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.experiments.figures import add_bar, bare, grid, image
from tmca.experiments.light_field.views import (
    brightest,
    colour_views,
    horizontal_slice,
    liveliest,
    shown,
    vertical_slice,
    zoom_window,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNIT = "relative irradiance"
_MARK = "#ff3ea5"
_WIDTH, _FINE = 3.9, 300
"""Inches of a picture, and pixels that stand side by side in them."""
_SLICE, _GAP = 0.25, 0.03
"""Parts of the enlarged window's sides: thickness of the slices, and the white before them."""


def light_field_figure(
    estimates: Mapping[str, np.ndarray], truth: np.ndarray | None = None, snapshot: np.ndarray | None = None
) -> Figure:
    """A row for the truth and for each estimate: centre view, part of it enlarged, and error map with PSNR and SSIM.

    The box in the views is the part that is enlarged, the same in all rows. Two epipolar slices go through its marked
    row and column: below it, the row in the views from left to right; beside it, the column in those from top to
    bottom. In the last place of the first row stands the snapshot, or else the error that a light field without
    parallax would have: all views like the true centre one.

    Args:
        estimates: name → ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        truth: of the same shape, if it is known.
        snapshot: ``(H, W')`` or ``(3, H, W')``.

    Raises:
        ShapeError: no light fields, or shapes that differ.
    """
    panels = ({"truth": truth} if truth is not None else {}) | dict(estimates)
    reference = np.asarray(next(iter(panels.values())))
    white, window = brightest(reference), zoom_window(reference)
    height, width = reference.shape[-2:]
    columns = 2 + (truth is not None or snapshot is not None)
    figure, axes = grid(len(panels), columns, width=_WIDTH, aspect=min(height / width, 2.5))
    for axis in axes[:, 2:].flat:
        axis.set_axis_off()
    if snapshot is not None:
        draw_snapshot(axes[0, 2], snapshot)
    if truth is not None:
        _errors(axes[:, 2], estimates, np.asarray(truth), flat=snapshot is None)
    for row, (name, field) in zip(axes, panels.items(), strict=True):
        _draw_view(row[0], field, white, f"{name}: centre view" if name == "truth" else name, window)
        _draw_zoom(row[1], field, white, window, _cross(reference, window))
    return figure


def draw_snapshot(axis: Axes, snapshot: np.ndarray) -> None:
    """The recorded image; a colour bar says its levels where it is grey."""
    values = np.asarray(snapshot, dtype=np.float64)
    top = float(values.max()) or 1.0
    axis.set_axis_on()
    if values.ndim == 3 and len(values) == 3:
        image(axis, shown(np.moveaxis(values, 0, -1), top), f"snapshot (white = {top:.3g} views of a white scene)")
    else:
        image(axis, values.reshape(values.shape[-2:]), "snapshot", "gray", top, bar="views of a white scene")


def centre_view(light_field: np.ndarray, white: float) -> np.ndarray:
    """``(H, W, 3)`` picture in [0, 1] of the view in the middle."""
    views = colour_views(light_field)
    return shown(views[views.shape[0] // 2, views.shape[1] // 2], white)


def _cross(reference: np.ndarray, window: tuple[slice, slice]) -> tuple[int, int]:
    """Row and column of the slices, in the whole view."""
    row, column = liveliest(reference[(..., *window)])
    return window[0].start + row, window[1].start + column


def _draw_view(axis: Axes, field: np.ndarray, white: float, title: str, window: tuple[slice, slice]) -> None:
    _picture(axis, centre_view(field, white), title)
    (top, bottom), (left, right) = ((part.start - 0.5, part.stop - 0.5) for part in window)
    corners = [left, right, right, left, left], [top, top, bottom, bottom, top]
    axis.plot(*corners, color=_MARK, linewidth=1.0)


def _draw_zoom(
    axis: Axes, field: np.ndarray, white: float, window: tuple[slice, slice], cross: tuple[int, int]
) -> None:
    """The window with its slices below and beside it, in the proportions of the view."""
    views, (row, column) = colour_views(field), cross
    (top, bottom), (left, right) = ((part.start - 0.5, part.stop - 0.5) for part in window)
    below, beside = _strip(top, bottom), _strip(left, right)
    parts = [
        (centre_view(field, white)[window], (left, right, bottom, top)),
        (shown(horizontal_slice(views, row)[:, window[1]], white), (left, right, below[1], below[0])),
        (shown(vertical_slice(views, column)[window[0]], white), (*beside, bottom, top)),
    ]
    for values, extent in parts:
        axis.imshow(values, extent=extent, interpolation="nearest")
    axis.set(xlim=(left, beside[1]), ylim=(below[1], top))
    bare(axis, "the box with its epipolar slices")
    axis.plot([left, right], [row, row], color=_MARK, linewidth=0.7)
    axis.plot([column, column], [top, bottom], color=_MARK, linewidth=0.7)


def _strip(start: float, stop: float) -> tuple[float, float]:
    """Where the slice after a side of the window begins and ends."""
    length = stop - start
    return stop + _GAP * length, stop + (_GAP + _SLICE) * length


def _errors(axes: np.ndarray, estimates: Mapping[str, np.ndarray], truth: np.ndarray, flat: bool) -> None:
    """Error maps on one scale; first, if ``flat``, that of the true centre view in place of all."""
    maps = [(_quality(field, truth), _rms(np.asarray(field) - truth)) for field in estimates.values()]
    top = float(np.quantile([values for _, values in maps], 0.99)) or 1.0
    if flat:
        v, u = (n // 2 for n in truth.shape[-4:-2])
        still = np.broadcast_to(truth[..., v : v + 1, u : u + 1, :, :], truth.shape)
        maps.insert(0, (f"the true centre view repeated: {_quality(still, truth)}", _rms(still - truth)))
    for axis, (quality, values) in zip(axes[len(axes) - len(maps) :], maps, strict=True):
        axis.set_axis_on()
        _picture(axis, values, f"{quality}\nerror (rms over views)", cmap="magma", vmin=0, vmax=top)
        add_bar(axis, axis.images[0], _UNIT)


def _picture(axis: Axes, values: np.ndarray, title: str, **how: Any) -> None:
    """Smoothed where it has more pixels than its place, so that thin lines stay whole."""
    axis.imshow(values, interpolation="antialiased" if values.shape[1] > _FINE else "nearest", **how)
    bare(axis, title)


def _rms(difference: np.ndarray) -> np.ndarray:
    return np.sqrt((difference**2).reshape(-1, *difference.shape[-2:]).mean(axis=0))


def _quality(estimate: np.ndarray, truth: np.ndarray) -> str:
    """PSNR of the whole light field and SSIM."""
    from tmca.metrics import light_field_metrics

    found = light_field_metrics(estimate, truth)
    similarity = f", SSIM {found['ssim']:.3f}" if np.isfinite(found["ssim"]) else ""
    return f"{found['psnr']:.2f} dB{similarity}"
