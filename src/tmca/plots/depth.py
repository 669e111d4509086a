"""Scenes with depth: depth maps in metres, reconstructions beside the truth, what codes tell about depth."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.plots.cube import (
    captioned,
    check_points,
    legend_below,
    mark,
    note_false_colour,
    rgb_composite,
    sample_points,
    spectra,
    white_level,
)
from tmca.plots.style import GREY, blank_figure, grid, image, most_of, panels, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Pair = tuple[np.ndarray, np.ndarray]
"""Cube ``(L, H, W)`` and depth ``(H, W)``, metres."""
Limits = tuple[float | None, float | None]


def rgbd_figure(picture: np.ndarray, depth: np.ndarray, title: str, metric: bool = True) -> Figure:
    """A picture ``(H, W, 3)`` in [0, 1] and its depth map ``(H, W)``; ``metric`` as in `depth_map`."""
    figure, axes = grid(1, 2, width=5.0, aspect=depth.shape[0] / depth.shape[1])
    image(axes[0, 0], picture, title)
    depth_map(axes[0, 1], depth, metric)
    return figure


def scene_figure(scene: Pair, wavelengths: Sequence[float], title: str, metric: bool = True) -> Figure:
    """Colour composite, depth, and spectra of a few points; ``metric`` as in `depth_map`."""
    cube, depth = scene
    figure, axes = grid(1, 3, width=4.6, aspect=depth.shape[0] / depth.shape[1])
    points = sample_points(cube)
    image(axes[0, 0], rgb_composite(cube, wavelengths), title)
    mark(axes[0, 0], points)
    depth_map(axes[0, 1], depth, metric)
    spectra(axes[0, 2], {"": cube}, wavelengths, points)
    return note_false_colour(figure, wavelengths)


def points_figure(points: np.ndarray, colours: np.ndarray) -> Figure:
    """Points in space, seen from the side of the camera.

    Args:
        points: ``(N, 3)`` metres: right, up, and away from the camera along -z.
        colours: ``(N, 3)`` from 0 to 255.
    """
    figure = blank_figure(5.2, 4.2)
    axis: Any = figure.add_subplot(projection="3d")
    right, up, back = points.T
    axis.scatter(right, -back, up, c=colours / 255, s=4, depthshade=False, edgecolors="none")
    axis.set(xlabel="x (m)", ylabel="distance (m)", zlabel="y (m)")
    axis.view_init(elev=18, azim=-70)
    axis.set_box_aspect((1, 1.3, max(np.ptp(up), 1e-9) / max(np.ptp(right), 1e-9)))
    return figure


def depth_figure(
    name: str,
    estimate: Pair,
    confidence: np.ndarray,
    wavelengths: Sequence[float],
    limits: Limits,
    truth: Pair | None = None,
    at: Sequence[tuple[int, int]] | None = None,
    label: str = "depth",
    deviation: np.ndarray | None = None,
) -> Figure:
    """Colour composite, depth with a metric bar, confidence, and spectra; the truth in a row of its own. At the right
    the predicted error of the depth, below the actual one where the truth is known, on the same scale.

    Args:
        name: of the estimate.
        estimate: cube and depth.
        confidence: ``(H, W)`` probability that depth is right within a bin.
        wavelengths: (L,) metres.
        limits: near and far end of the colours, metres.
        truth: cube and depth.
        at: pixels (row, column) of the spectra; some of different spectra without.
        label: what the depth is called.
        deviation: ``(H, W)`` predicted standard deviation of the depth, metres.

    Raises:
        SettingError: a pixel outside the picture, or too many.
    """
    reference = estimate[0] if truth is None else truth[0]
    white = white_level(reference, wavelengths)
    points = sample_points(reference) if at is None else check_points(at, (reference.shape[1], reference.shape[2]))
    rows = [] if truth is None else [("truth", *truth)]
    rows.append((name, *estimate))
    columns = 3 + (deviation is not None)
    figure, axes = grid(len(rows), columns, width=3.6, aspect=reference.shape[1] / reference.shape[2])
    for row, (title, cube, depth) in zip(axes, rows, strict=True):
        image(row[0], rgb_composite(cube, wavelengths, white), title)
        mark(row[0], points)
        depth_map(row[1], depth, title=f"depth, {title}", limits=limits, called=label)
    image(axes[-1, 2], confidence, "confidence", top=1.0, bar="probability within a bin, as a share")
    if deviation is not None:
        _depth_errors(axes[:, 3], deviation, None if truth is None else _apart(estimate[1], truth[1]))
    if truth is not None:
        spectra(axes[0, 2], {"truth": truth[0], name: estimate[0]}, wavelengths, points)
        legend_below(figure, axes[0, 2])
    return note_false_colour(figure, wavelengths)


def _apart(depth: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Absolute errors, NaN between infinite depths."""
    with np.errstate(invalid="ignore"):
        return np.abs(depth - truth)


