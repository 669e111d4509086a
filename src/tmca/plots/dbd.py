"""Matched filters and norms of dual polynomials over delay and Doppler, with the estimated and the true paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.plots.style import BLUE, COLOURS, RED, SMALL, TITLE, blank_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEVEL, _FLOOR = 0.98, -30.0
"""Share of the bound at which a black line is drawn, and decibels below the peak where a matched filter is darkest."""
_COLUMN = 3.5
"""Inches of a column of a paper."""
_VISIBLE, _FACTORS = 0.06, (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
"""Share of an axis that the largest ellipse has at least, enlarged by one of these factors if need be."""
Values = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Plane:
    """One source.

    Args:
        title: over the picture.
        norms: ``(N,)`` or ``(N, N')``, the norms as shares of their bound.
        edges: of the cells along each dimension of the norms, ``(N + 1,)`` each, in the units of the labels.
        labels: of the dimensions.
        estimate: ``(n, 1 or 2)``, where paths were estimated.
        truth: likewise, where it is known.
        matched: the matched filter on the same grid, where there is one.
        covariances: ``(n, 2, 2)``, of the estimates, where they are known; infinite ones are not drawn.
        names: of the true paths, where they have any.
    """

    title: str
    norms: Values
    edges: Sequence[Values]
    labels: Sequence[str]
    estimate: Values
    truth: Values | None = None
    matched: Values | None = None
    covariances: Values | None = None
    names: Sequence[str] = ()


@dataclass(frozen=True)
class _Look:
    """Sizes of texts and marks, points."""

    title: float = TITLE
    small: float = SMALL
    mark: float = 1.0
    """Of marks, over their usual size."""


def planes_figure(planes: Sequence[Plane], line: str = "", column: bool = False) -> Figure:
    """A row for every source: the matched filter, where there is one, and the dual polynomial.

    Args:
        planes: the sources.
        line: over the pictures.
        column: of the width of a column of a paper, with titles that are short.
    """
    pairs = any(plane.matched is not None for plane in planes)
    columns = 2 if pairs else min(len(planes), 2)
    rows = len(planes) if pairs else -(-len(planes) // columns)
    look = _Look(6, 5.5, 0.5) if column else _Look()
    figure = (
        blank_figure(_COLUMN, 1.45 * rows + 0.45) if column else blank_figure(5.2 * columns + 0.8, 4.0 * rows + 0.6)
    )
    axes = figure.subplots(rows, columns, squeeze=False)
    places = [axes[row] for row in range(rows)] if pairs else [[axis] for axis in axes.reshape(-1)]
    top = max(1.0, *(float(plane.norms.max()) for plane in planes))
    factor, images = _enlarged(planes), [None, None]
    for row, plane in zip(places, planes, strict=False):
        images = [new or old for new, old in zip(_draw_source(row, plane, top, factor, look), images, strict=True)]
    for axis in (one for row in places for one in row if not one.has_data()):
        axis.remove()
    _finish(figure, axes, images, line, look)
    return figure


def _draw_source(row: Any, plane: Plane, top: float, factor: float, look: _Look) -> list[Any]:
    """A source's pictures; the images of its matched filter and of its polynomial."""
    images: list[Any] = [None, None]
    short = plane.title.partition(":")[0] if look.mark < 1 else plane.title
    if plane.matched is not None:
        images[0] = _draw_matched(row[0], plane, plane.matched, factor, look)
    axis = row[-1]
    if plane.norms.ndim == 2:
        images[1] = _draw_image(axis, plane, plane.norms, (0.0, top), factor, look)
        if plane.norms.max() > _LEVEL:
            x, y = plane.edges
            axis.contour(x[:-1], y[:-1], plane.norms.T, levels=[_LEVEL], colors="black", linewidths=0.8 * look.mark)
    else:
        _draw_line(axis, plane, plane.norms, 1.0, look)
        axis.axhline(1.0, color="0.5", linewidth=0.8, linestyle="--")
        axis.set_ylim(0, 1.15 * max(1.0, float(plane.norms.max())))
    _label(axis, plane, f"{short}: dual polynomial" if look.mark < 1 else short, "‖f‖ / weight", look)
    return images


def _draw_matched(axis: Axes, plane: Plane, matched: np.ndarray, factor: float, look: _Look) -> Any:
    """Draw a source's matched filter; its image, or None where it is a line."""
    drawn = None
    decibels = 20 * np.log10(np.maximum(matched / max(float(matched.max()), 1e-300), 1e-10))
    if plane.norms.ndim == 2:
        drawn = _draw_image(axis, plane, decibels, (_FLOOR, 0.0), factor, look)
    else:
        _draw_line(axis, plane, decibels, 0.0, look)
        axis.set_ylim(_FLOOR, 3)
    _label(axis, plane, f"{plane.title.partition(':')[0]}: matched filter", "decibels", look)
    return drawn


def _label(axis: Axes, plane: Plane, title: str, values: str, look: _Look) -> None:
    axis.set_title(title, fontsize=look.title)
    axis.set_xlabel(plane.labels[0], fontsize=look.small, labelpad=2)
    axis.set_ylabel(plane.labels[1] if plane.norms.ndim == 2 else values, fontsize=look.small, labelpad=2)
    axis.tick_params(labelsize=look.small, length=3.5 * look.mark, pad=2)


def _finish(figure: Figure, axes: Any, images: Sequence[Any], line: str, look: _Look) -> None:
    """Colour bars, the legend, and the line over the pictures."""
    labels = (f"matched filter, dB below its peak ({-_FLOOR:g} dB shown)", f"‖f‖ / weight; black line: {_LEVEL}")
    if look.mark < 1:
        labels = "dB below the peak", f"‖f‖ / weight; line: {_LEVEL}"
    left = [axis for axis in figure.axes if axis in set(axes.reshape(-1))]
    for place, (image, label) in enumerate(zip(images, labels, strict=True)):
        if image is not None:
            below = [one for one in (axes[:, place] if images[0] is not None else axes.reshape(-1)) if one in left]
            bar = figure.colorbar(image, ax=below, location="bottom" if images[0] is not None else "right",
                                  aspect=35, shrink=0.9, pad=0.02)  # fmt: skip
            bar.set_label(label, fontsize=look.small)
            bar.ax.tick_params(labelsize=look.small, length=3.5 * look.mark, pad=2)
    handles: dict[str, Any] = {}
    for axis in left:
        handles |= {name: handle for handle, name in zip(*axis.get_legend_handles_labels(), strict=True)}
    where: dict[str, Any] = {"loc": "outside lower center", "ncols": 4, "fontsize": look.small, "frameon": False}
    figure.legend(handles.values(), handles.keys(), **where)
    if line:
        figure.suptitle(fill(line, 55 if look.mark < 1 else 105), fontsize=look.title)


def _enlarged(planes: Sequence[Plane]) -> float:
    """By which round number ellipses are drawn larger, for the largest one to be seen."""
    shares = [0.0]
    for plane in planes:
        for covariance in plane.covariances if plane.covariances is not None else ():
            spans = np.array([edges[-1] - edges[0] for edges in plane.edges])
            if np.all(np.isfinite(covariance)):
                shares.append(float(np.max(2 * np.sqrt(np.diag(covariance)) / np.abs(spans))))
    largest = max(shares)
    wanted = _VISIBLE / largest if largest > 0 else 1.0
    return next((factor for factor in _FACTORS if factor >= wanted), _FACTORS[-1])


def small_planes_figure(planes: Sequence[Plane]) -> Figure:
    """Polynomials as a row of small pictures, without bar and legend: crosses are recovered paths, rings true ones."""
    figure = blank_figure(min(2.6 * len(planes), 6.2), 2.5)
    top, look = max(1.0, *(float(plane.norms.max()) for plane in planes)), _Look()
    for axis, plane in zip(figure.subplots(1, len(planes), squeeze=False)[0], planes, strict=True):
        _label(axis, plane, plane.title.partition(":")[0], "‖f‖ / weight", look)
        if plane.norms.ndim == 2:
            _draw_image(axis, plane, plane.norms, (0.0, top), 1.0, look)
        else:
            _draw_line(axis, plane, plane.norms, 1.0, look)
    return figure


def _draw_image(axis: Axes, plane: Plane, values: Values, span: tuple[float, float], factor: float, look: _Look) -> Any:
    from matplotlib.patheffects import withStroke

    x, y = plane.edges
    place: Any = {"origin": "lower", "extent": (x[0], x[-1], y[0], y[-1]), "aspect": "auto", "cmap": "viridis"}
    image = axis.imshow(values.T, vmin=span[0], vmax=span[1], **place)
    if plane.truth is not None:
        outlined = [withStroke(linewidth=3.2 * look.mark, foreground="black")]  # seen on the plane and in the legend
        axis.plot(*plane.truth.T, "o", label="truth", markeredgecolor="white", path_effects=outlined, **_ring(look))
        beside: Any = {"xytext": (7 * look.mark, 5 * look.mark), "textcoords": "offset points"}
        for name, place in zip(plane.names, plane.truth, strict=False):
            axis.annotate(
                name, place, color="white", fontsize=look.small, path_effects=outlined, parse_math=False, **beside
            )
    axis.plot(*plane.estimate.T, "x", **_cross(look))
    for number, (centre, covariance) in enumerate(
        zip(plane.estimate, plane.covariances if plane.covariances is not None else (), strict=False)
    ):
        _draw_ellipse(axis, centre, covariance, factor, look, first=not number)
    axis.set_xlim(x[0], x[-1])
    axis.set_ylim(y[0], y[-1])
    return image


def _draw_ellipse(axis: Axes, centre: Values, covariance: Values, factor: float, look: _Look, first: bool) -> None:
    """Where an estimate lies within one standard deviation: ``(x − c)ᵀ C⁻¹ (x − c) = 1``, enlarged."""
    if not np.all(np.isfinite(covariance)):
        return
    values, directions = np.linalg.eigh(covariance)
    turns = np.linspace(0, 2 * np.pi, 73)
    around = np.stack([np.cos(turns), np.sin(turns)]) * np.sqrt(np.maximum(values, 0))[:, None] * factor
    label = "±1σ" if factor == 1 else f"±1σ, drawn {factor:g} times as large"
    path = centre[:, None] + directions @ around
    axis.plot(*path, color=RED, linewidth=1.2 * look.mark, label=label if first else "_")


def _ring(look: _Look) -> dict[str, Any]:
    return {"markersize": 12 * look.mark, "markerfacecolor": "none", "markeredgewidth": 1.6 * look.mark}


def _cross(look: _Look) -> dict[str, Any]:
    return {"markersize": 7 * look.mark, "color": RED, "markeredgewidth": 2 * look.mark, "label": "estimate"}


def _draw_line(axis: Axes, plane: Plane, values: Values, level: float, look: _Look) -> None:
    """Over one coordinate, with marks at a level."""
    axis.plot(plane.edges[0][:-1], values, color=BLUE, linewidth=1.2 * look.mark)
    if plane.truth is not None:
        x = plane.truth[:, 0]
        axis.plot(x, np.full_like(x, level), "o", label="truth", markeredgecolor=COLOURS[2], **_ring(look))
    x = plane.estimate[:, 0]
    axis.plot(x, np.full_like(x, level), "x", **_cross(look))
