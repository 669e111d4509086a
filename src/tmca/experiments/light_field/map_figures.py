"""Pictures of maps that belong to light fields: quality of every view, disparity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.experiments.figures import add_bar, bare, grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_Cell = tuple[str, np.ndarray | None, dict[str, Any]]
_UNIT = "px per view step"
_COLUMNS = 4


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


def disparity_figure(
    maps: Mapping[str, np.ndarray],
    truth: np.ndarray | None = None,
    mask: np.ndarray | None = None,
    view: np.ndarray | None = None,
) -> Figure:
    """Disparity maps on one scale, and at the right of each its error against the truth with MAE and bad pixels.

    The view, the truth and the first map are in the first row; then two maps to a row. The errors share a scale that
    ends where at least nine tenths of all errors lie below.

    Args:
        maps: name → ``(H, W)``, px per view step.
        truth: ``(H, W)``; not finite where it is unknown.
        mask: ``(H, W)``, pixels that count in the numbers.
        view: ``(H, W, 3)``, picture of the scene.

    Raises:
        ShapeError: shapes that differ.
    """
    cells = _cells(maps, truth, mask, view)
    columns = min(_COLUMNS, len(cells))
    height, width = next(iter(maps.values())).shape
    figure, axes = grid(-(-len(cells) // columns), columns, width=3.0, aspect=min(0.9 * height / width, 2.5))
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, (title, values, how) in zip(axes.flat, cells, strict=False):
        if values is not None:
            axis.set_axis_on()
            axis.imshow(values, interpolation="nearest", **how)
            bare(axis, title)
    place = columns - 1 if truth is None else 1
    add_bar(axes[0, place], axes[0, place].images[0], f"disparity ({_UNIT})")
    if truth is not None:
        shown = axes[0, 3].images[0]
        add_bar(axes[0, 3], shown, _error_label(maps, truth, shown.norm.vmax))
    return figure


def _cells(maps: Mapping[str, np.ndarray], truth: np.ndarray | None, mask: Any, view: np.ndarray | None) -> list[_Cell]:
    """Title, picture and scale of every place, row by row; no picture where it stays empty."""
    seen = _disparities(np.concatenate([np.ravel(m) for m in ([truth] if truth is not None else maps.values())]))
    if truth is None:
        return ([("centre view", view, {})] if view is not None else []) + [(n, m, seen) for n, m in maps.items()]
    said = [_numbers(values, truth, mask) for values in maps.values()]
    wrong = {"cmap": "magma", "vmin": 0.0, "vmax": error_top([np.abs(values - truth) for values in maps.values()])}
    cells: list[_Cell] = [("centre view", view, {}), ("ground truth", truth, seen)]
    for numbers, (name, values) in zip(said, maps.items(), strict=True):
        cells += [(name, values, seen), (numbers, np.abs(values - truth), wrong)]
    return cells


def _disparities(reference: np.ndarray) -> dict[str, Any]:
    known = reference[np.isfinite(reference)]
    low, high = (float(q) for q in np.quantile(known, (0.005, 0.995))) if known.size else (0.0, 1.0)
    return {"cmap": "viridis", "vmin": low, "vmax": max(high, low + 0.1)}


def error_top(errors: Sequence[np.ndarray]) -> float:
    """End of a common scale of errors: nine tenths of all lie below, rounded up to half a power of ten.

    Args:
        errors: maps, not finite where they are unknown.
    """
    known = np.concatenate([values[np.isfinite(values)] for values in errors])
    most = float(np.quantile(known, 0.9)) if known.size else 0.0
    if most <= 0:
        return 1.0
    step = 10 ** np.floor(np.log10(most)) / 2
    return float(step * np.ceil(most / step))


def _error_label(maps: Mapping[str, np.ndarray], truth: np.ndarray, top: float) -> str:
    errors = np.stack([np.abs(values - truth) for values in maps.values()])
    known = errors[np.isfinite(errors)]
    share = f"\n{np.mean(known > top):.1%} above {top:g}" if known.size else ""
    return f"error ({_UNIT}){share}"


def _numbers(estimate: np.ndarray, truth: np.ndarray, mask: Any) -> str:
    from tmca.metrics import disparity_error
    from tmca.metrics.disparity import BAD_PIXEL

    found = disparity_error(estimate, truth, mask)
    return f"MAE {found['mae']:.3f} px, {found['badpix']:.1%} above {BAD_PIXEL:g} px"
