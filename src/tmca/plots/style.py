"""What every figure is made of: axes, images, colour bars, labels; and how a figure is written."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = (".png", ".pdf", ".svg")
TITLE, SMALL = 9, 8
"""Sizes of texts, points."""
BLUE, RED = "#00798c", "#d1495b"
GREY = "0.75"
"""Of unknown pixels."""
COLOURS = (BLUE, RED, "#edae49", "#66a182", "#8d6a9f")
_TRUETYPE = 42
"""Matplotlib's number of TrueType fonts in a PDF."""
_BAR = 0.12
"""Inches across a colour bar, at least."""
_DENSITY, _WIDEST = 110, 13.0
"""Pixels an inch; inches beyond which the smallest text would be under 9 px on a page of 1150 px."""


def save_figure(figure: Figure, path: str | Path, *, overwrite: bool = False, dpi: float | None = None) -> Path:
    """Write a figure as PNG, PDF or SVG, by its suffix, whole or not at all; a PDF has its fonts as TrueType, which
    journals ask for and programs can edit.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
    """
    from matplotlib import rc_context

    from tmca.data import atomic_path

    check_picture(path)
    with atomic_path(path, overwrite=overwrite) as temporary, rc_context({"pdf.fonttype": _TRUETYPE}):
        figure.savefig(temporary, dpi=dpi or figure.dpi, format=Path(path).suffix[1:].lower(), facecolor="white")
    return Path(path)


def check_picture(path: str | Path) -> None:
    """Raises OutputError unless pictures can be written under this suffix."""
    if Path(path).suffix.lower() not in PICTURES:
        raise OutputError(path, f"the suffix {Path(path).suffix!r}", " ".join(PICTURES), "rename the picture")


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches, whose axes and texts keep clear of each other.

    A wider one than a page can show legibly is made smaller, with as many pixels: its texts are larger beside it.
    """
    from matplotlib.figure import Figure

    shrunk = min(1.0, _WIDEST / width)
    figure = Figure(figsize=(width * shrunk, height * shrunk), dpi=_DENSITY / shrunk, layout="constrained")
    figure._repr_png_ = partial(_as_png, figure)  # type: ignore[attr-defined]
    return figure


def _as_png(figure: Figure) -> bytes:
    """What a notebook shows of a figure; without pyplot, which is not needed here, it would show its size in words."""
    drawn = BytesIO()
    figure.savefig(drawn, format="png", facecolor="white")
    return drawn.getvalue()


def panels(count: int, width: float, height: float) -> tuple[Figure, np.ndarray]:
    """A figure of ``count`` axes in a row, ``(count,)``, each so many inches wide and high."""
    figure = blank_figure(width * count, height)
    return figure, figure.subplots(1, count, squeeze=False)[0]


def grid(rows: int, columns: int, width: float, aspect: float = 0.8) -> tuple[Figure, np.ndarray]:
    """Axes for pictures ``width`` inches wide whose height is ``aspect`` times that; those without a title stay empty.

    A title comes with `image`, `bare` and `plain_axes`.
    """
    figure = blank_figure(width * columns, (width * aspect + 0.35) * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    return figure, axes


def image(
    axis: Axes,
    values: np.ndarray,
    title: str,
    colours: str = "viridis",
    top: float | None = None,
    bar: str = "",
    low: float | None = 0,
    unknown: str = "white",
) -> Any:
    """An image without ticks from ``low`` to ``top``, ``unknown`` where it is NaN; ``bar`` labels a colour bar."""
    from matplotlib import colormaps

    look: Any = {"cmap": colormaps[colours].with_extremes(bad=unknown), "vmin": low, "vmax": top}
    shown = axis.imshow(np.ma.masked_invalid(values), interpolation="nearest", **look)
    bare(axis, title)
    if bar:
        add_bar(axis, shown, bar)
    return shown


def curve_with_band(
    axis: Axes, x: Any, mean: np.ndarray, deviation: np.ndarray, colour: str, label: str = "", band: str = ""
) -> None:
    """A curve and what lies within a deviation of it."""
    axis.plot(x, mean, color=colour, label=label or None)
    axis.fill_between(x, mean - deviation, mean + deviation, color=colour, alpha=0.25, linewidth=0, label=band or None)


def add_bar(axis: Axes, shown: Any, label: str) -> None:
    """A colour bar as high as the picture, with its label in the size of the other texts."""
    inches = axis.bbox.width / axis.figure.dpi
    bar = axis.figure.colorbar(shown, cax=axis.inset_axes((1.02, 0, max(0.04, _BAR / inches), 1)))
    bar.set_label(label, fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL)


def plain_axes(axis: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of a plot, in the size of all texts."""
    axis.set_axis_on()
    axis.set_title(title, fontsize=TITLE)
    axis.set_xlabel(x, fontsize=SMALL)
    axis.set_ylabel(y, fontsize=SMALL)
    axis.tick_params(labelsize=SMALL)


