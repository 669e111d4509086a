"""The norms of dual polynomials over delay and Doppler, with the estimated and the true paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.plots.style import BLUE, COLOURS, RED, SMALL, blank_figure, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEVEL = 0.98
_RING: dict[str, Any] = {"markersize": 12, "markerfacecolor": "none", "markeredgewidth": 1.6}
_CROSS: dict[str, Any] = {"markersize": 7, "color": RED, "markeredgewidth": 2, "label": "estimate"}


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
    """

    title: str
    norms: NDArray[np.floating[Any]]
    edges: Sequence[NDArray[np.floating[Any]]]
    labels: Sequence[str]
    estimate: NDArray[np.floating[Any]]
    truth: NDArray[np.floating[Any]] | None = None


def planes_figure(planes: Sequence[Plane]) -> Figure:
    """A picture for every source: an image of two dimensions, a line over one."""
    columns = min(len(planes), 2)
    rows = -(-len(planes) // columns)
    figure = blank_figure(5.2 * columns + 0.8, 4.4 * rows)
    axes = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    top = max(1.0, *(float(plane.norms.max()) for plane in planes))
    image: Any = None
    for axis, plane in zip(axes, planes, strict=False):
        plain_axes(axis, plane.title, plane.labels[0], plane.labels[1] if plane.norms.ndim == 2 else "‖f‖ / weight")
        if plane.norms.ndim == 2:
            image = _draw_image(axis, plane, top)
        else:
            _draw_line(axis, plane)
    for axis in axes[len(planes) :]:
        axis.remove()
    if image is not None:
        bar = figure.colorbar(image, ax=list(axes[: len(planes)]))
        bar.set_label(f"‖f‖ / weight; black line: {_LEVEL}", fontsize=SMALL)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=SMALL, frameon=False)
    return figure


def small_planes_figure(planes: Sequence[Plane]) -> Figure:
    """The same as a row of small pictures, without bar and legend: crosses are recovered paths, rings true ones."""
    figure = blank_figure(min(2.6 * len(planes), 6.2), 2.5)
    top = max(1.0, *(float(plane.norms.max()) for plane in planes))
    for axis, plane in zip(figure.subplots(1, len(planes), squeeze=False)[0], planes, strict=True):
        title = plane.title.partition(":")[0]
        plain_axes(axis, title, plane.labels[0], plane.labels[1] if plane.norms.ndim == 2 else "‖f‖ / weight")
        if plane.norms.ndim == 2:
            _draw_image(axis, plane, top)
        else:
            _draw_line(axis, plane)
    return figure


def _draw_image(axis: Axes, plane: Plane, top: float) -> Any:
    from matplotlib.patheffects import withStroke

    x, y = plane.edges
    extent = (x[0], x[-1], y[0], y[-1])
    norms = plane.norms.T
    image = axis.imshow(norms, origin="lower", extent=extent, aspect="auto", cmap="viridis", vmin=0, vmax=top)
    if norms.max() > _LEVEL:
        axis.contour(x[:-1], y[:-1], norms, levels=[_LEVEL], colors="black", linewidths=0.8)
    if plane.truth is not None:
        outlined = [withStroke(linewidth=3.2, foreground="black")]  # seen on the plane and in the legend
        axis.plot(*plane.truth.T, "o", label="truth", markeredgecolor="white", path_effects=outlined, **_RING)
    axis.plot(*plane.estimate.T, "x", **_CROSS)
    return image


def _draw_line(axis: Axes, plane: Plane) -> None:
    axis.plot(plane.edges[0][:-1], plane.norms, color=BLUE, linewidth=1.2)
    axis.axhline(1.0, color="0.5", linewidth=0.8, linestyle="--")
    if plane.truth is not None:
        x = plane.truth[:, 0]
        axis.plot(x, np.ones_like(x), "o", label="truth", markeredgecolor=COLOURS[2], **_RING)
    x = plane.estimate[:, 0]
    axis.plot(x, np.ones_like(x), "x", **_CROSS)
    axis.set_ylim(0, 1.15 * max(1.0, float(plane.norms.max())))
