"""Pictures of reconstructed light fields: centre view, epipolar slices, errors, quality per view, disparity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.experiments.figures import add_bar, bare, grid, image
from tmca.experiments.light_field.views import brightest, colour_views, liveliest, ortho_slices, shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNIT = "relative irradiance"
_DISPARITY = "px per view step"
_MARK = "#ff3ea5"
_ERROR_TOP = 0.5


def light_field_figure(
    estimates: Mapping[str, np.ndarray], truth: np.ndarray | None = None, snapshot: np.ndarray | None = None
) -> Figure:
    """Snapshot, centre views with a horizontal and a vertical epipolar slice, and error maps with PSNR and SSIM.

    The slices go through the marked row and column, the same in all panels: below the view, the views of its row from
    left to right; beside it, the views of its column from top to bottom.

    Args:
        estimates: name → ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        truth: of the same shape, if it is known.
        snapshot: ``(H, W')`` or ``(3, H, W')``.

    Raises:
        ShapeError: no light fields, or shapes that differ.
    """
    panels = ({"truth": truth} if truth is not None else {}) | dict(estimates)
    reference = next(iter(panels.values()))
    white, (row, column) = brightest(reference), liveliest(reference)
    sheets = {name: ortho_slices(colour_views(field), row, column, white) for name, field in panels.items()}
    height, width = next(iter(sheets.values())).shape[:2]
    first, last = int(snapshot is not None), int(snapshot is not None) + len(panels)
    beside = truth is not None and len(estimates) == 1  # a lone error map needs no row of its own
    rows = 1 + (truth is not None and not beside)
    figure, axes = grid(rows, last + beside, width=3.6, aspect=min(height / width, 2.5) + 0.04)
    for axis in axes[1:].flat:
        axis.set_axis_off()
    if snapshot is not None:
        draw_snapshot(axes[0, 0], snapshot)
    for axis, (name, sheet) in zip(axes[0, first:last], sheets.items(), strict=True):
        image(axis, sheet, "truth: centre view" if name == "truth" else caption(name, panels[name], truth))
        _mark_slices(axis, row, column, reference.shape[-2:])
    if truth is not None:
        _errors(axes[0, last:] if beside else axes[1, first + 1 :], estimates, truth)
    return figure


def draw_snapshot(axis: Axes, snapshot: np.ndarray) -> None:
    """The recorded image; a colour bar says its levels where it is grey."""
    values = np.asarray(snapshot, dtype=np.float64)
    top = float(values.max()) or 1.0
    if values.ndim == 3 and len(values) == 3:
        image(axis, shown(np.moveaxis(values, 0, -1), top), f"snapshot (white = {top:.3g} views of a white scene)")
    else:
        image(axis, values.reshape(values.shape[-2:]), "snapshot", "gray", top, bar="views of a white scene")


def _mark_slices(axis: Axes, row: int, column: int, size: tuple[int, ...]) -> None:
    axis.plot([-0.5, size[1] - 0.5], [row, row], color=_MARK, linewidth=0.7)
    axis.plot([column, column], [-0.5, size[0] - 0.5], color=_MARK, linewidth=0.7)


def _errors(axes: np.ndarray, estimates: Mapping[str, np.ndarray], truth: np.ndarray) -> None:
    maps = {name: _rms(np.asarray(field) - truth) for name, field in estimates.items()}
    top = float(np.quantile(np.stack(list(maps.values())), 0.99)) or 1.0
    for axis, values in zip(axes, maps.values(), strict=True):
        axis.set_axis_on()
        image(axis, values, "error (rms over views)", "magma", top)
    add_bar(axes[-1], axes[-1].images[0], _UNIT)


def _rms(difference: np.ndarray) -> np.ndarray:
    return np.sqrt((difference**2).reshape(-1, *difference.shape[-2:]).mean(axis=0))


def caption(name: str, estimate: np.ndarray, truth: np.ndarray | None) -> str:
    """The name, and below it PSNR and SSIM where the truth is known."""
    if truth is None:
        return name
    from tmca.metrics import light_field_metrics

    found = light_field_metrics(estimate, truth)
    similarity = f", SSIM {found['ssim']:.3f}" if np.isfinite(found["ssim"]) else ""
    return f"{name}\n{found['psnr']:.2f} dB{similarity}"


def view_psnr_figure(maps: Mapping[str, np.ndarray]) -> Figure:
    """PSNR of every view as a map with its numbers, one scale for all.

    Args:
        maps: name → ``(V, U)`` in dB; views without any error are ``inf``.
    """
    values = np.concatenate([np.ravel(m) for m in maps.values()])
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    rows, columns = next(iter(maps.values())).shape
    figure, axes = grid(1, len(maps), width=max(2.6, 0.42 * columns), aspect=max(0.45, min(rows / columns, 2.0)))
    for axis, (name, levels) in zip(axes[0], maps.items(), strict=True):
        _view_map(axis, levels, name, low, max(high, low + 0.1))
    add_bar(axes[0, -1], axes[0, -1].images[0], "PSNR (dB)")
    return figure


def _view_map(axis: Axes, levels: np.ndarray, name: str, low: float, high: float) -> None:
    """A cell for each view with its number, black on light cells and white on dark ones."""
    rows, columns = levels.shape
    drawn = axis.imshow(np.minimum(levels, high), cmap="viridis", vmin=low, vmax=high)
    bare(axis, f"{name}\nmean over views {np.mean(levels):.2f} dB")
    axis.set_xticks(range(columns), [f"{u - columns // 2}" for u in range(columns)], fontsize=7)
    axis.set_yticks(range(rows), [f"{v - rows // 2}" for v in range(rows)], fontsize=7)
    axis.set_xlabel("view u", fontsize=8)
    axis.set_ylabel("view v", fontsize=8)
    lightness = drawn.to_rgba(np.minimum(levels, high))[..., :3] @ (0.299, 0.587, 0.114)
    for (v, u), level in np.ndenumerate(levels):
        text = f"{level:.1f}" if np.isfinite(level) else "∞"
        axis.text(u, v, text, ha="center", va="center", fontsize=7, color="black" if lightness[v, u] > 0.5 else "white")


def disparity_figure(
    maps: Mapping[str, np.ndarray], truth: np.ndarray | None = None, mask: np.ndarray | None = None
) -> Figure:
    """Disparity maps on one scale, and below each its error against the truth with MAE and bad pixels.

    Args:
        maps: name → ``(H, W)``, px per view step.
        truth: ``(H, W)``; not finite where it is unknown.
        mask: ``(H, W)``, pixels that count in the numbers.

    Raises:
        ShapeError: shapes that differ.
    """
    reference = truth if truth is not None else next(iter(maps.values()))
    known = reference[np.isfinite(reference)]
    low, high = (float(q) for q in np.quantile(known, (0.005, 0.995))) if known.size else (0.0, 1.0)
    panels = ({"ground truth": truth} if truth is not None else {}) | dict(maps)
    aspect = min(reference.shape[0] / reference.shape[1], 2.5)
    figure, axes = grid(1 + (truth is not None), len(panels), width=3.4, aspect=aspect)
    for axis, (name, values) in zip(axes[0], panels.items(), strict=True):
        drawn = axis.imshow(values, cmap="viridis", vmin=low, vmax=max(high, low + 0.1), interpolation="nearest")
        bare(axis, name)
    add_bar(axes[0, -1], drawn, f"disparity ({_DISPARITY})")
    if truth is not None:
        axes[1, 0].set_axis_off()
        for axis, values in zip(axes[1, 1:], maps.values(), strict=True):
            image(axis, np.abs(values - truth), _numbers(values, truth, mask), "magma", _ERROR_TOP)
        add_bar(axes[1, -1], axes[1, -1].images[0], f"error ({_DISPARITY})")
    return figure


def _numbers(estimate: np.ndarray, truth: np.ndarray, mask: Any) -> str:
    from tmca.metrics import disparity_error
    from tmca.metrics.disparity import BAD_PIXEL

    found = disparity_error(estimate, truth, mask)
    return f"MAE {found['mae']:.3f} px, {found['badpix']:.1%} above {BAD_PIXEL:g} px"
