"""A figure for a paper: pictures of the truth and of many estimates side by side, in the width of a column or of a
page, with texts that are legible in print."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN, PAGE = 85.0, 178.0
"""Widths of a column and of a page of most journals, mm."""
TALLEST = 220.0
"""Height of a figure that leaves room for its caption on a page, mm."""
POINTS = 7.0
"""Size of all texts, points."""
_INCH, _LINE, _LETTER = 25.4, 3.1, 1.32
"""Millimetres of an inch, of a line of text, and of a letter."""
_GAP, _NAMES, _CURVES, _AXIS = 1.0, 4.2, 27.0, 11.0
"""Millimetres between pictures, beside them for the names of rows, of curves and of the numbers at their axes."""
_NARROWEST, _TICK = 40.0, 12.0
"""Millimetres of curves at least, and between the numbers below them."""
_HEAD, _BAR, _BAR_INSET, _BAR_STEP = 1.0, 2.0, 3.5, 8.5
"""Millimetres above a block; of a colour bar's height, beside it, and from its top to the text's second line."""
_LEGEND_LINE, _BELOW, _RIGHT = 12.0, 9.0, 2.5
"""Millimetres of a line and the spaces of a name in the legend, of the numbers below curves, and right of these."""
_FEWEST_LETTERS = 6
"""Letters of a line of a heading, at least."""
_LOOSE, _CLOSE = 0.5, 1.05
"""Width of lines of axes, points, and distance of lines of text."""
_TRUTH, _THIN = 1.4, 0.9
"""Width of the curve of the truth and of the others, points."""
_CORNER = (0.025, 0.965)
"""Share of a picture's width and height where its text begins."""
_AT_EDGE = 0.85
"""Share of the width behind which the number of a point stands at its left."""
_SMALLEST, _STEP = 24.0, 0.5
"""Width of a picture that is made smaller so that all fit, at least, and by how much at a time, mm."""
_WIDE, _MOST = 3, 6
"""Pictures beside each other in a column, and in a page."""
_LINES = ("#00798c", "#d1495b", "#edae49", "#66a182", "#8d6a9f", "#8c564b", "#17becf", "#7f7f7f")


@dataclass(frozen=True)
class Scale:
    """Colours of maps that are compared.

    Args:
        label: of the colour bar.
        colours: name of a colour map.
        low, top: ends.
    """

    label: str
    colours: str
    low: float
    top: float


@dataclass(frozen=True)
class Picture:
    """A picture (H, W, 3) in [0, 1], or a map (H, W) on a scale, NaN where it is unknown.

    Args:
        values: of the pixels.
        scale: name of the scale of a map.
        text: in its corner.
        height: of the drawing as a share of its width; that of the pixels if None.
        marks: (row, column) of points of the curves.
    """

    values: np.ndarray
    scale: str = ""
    text: str = ""
    height: float | None = None
    marks: Sequence[tuple[int, int]] = ()

    @property
    def aspect(self) -> float:
        """Height over width."""
        return self.values.shape[0] / self.values.shape[1] if self.height is None else self.height


@dataclass(frozen=True)
class Curves:
    """Curves in one pair of axes.

    Args:
        title: above them.
        x: values of the axis.
        lines: name → values, in the same order in all axes of a figure.
        labels: of both axes.
    """

    title: str
    x: np.ndarray
    lines: Mapping[str, np.ndarray]
    labels: tuple[str, str]


@dataclass(frozen=True)
class Panels:
    """What stands side by side.

    Args:
        estimates: (name of the column, name of the row) → pictures below each other, as many for all.
        truth: pictures of the truth; none where it is not known.
        scales: of the maps, by their names.
        curves: below all.
        names: (name of the column, name of the row) of all places, in their order; those of the estimates without.
    """

    estimates: Mapping[tuple[str, str], Sequence[Picture]]
    truth: Sequence[Picture] = ()
    scales: Mapping[str, Scale] = field(default_factory=dict)
    curves: Sequence[Curves] = ()
    names: Sequence[tuple[str, str]] = ()

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return list(dict.fromkeys(column for column, _ in self.names or self.estimates))

    @property
    def rows(self) -> list[str]:
        """Names of the rows."""
        return list(dict.fromkeys(row for _, row in self.names or self.estimates))


def paper_figure(panels: Panels) -> Figure:
    """Pictures of all estimates with the truth at their left, colour bars below it, and curves below all.

    It is as wide as a column of a journal where that holds all pictures, else as a page. More columns than fit go on
    below. Pictures become smaller, within bounds, where the figure would be higher than ``TALLEST``.
    """
    from matplotlib import rc_context

    with rc_context({"font.size": POINTS, "axes.linewidth": _LOOSE}):
        return _Sheet(panels).drawn()


def fits_a_page(panels: Panels) -> bool:
    """Whether the figure is at most ``TALLEST`` high."""
    return _Sheet(panels).height <= TALLEST