def _depth_errors(axes: np.ndarray, predicted: np.ndarray, actual: np.ndarray | None) -> None:
    """The predicted error of a depth, and above it the actual one where it is known."""
    maps = [("predicted error of the depth (1 σ)", predicted)]
    maps += [("error of the depth", actual)] if actual is not None else []
    top = most_of([values for _, values in maps])
    for axis, (title, values) in zip(axes[::-1], maps, strict=True):
        image(axis, np.where(np.isfinite(values), values, np.nan), title, "magma", top, bar="m")


def before_after(
    estimates: Mapping[str, Pair], truth: Pair, wavelengths: Sequence[float], limits: tuple[float, float]
) -> Figure:
    """A column for the truth and every estimate: colour composite and depth; errors in the titles."""
    cube, metres = truth
    white = white_level(cube, wavelengths)
    figure, axes = grid(2, 1 + len(estimates), width=3.6, aspect=cube.shape[1] / cube.shape[2])
    image(axes[0, 0], rgb_composite(cube, wavelengths, white), "truth")
    depth_map(axes[1, 0], metres, limits=limits)
    for column, (name, (estimate, depth)) in zip(axes[:, 1:].T, estimates.items(), strict=True):
        image(column[0], rgb_composite(estimate, wavelengths, white), captioned(name, estimate, cube))
        depth_map(column[1], depth, title=f"{np.nanmean(np.abs(depth - metres)):.3f} m off", limits=limits)
    return figure


def rows_figure(
    rows: Mapping[str, Mapping[str, Pair]],
    decoders: Sequence[str],
    truth: Pair,
    wavelengths: Sequence[float],
    limits: tuple[float, float],
) -> Figure:
    """The truth, then a row for every code: colours and depth in metres by every decoder, and their spectra.

    Args:
        rows: code → decoder → estimate.
        decoders: all of them, in the order of the columns.
        truth: cube and depth.
        wavelengths: (L,) metres.
        limits: near and far end of the colours, metres.
    """
    cube = truth[0]
    figure, axes = grid(1 + len(rows), 2 * len(decoders) + 1, width=2.8, aspect=cube.shape[1] / cube.shape[2])
    points = sample_points(cube)
    look: dict[str, Any] = {"wavelengths": wavelengths, "white": white_level(cube, wavelengths), "limits": limits}
    _pair(axes[0], 0, truth, "truth", **look)
    mark(axes[0, 0], points)
    for row, (code, estimates) in zip(axes[1:], rows.items(), strict=True):
        for decoder, estimate in estimates.items():
            _pair(row, 2 * decoders.index(decoder), estimate, f"{textwrap.fill(code, 36)}\n{decoder}", **look)
        missing = np.full_like(cube, np.nan)
        cubes = {name: estimates[name][0] if name in estimates else missing for name in decoders}
        spectra(row[-1], {"truth": cube, **cubes}, wavelengths, points)
    axes[0, -1].legend(*axes[-1, -1].get_legend_handles_labels(), loc="center", fontsize=8)
    return figure


def _pair(
    row: np.ndarray,
    first: int,
    scene: Pair,
    label: str,
    wavelengths: Sequence[float],
    white: float,
    limits: tuple[float, float],
) -> None:
    """Colours and depth side by side."""
    image(row[first], rgb_composite(scene[0], wavelengths, white), label)
    depth_map(row[first + 1], scene[1], title="depth", limits=limits)


def predicted_depth_figure(
    predictions: Mapping[str, Mapping[str, Mapping[str, Any]]], metres: Mapping[str, np.ndarray]
) -> Figure:
    """Fisher information about inverse depth, and the distance of every plane from its nearest rival.

    Args:
        predictions: code → ``optimised`` and ``random`` → ``fisher`` (D,) and ``kullback_leibler`` (D, D).
        metres: code → (D,) depths of its planes.
    """
    figure, axes = panels(2, 5.0, 4.1)
    for index, (code, masks) in enumerate(predictions.items()):
        for style, part in (("-", "optimised"), (":", "random")):
            label = code if part == "optimised" else None
            rivals = np.array(masks[part]["kullback_leibler"]) + np.diag(np.full(len(metres[code]), np.inf))
            for axis, values in zip(axes, (masks[part]["fisher"], rivals.min(1)), strict=True):
                axis.semilogy(metres[code], values, style, marker="o", markersize=3, color=f"C{index}", label=label)
    plain_axes(axes[0], "Fisher information (dotted: random masks)", "depth (m)", "information (m²)")
    plain_axes(axes[1], "Kullback–Leibler distance from the nearest rival", "depth (m)", "nats")
    figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return figure


def depth_map(
    axis: Axes,
    depth: np.ndarray,
    metric: bool = True,
    title: str = "depth",
    limits: Limits = (None, None),
    called: str = "depth",
) -> None:
    """A depth map ``(H, W)`` in metres with its colour bar; what is near is warm, unknown pixels are grey.

    Args:
        axis: to draw on.
        depth: NaN where unknown.
        metric: whether the metres are more than a name.
        title: above it.
        limits: of the colours, metres; those of the map without.
        called: beside the bar.
    """
    label = f"{called} (m)" if metric else "depth (m up to an affine map of 1/depth)"
    bar = label if np.isfinite(depth).all() else f"{label}, grey: unknown"
    image(axis, depth, title, "turbo_r", limits[1], bar, limits[0], GREY)