def bare(axis: Axes, title: str) -> None:
    """Title and no ticks, as pictures have it."""
    axis.set_axis_on()
    axis.set_title(title, fontsize=TITLE)
    axis.set_xticks([])
    axis.set_yticks([])


def image_figure(values: np.ndarray, title: str) -> Figure:
    """A 2-D image, or planes of a 3-D stack (smallest axis first), in grey."""
    figure, axes = grid(1, 1, width=7.0)
    planes = values[None] if values.ndim == 2 else np.moveaxis(values, int(np.argmin(values.shape)), 0)
    chosen = evenly(len(planes), 16)
    shown = axes[0, 0].imshow(montage(planes, chosen), cmap="gray", interpolation="nearest")
    bare(axes[0, 0], title if len(planes) == 1 else f"{title}: planes {', '.join(map(str, chosen))} of {len(planes)}")
    add_bar(axes[0, 0], shown, "stored value")
    return figure


def montage(planes: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
    """The chosen planes side by side in up to four columns; places without one are not a number, and stay white."""
    columns = min(4, len(chosen))
    rows = -(-len(chosen) // columns)
    places = np.full((rows * columns, *planes.shape[1:]), np.nan, dtype=np.float32)
    places[: len(chosen)] = planes[list(chosen)]
    return mosaic(places.reshape(rows, columns, *planes.shape[1:]))


def mosaic(pictures: np.ndarray, gap: int = 0, fill: float = np.nan) -> np.ndarray:
    """One picture of ``(R, C, h, w[, 3])``: R rows of C pictures, ``gap`` pixels of ``fill`` between them."""
    rows, columns, height, width, *colours = pictures.shape
    edges = [(0, 0), (0, 0), (0, gap), (0, gap), *((0, 0) for _ in colours)]
    padded = np.pad(pictures, edges, constant_values=fill).swapaxes(1, 2)
    sheet = padded.reshape(rows * (height + gap), columns * (width + gap), *colours)
    return sheet[: len(sheet) - gap, : sheet.shape[1] - gap]


def rms(values: np.ndarray) -> np.ndarray:
    """``(..., H, W)`` → ``(H, W)`` root mean square over all other axes."""
    return np.sqrt((values**2).reshape(-1, *values.shape[-2:]).mean(axis=0))


def most_of(maps: Sequence[np.ndarray]) -> float:
    """End of a common scale of maps of errors: what 99 of a hundred finite values lie below, 1 in place of 0."""
    values = np.concatenate([one[np.isfinite(one)] for one in maps] or [np.ones(1)])
    return (float(np.quantile(values, 0.99)) if values.size else 0.0) or 1.0


def bright_level(values: np.ndarray, quantile: float = 0.995) -> float:
    """The value that is shown as white: a quantile, or 1 where it is not above 0."""
    level = float(np.quantile(values, quantile))
    return level if level > 0 else 1.0


def evenly(count: int, most: int) -> list[int]:
    """At most ``most`` indices, evenly from the first of ``count`` to the last."""
    return [int(i) for i in np.linspace(0, count - 1, min(most, count)).round()]