class _Sheet:
    """The figure while it is drawn, in millimetres from its upper left corner."""

    def __init__(self, panels: Panels) -> None:
        self.panels, self.first = panels, int(bool(panels.truth))
        most = len(panels.columns) + self.first
        self.width = COLUMN if most <= _WIDE else PAGE
        self.curves = panels.curves[: int(self.width / _NARROWEST)]
        held = (_WIDE if most <= _WIDE else _MOST) - self.first
        each = -(-len(panels.columns) // -(-len(panels.columns) // held))
        self.blocks = [panels.columns[first : first + each] for first in range(0, len(panels.columns), each)]
        self.beside = len(self.blocks[0]) + self.first
        self.legend = self._legend_lines()
        self._sized(None)
        while self.height > TALLEST and self.side - _STEP >= _SMALLEST:
            self._sized(self.side - _STEP)

    def _sized(self, side: float | None) -> None:
        """Lay out with pictures of a width, or as wide as they can be; twice, as names of rows depend on heights."""
        self.names, room = _NAMES if any(self.panels.rows) else 0.0, 0.0
        for _ in range(2):
            room = (self.width - self.names - self.beside * _GAP) / max(self.beside, 2)
            self.side = room if side is None else min(side, room)
            self.heights = [self.side * picture.aspect for picture in next(iter(self.panels.estimates.values()))]
            self.tall = sum(self.heights) + _GAP * len(self.heights)
            lines = max(self._row_name(row).count("\n") for row in self.panels.rows)
            self.names += _LINE * lines if self.names == _NAMES else 0.0
        self.margin = (room - self.side) * self.beside / 2
        self.heads = [max(len(self._wrapped(name)) for name in (*block, "truth")) for block in self.blocks]
        below = (_CURVES + _LINE * (self.legend + 2) + _BELOW) if self.panels.curves else 0.0
        rows = self.tall * len(self.panels.rows)
        self.height = sum(_LINE * head + _HEAD + rows for head in self.heads) + below + _GAP

    def _row_name(self, row: str) -> str:
        """In lines as long as a row is high."""
        return textwrap.fill(row, max(_FEWEST_LETTERS, int((self.tall - _GAP) / _LETTER)))

    def drawn(self) -> Figure:
        """The figure."""
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(self.width / _INCH, self.height / _INCH))
        top = 0.0
        for block, head in zip(self.blocks, self.heads, strict=True):
            top += _LINE * head + _HEAD
            self._block(block, top)
            if self.panels.truth and block == self.blocks[0]:
                self._truth(top)
            top += self.tall * len(self.panels.rows)
        if self.panels.curves:
            self._curves(top + 2 + _LINE)
        return self.figure

    def axes(self, left: float, top: float, width: float, height: float) -> Axes:
        """Axes of a place."""
        place = (left / self.width, 1 - (top + height) / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(place)

    def text(self, left: float, top: float, text: str, **how: Any) -> None:
        """Text whose middle of the lower side is in a place."""
        look = {"ha": "center", "va": "bottom", "fontsize": POINTS, "linespacing": _CLOSE, **how}
        self.figure.text(left / self.width, 1 - top / self.height, text, **look)

    def _left(self, column: int) -> float:
        """Of the pictures in a column, the truth being the first."""
        return self.margin + column * (self.side + _GAP) + (self.names if column >= self.first else 0.0) + _GAP / 2

    def _wrapped(self, name: str) -> list[str]:
        return textwrap.wrap(name, max(_FEWEST_LETTERS, int(self.side / _LETTER))) or [""]

    def _head(self, column: int, top: float, name: str) -> None:
        self.text(self._left(column) + self.side / 2, top - 0.6, "\n".join(self._wrapped(name)))

    def _block(self, columns: Sequence[str], top: float) -> None:
        """Estimates of some columns, row by row."""
        for place, name in enumerate(columns, self.first):
            self._head(place, top, name)
        for number, row in enumerate(self.panels.rows):
            above = top + number * self.tall
            middle = above + (self.tall - _GAP) / 2
            beside = self._left(self.first) - _GAP
            self.text(beside, middle, self._row_name(row), rotation=90, ha="right", va="center")
            for place, column in enumerate(columns, self.first):
                if (column, row) in self.panels.estimates:
                    self._stack(self.panels.estimates[column, row], self._left(place), above)
                else:
                    self.text(self._left(place) + self.side / 2, above + self.heights[0] / 2, "failed", color="0.5")

    def _stack(self, pictures: Sequence[Picture], left: float, top: float) -> float:
        """Pictures below each other; where they end."""
        for picture in pictures:
            height = self.side * picture.aspect
            axis = self.axes(left, top, self.side, height)
            if picture.scale:
                _map(axis, picture.values, self.panels.scales[picture.scale])
            else:
                axis.imshow(np.clip(picture.values, 0, 1), interpolation="nearest", aspect="auto")
            axis.set_axis_off()
            for (row, column), mark in zip(picture.marks[: len(self.curves)], "123456789", strict=False):
                _mark(axis, row, column, mark)
            if picture.text:
                place: dict[str, Any] = {"ha": "left", "va": "top", "transform": axis.transAxes}
                box = {"facecolor": "black", "alpha": 0.55, "edgecolor": "none", "pad": 0.8}
                axis.text(*_CORNER, picture.text, color="white", fontsize=POINTS, bbox=box, **place)
            top += height + _GAP
        return top

    def _truth(self, top: float) -> None:
        """The truth, and below it the colour bars."""
        self._head(0, top, "truth")
        below, inner = self._stack(self.panels.truth, self._left(0), top) + 1, self.side - 2 * _BAR_INSET
        for scale in self.panels.scales.values():
            axis = self.axes(self._left(0) + _BAR_INSET, below, inner, _BAR)
            axis.imshow(np.linspace(0, 1, 256)[None], aspect="auto", cmap=scale.colours, extent=(0, 1, 0, 1))
            axis.set_yticks([])
            axis.set_xticks([0, 1], [f"{scale.low:.2g}", f"{scale.top:.2g}"], fontsize=POINTS)
            axis.tick_params(length=1.5, width=0.5, pad=1)
            label = textwrap.fill(scale.label, max(8, int(self.side / _LETTER)))
            axis.set_xlabel(label, fontsize=POINTS, labelpad=1, linespacing=_CLOSE)
            below += _BAR_STEP + _LINE * label.count("\n") + _LINE

    def _legend_columns(self) -> int:
        names = self.panels.curves[0].lines
        return max(1, int(self.width / (max(map(len, names)) * _LETTER + _LEGEND_LINE)))

    def _legend_lines(self) -> int:
        return -(-len(self.panels.curves[0].lines) // self._legend_columns()) if self.panels.curves else 0

    def _curves(self, top: float) -> None:
        """Curves side by side, and one legend for all."""
        each = self.width / len(self.curves)
        for number, curves in enumerate(self.curves):
            axis = self.axes(number * each + _AXIS, top, each - _AXIS - _RIGHT, _CURVES)
            _draw_curves(axis, curves)
            if number == 0:
                axis.set_ylabel(curves.labels[1], fontsize=POINTS, labelpad=1)
            axis.locator_params(axis="x", nbins=max(2, int(each / _TICK)))
            axis.locator_params(axis="y", nbins=4)
        handles, names = axis.get_legend_handles_labels()
        how: dict[str, Any] = {
            "ncols": self._legend_columns(),
            "fontsize": POINTS,
            "frameon": False,
            "loc": "lower center",
        }
        spaces: dict[str, Any] = {"borderpad": 0.2, "labelspacing": 0.2, "columnspacing": 1.2, "handlelength": 1.6}
        self.figure.legend(handles, names, bbox_to_anchor=(0.5, 0.0), **how, **spaces)


def _draw_curves(axis: Axes, curves: Curves) -> None:
    for place, (name, values) in enumerate(curves.lines.items()):
        look: dict[str, Any] = {"color": _LINES[(place - 1) % len(_LINES)], "linewidth": _THIN}
        look |= {"color": "black", "linewidth": _TRUTH} if name == "truth" else {}
        axis.plot(curves.x, values, label=name, **look)
    axis.set_title(curves.title, fontsize=POINTS, pad=2)
    axis.set_xlabel(curves.labels[0], fontsize=POINTS, labelpad=1)
    axis.tick_params(labelsize=POINTS, length=2, width=0.5, pad=1.5)


def _map(axis: Axes, values: np.ndarray, scale: Scale) -> None:
    """A map on its scale, grey where it is unknown."""
    from matplotlib import colormaps

    colours = colormaps[scale.colours].with_extremes(bad="0.75")
    look: dict[str, Any] = {"cmap": colours, "vmin": scale.low, "vmax": scale.top, "aspect": "auto"}
    axis.imshow(np.ma.masked_invalid(values), interpolation="nearest", **look)


def _mark(axis: Axes, row: int, column: int, name: str) -> None:
    """A point of the curves, with its number."""
    axis.plot(column, row, "o", markersize=2.5, markerfacecolor="white", markeredgecolor="black", markeredgewidth=0.5)
    box = {"facecolor": "black", "alpha": 0.45, "edgecolor": "none", "pad": 0.4}
    how: dict[str, Any] = {"textcoords": "offset points", "fontsize": POINTS, "color": "white", "bbox": box}
    at_edge = column > _AT_EDGE * axis.get_xlim()[1]
    axis.annotate(
        name, (column, row), xytext=(-3, 1.5) if at_edge else (3, 1.5), ha="right" if at_edge else "left", **how
    )
