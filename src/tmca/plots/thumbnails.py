"""Small pictures of what an object holds, for the page of a notebook: a row of panels, about six inches wide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tmca.plots.style import BLUE, SMALL, blank_figure, image, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH, _BAR, _LONGEST = 6.0, 0.7, 320
"""Inches of a row and of a colour bar, and pixels of a side of a picture that are drawn."""


@dataclass(frozen=True)
class Panel:
    """One picture.

    Args:
        title: above it.
        values: ``(H, W)``, or ``(H, W, 3)`` colours from 0 to 1.
        colours: of a picture without colours of its own.
        bar: what its colour bar shows; without one if empty.
        low, top: of the colours; those of the values if None.
    """

    title: str
    values: np.ndarray
    colours: str = "gray"
    bar: str = ""
    low: float | None = 0.0
    top: float | None = None


def row_figure(panels: Sequence[Panel]) -> Figure:
    """Pictures side by side, of equal height."""
    shapes = [panel.values.shape[:2] for panel in panels]
    width = min(_WIDTH / len(panels), 2.4)
    height = width * min(max(h / w for h, w in shapes), 1.4)
    bars = sum(_BAR for panel in panels if panel.bar)
    figure = blank_figure(width * len(panels) + bars, height + 0.35)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, panel in zip(axes, panels, strict=True):
        step = max(1, -(-max(panel.values.shape[:2]) // _LONGEST))
        values = panel.values[::step, ::step]
        image(axis, values, panel.title, panel.colours, panel.top, panel.bar, panel.low)
    return figure


def curve_figure(x: np.ndarray, y: np.ndarray, labels: tuple[str, str], *, log: bool = False) -> Figure:
    """A curve over a positive quantity; both axes logarithmic if ``log``."""
    figure = blank_figure(3.6, 2.3)
    axis = figure.subplots()
    axis.plot(x, y, color=BLUE)
    if log:
        axis.set_xscale("log")
        axis.set_yscale("log")
    plain_axes(axis, "", *labels)
    return figure


def bars_figure(names: Sequence[str], values: Sequence[float], label: str) -> Figure:
    """Named values as bars, the first above."""
    figure = blank_figure(6.2, 0.5 + 0.24 * len(names))
    axis = figure.subplots()
    places = np.arange(len(names))[::-1]
    shown = axis.barh(places, values, color=BLUE, height=0.7)
    axis.bar_label(shown, fmt="%.2f", fontsize=SMALL, padding=2)
    axis.margins(x=0.12)
    axis.set_yticks(places, names)
    plain_axes(axis, "", label, "")
    return figure
