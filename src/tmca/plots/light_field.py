"""Reconstructed light fields beside the truth: centre view, epipolar slices, errors, quality per view, disparity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.metrics import disparity_error, light_field_metrics
from tmca.metrics.disparity import BAD_PIXEL
from tmca.metrics.refocusing import colour_views
from tmca.plots.style import GREY, add_bar, bare, bright_level, grid, image, most_of, rms
from tmca.plots.views import brightest, horizontal_slice, liveliest, shown, vertical_slice, zoom_window

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNIT, _STEP = "relative irradiance", "px per view step"
_MARK = "#ff3ea5"
_WIDTH, _FINE = 3.9, 300
"""Inches of a picture, and pixels that stand side by side in them."""
_SLICE, _GAP = 0.25, 0.03
"""Parts of the enlarged window's sides: thickness of the slices, and the white before them."""
_COLUMNS = 4
_Cell = tuple[str, np.ndarray, dict[str, Any]]


def light_field_figure(
    estimates: Mapping[str, np.ndarray],
    truth: np.ndarray | None = None,
    snapshot: np.ndarray | None = None,
    buckets: int = 1,
    deviations: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    """A row for the truth and for each estimate: centre view, part of it enlarged, and error map with PSNR and SSIM;
    beside it, on the same scale, the error that an estimate predicts.

    The box in the views is the part that is enlarged, the same in all rows. Two epipolar slices go through its marked
    row and column: below it, the row in the views from left to right; beside it, the column in those from top to
    bottom. In the last place of the first row stands the snapshot, or else the error that a light field without
    parallax would have: all views like the true centre one.

    Args:
        estimates: name → ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        truth: of the same shape, if it is known.
        snapshot: ``(H, W')`` or ``(3, H, W')``; of several buckets beside each other, the first at the left.
        buckets: how many.
        deviations: name → predicted standard deviation of an estimate, of its shape.

    Raises:
        ShapeError: no light fields, or shapes that differ.
    """
    panels = ({"truth": truth} if truth is not None else {}) | dict(estimates)
    reference = np.asarray(next(iter(panels.values())))
    white, window = brightest(reference), zoom_window(reference)
    height, width = reference.shape[-2:]
    predicted = {name: rms(np.asarray(spread)) for name, spread in (deviations or {}).items() if name in estimates}
    maps = [] if truth is None else [(_quality(one, truth), rms(np.asarray(one) - truth)) for one in estimates.values()]
    top = most_of([*(values for _, values in maps), *predicted.values()])
    columns = 2 + (truth is not None or snapshot is not None) + bool(predicted)
    figure, axes = grid(len(panels), columns, width=_WIDTH, aspect=min(height / width, 2.5))
    if snapshot is not None:
        draw_snapshot(axes[0, 2], snapshot, buckets)
    if truth is not None and snapshot is None:
        maps.insert(0, _still(np.asarray(truth)))
    for axis, (quality, values) in zip(axes[len(axes) - len(maps) :, -1 - bool(predicted)], maps, strict=True):
        _map(axis, values, f"{quality}\nerror (rms over views)", top)
    for axis, name in zip(axes[-len(estimates) :, -1], estimates, strict=True):
        if name in predicted:
            _map(axis, predicted[name], "predicted error\n(1 σ, rms over views)", top)
    for row, (name, field) in zip(axes, panels.items(), strict=True):
        _draw_view(row[0], field, white, f"{name}: centre view" if name == "truth" else name, window)
        _draw_zoom(row[1], field, white, window, _cross(reference, window))
    return figure


def draw_snapshot(axis: Axes, snapshot: np.ndarray, buckets: int = 1) -> None:
    """The recorded image; a colour bar says its levels where it is grey."""
    values = np.asarray(snapshot, dtype=np.float64)
    top = float(values.max()) or 1.0
    numbers = [str(number) for number in range(1, buckets + 1)]
    name = "snapshot" if buckets == 1 else f"snapshot, buckets {', '.join(numbers[:-1])} and {numbers[-1]}"
    if values.ndim == 3 and len(values) == 3:
        image(axis, shown(np.moveaxis(values, 0, -1), top), f"{name} (white = {top:.3g} views of a white scene)")
    else:
        image(axis, values.reshape(values.shape[-2:]), name, "gray", top, bar="views of a white scene")


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


def _still(truth: np.ndarray) -> tuple[str, np.ndarray]:
    """Quality and errors of the true centre view in the place of all."""
    v, u = (n // 2 for n in truth.shape[-4:-2])
    still = np.broadcast_to(truth[..., v : v + 1, u : u + 1, :, :], truth.shape)
    return f"the true centre view repeated: {_quality(still, truth)}", rms(still - truth)


def _map(axis: Axes, values: np.ndarray, title: str, top: float) -> None:
    """Errors, with their bar."""
    _picture(axis, values, title, cmap="magma", vmin=0, vmax=top)
    add_bar(axis, axis.images[0], _UNIT)


def _picture(axis: Axes, values: np.ndarray, title: str, **how: Any) -> None:
    """Smoothed where it has more pixels than its place, so that thin lines stay whole."""
    axis.imshow(values, interpolation="antialiased" if values.shape[1] > _FINE else "nearest", **how)
    bare(axis, title)


def _quality(estimate: np.ndarray, truth: np.ndarray) -> str:
    """PSNR of the whole light field and SSIM."""
    scores = light_field_metrics(estimate, truth)
    similarity = f", SSIM {scores['ssim']:.3f}" if np.isfinite(scores["ssim"]) else ""
    return f"{scores['psnr']:.2f} dB{similarity}"


def view_psnr_figure(maps: Mapping[str, np.ndarray]) -> Figure:
    """PSNR of every view as a map with its numbers, one scale for all; above each the PSNR of its whole light field.

    Args:
        maps: name → ``(V, U)`` in dB; views without any error are ``inf``.
    """
    values = np.concatenate([np.ravel(m) for m in maps.values()])
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    rows, columns = next(iter(maps.values())).shape
    figure, axes = grid(1, len(maps), width=max(2.8, 0.42 * columns), aspect=max(0.45, min(rows / columns, 2.0)))
    for axis, (name, levels) in zip(axes[0], maps.items(), strict=True):
        _view_map(axis, levels, name, low, max(high, low + 0.1))
    add_bar(axes[0, -1], axes[0, -1].images[0], "PSNR (dB)")
    return figure


def _view_map(axis: Axes, levels: np.ndarray, name: str, low: float, high: float) -> None:
    """A cell for each view with its number, black on light cells and white on dark ones."""
    rows, columns = levels.shape
    drawn = axis.imshow(np.minimum(levels, high), cmap="viridis", vmin=low, vmax=high)
    bare(axis, f"{name}\nwhole light field {_whole(levels):.2f} dB")
    axis.set_xticks(range(columns), [f"{u - columns // 2}" for u in range(columns)], fontsize=7)
    axis.set_yticks(range(rows), [f"{v - rows // 2}" for v in range(rows)], fontsize=7)
    axis.set_xlabel("view u", fontsize=8)
    axis.set_ylabel("view v", fontsize=8)
    lightness = drawn.to_rgba(np.minimum(levels, high))[..., :3] @ (0.299, 0.587, 0.114)
    for (v, u), level in np.ndenumerate(levels):
        text = f"{level:.1f}" if np.isfinite(level) else "∞"
        axis.text(u, v, text, ha="center", va="center", fontsize=7, color="black" if lightness[v, u] > 0.5 else "white")


def _whole(levels: np.ndarray) -> float:
    """PSNR of the mean squared error over all views: what tables state, below the mean of the views' PSNRs."""
    error = float(np.mean(10 ** (-levels / 10)))
    return float(-10 * np.log10(error)) if error > 0 else float("inf")


def disparity_figure(maps: Mapping[str, np.ndarray], truth: np.ndarray | None, view: np.ndarray) -> Figure:
    """Disparity maps on one scale, and at the right of each its error against the truth with MAE and bad pixels.

    The view, the truth and the first map are in the first row; then two maps to a row. The errors share a scale that
    ends where at least nine tenths of all errors lie below.

    Args:
        maps: name → ``(H, W)``, px per view step.
        truth: ``(H, W)``; not finite where it is unknown.
        view: ``(H, W, 3)``, picture of the scene.

    Raises:
        ShapeError: shapes that differ.
    """
    cells = _cells(maps, truth, view)
    columns = min(_COLUMNS, len(cells))
    height, width = next(iter(maps.values())).shape
    figure, axes = grid(-(-len(cells) // columns), columns, width=3.0, aspect=min(0.9 * height / width, 2.5))
    for axis, (title, values, how) in zip(axes.flat, cells, strict=False):
        axis.imshow(values, interpolation="nearest", **how)
        bare(axis, title)
    place = columns - 1 if truth is None else 1
    add_bar(axes[0, place], axes[0, place].images[0], f"disparity ({_STEP})")
    if truth is not None:
        shown = axes[0, 3].images[0]
        add_bar(axes[0, 3], shown, _error_label(maps, truth, shown.norm.vmax))
    return figure


def geometry_figure(
    sharp: np.ndarray,
    disparity: np.ndarray,
    confidence: np.ndarray,
    truth: np.ndarray | None,
    title: str,
    matched: bool = False,
) -> Figure:
    """The all-in-focus photograph, its disparity and confidence; below, the true disparity and the error, if known.

    Args:
        sharp: ``(H, W)`` or ``(3, H, W)``.
        disparity: ``(H, W)``, px per view step.
        confidence: ``(H, W)`` from 0 to 1.
        truth: ``(H, W)``, px per view step.
        title: above the photograph.
        matched: whether the truth is what the true views show, and the error a difference from that.
    """
    height, width = disparity.shape
    rows = 1 if truth is None else 2
    figure, axes = grid(rows, 3, width=3.6, aspect=min(height / width, 2.5))
    photograph = np.moveaxis(sharp if sharp.ndim == 3 else sharp[None], 0, -1)
    seen = _disparities(disparity if truth is None else truth)
    label = f"{_STEP}, nearer is positive"
    image(axes[0, 0], shown(photograph, bright_level(photograph)), f"{title}, all in focus")
    image(axes[0, 1], disparity, "disparity", seen["cmap"], seen["vmax"], label, seen["vmin"])
    image(axes[0, 2], confidence, "confidence", "cividis", 1.0, "0: another disparity fits as well, 1: none")
    if truth is not None:
        error = np.abs(disparity - truth)
        true, wrong = ("disparity of the true views", "difference") if matched else ("true disparity", "error")
        image(axes[1, 1], truth, true, seen["cmap"], seen["vmax"], label, seen["vmin"], GREY)
        image(axes[1, 2], error, _beside_constant(disparity, truth), "magma", error_top([error]), f"{wrong} ({_STEP})")
    return figure


def _cells(maps: Mapping[str, np.ndarray], truth: np.ndarray | None, view: np.ndarray) -> list[_Cell]:
    """Title, picture and scale of every place, row by row."""
    seen = _disparities(np.concatenate([np.ravel(m) for m in ([truth] if truth is not None else maps.values())]))
    if truth is None:
        return [("centre view", view, {}), *((name, values, seen) for name, values in maps.items())]
    captions = [_numbers(values, truth) for values in maps.values()]
    wrong = {"cmap": "magma", "vmin": 0.0, "vmax": error_top([np.abs(values - truth) for values in maps.values()])}
    cells: list[_Cell] = [("centre view", view, {}), ("ground truth", truth, seen)]
    for numbers, (name, values) in zip(captions, maps.items(), strict=True):
        cells += [(name, values, seen), (numbers, np.abs(values - truth), wrong)]
    return cells


def _disparities(reference: np.ndarray) -> dict[str, Any]:
    finite = reference[np.isfinite(reference)]
    low, high = (float(q) for q in np.quantile(finite, (0.005, 0.995))) if finite.size else (0.0, 1.0)
    return {"cmap": "viridis", "vmin": low, "vmax": max(high, low + 0.1)}


def error_top(errors: Sequence[np.ndarray]) -> float:
    """End of a common scale of errors: nine tenths of all lie below, rounded up to half a power of ten.

    Args:
        errors: maps, not finite where they are unknown.
    """
    finite = np.concatenate([values[np.isfinite(values)] for values in errors])
    most = float(np.quantile(finite, 0.9)) if finite.size else 0.0
    if most <= 0:
        return 1.0
    step = 10 ** np.floor(np.log10(most)) / 2
    return float(step * np.ceil(most / step))


def _error_label(maps: Mapping[str, np.ndarray], truth: np.ndarray, top: float) -> str:
    errors = np.stack([np.abs(values - truth) for values in maps.values()])
    finite = errors[np.isfinite(errors)]
    share = f"\n{np.mean(finite > top):.1%} above {top:g}" if finite.size else ""
    return f"error ({_STEP}){share}"


def _numbers(estimate: np.ndarray, truth: np.ndarray) -> str:
    errors = disparity_error(estimate, truth)
    return f"MAE {errors['mae']:.3f} px, {errors['badpix']:.1%} above {BAD_PIXEL:g} px"


def _beside_constant(estimate: np.ndarray, truth: np.ndarray) -> str:
    constant = disparity_error(estimate, truth)["mae_of_constant"]
    return f"{_numbers(estimate, truth)}\n(a constant guess: MAE {constant:.3f} px)"
