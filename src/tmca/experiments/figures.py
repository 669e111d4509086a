"""The figures that come beside every result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.errors import OutputError
from tmca.experiments.composite import rgb_composite

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = (".png", ".pdf", ".svg")
_TITLE, _SMALL = 9, 8
_BAR = 0.12
"""Inches across a colour bar, at least."""
_LOOKED_AT = 2**20
_POINT_COLOURS = ("#d1495b", "#00798c", "#edae49", "#66a182")


def save_figure(figure: Figure, path: str | Path, *, overwrite: bool = False, dpi: int = 110) -> Path:
    """Write a figure as PNG, PDF or SVG, by its suffix, whole or not at all.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
    """
    from tmca.data import atomic_path

    check_picture(path)
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, dpi=dpi, format=Path(path).suffix[1:].lower(), facecolor="white")
    return Path(path)


def check_picture(path: str | Path) -> None:
    """Raises OutputError unless pictures can be written under this suffix."""
    if Path(path).suffix.lower() not in PICTURES:
        raise OutputError(path, f"the suffix {Path(path).suffix!r}", " ".join(PICTURES), "rename the picture")


def cube_figure(cube: np.ndarray, wavelengths: Sequence[float], title: str) -> Figure:
    """A cube: colour composite, the spectra of a few points, and bands from the first to the last."""
    figure, axes = grid(1, 3, width=4.2, aspect=cube.shape[1] / cube.shape[2])
    picture, points, chosen = rgb_composite(cube, wavelengths), spread_points(cube), evenly(len(cube), 12)
    image(axes[0, 0], picture, title)
    mark(axes[0, 0], points)
    spectra(axes[0, 1], {"": cube}, wavelengths, points)
    image(axes[0, 2], montage(cube, chosen), f"{len(chosen)} of {len(cube)} bands", colours="gray")
    for place, band in enumerate(chosen):
        y, x = divmod(place, min(4, len(chosen)))
        label = f"{wavelengths[band] * 1e9:.0f} nm"
        spot = (x * cube.shape[2] + 0.04 * cube.shape[2], (y + 1) * cube.shape[1] - 0.06 * cube.shape[1])
        axes[0, 2].text(*spot, label, color="#ffd166", fontsize=6)
    return figure


def image_figure(values: np.ndarray, title: str) -> Figure:
    """A 2-D image, or planes of a 3-D stack (smallest axis first), in grey."""
    figure, axes = grid(1, 1, width=7.0)
    planes = values[None] if values.ndim == 2 else np.moveaxis(values, int(np.argmin(values.shape)), 0)
    chosen = evenly(len(planes), 16)
    shown = axes[0, 0].imshow(montage(planes, chosen), cmap="gray", interpolation="nearest")
    bare(axes[0, 0], title if len(planes) == 1 else f"{title}: planes {', '.join(map(str, chosen))} of {len(planes)}")
    add_bar(axes[0, 0], shown, "stored value")
    return figure


def spread_points(cube: np.ndarray, count: int = 3) -> list[tuple[int, int]]:
    """A few lit pixels (row, column), each of a spectrum whose shape is farthest from those before; of a large picture
    every second pixel, or third, … is looked at."""
    from scipy.ndimage import uniform_filter

    apart = 1 + isqrt(cube.shape[1] * cube.shape[2] // _LOOKED_AT)
    if apart > 1:
        return [(apart * row, apart * column) for row, column in spread_points(cube[:, ::apart, ::apart], count)]
    smooth = np.stack([uniform_filter(band, 7) for band in cube]).reshape(len(cube), -1)
    strength = np.linalg.norm(smooth, axis=0)
    shape = smooth / np.maximum(strength, 0.3 * strength.max() + 1e-12)
    shape[:, strength < 0.3 * strength.max()] = shape[:, [int(strength.argmax())]]
    inside = np.zeros(cube.shape[1:], dtype=bool)
    rows, columns = cube.shape[1] // 12, cube.shape[2] // 12
    inside[rows : cube.shape[1] - rows, columns : cube.shape[2] - columns] = True
    strength = np.where(inside.ravel(), strength, 0)
    chosen = [int(strength.argmax())]
    distance = np.full(shape.shape[1], np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, ((shape - shape[:, [chosen[-1]]]) ** 2).sum(0))
        chosen.append(int(distance.argmax()))
    return [(index // cube.shape[2], index % cube.shape[2]) for index in chosen]


def grid(rows: int, columns: int, width: float, aspect: float = 0.8) -> tuple[Figure, np.ndarray]:
    """Axes for pictures ``width`` inches wide whose height is ``aspect`` times that."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, (width * aspect + 0.35) * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def image(
    axis: Axes, values: np.ndarray, title: str, colours: str = "viridis", top: float | None = None, bar: str = ""
) -> None:
    """An image without ticks; ``bar`` is the label of a colour bar."""
    shown = axis.imshow(values, cmap=colours, vmin=0, vmax=top, interpolation="nearest")
    bare(axis, title)
    if bar:
        add_bar(axis, shown, bar)


def add_bar(axis: Axes, shown: Any, label: str) -> None:
    """A colour bar as high as the picture, with its label in the size of the other texts."""
    inches = axis.bbox.width / axis.figure.dpi
    bar = axis.figure.colorbar(shown, cax=axis.inset_axes((1.02, 0, max(0.04, _BAR / inches), 1)))
    bar.set_label(label, fontsize=_SMALL)
    bar.ax.tick_params(labelsize=_SMALL)


def plain_axes(axis: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of a plot, in the size of all texts."""
    axis.set_title(title, fontsize=_TITLE)
    axis.set_xlabel(x, fontsize=_SMALL)
    axis.set_ylabel(y, fontsize=_SMALL)
    axis.tick_params(labelsize=_SMALL)


def bare(axis: Axes, title: str) -> None:
    axis.set_title(title, fontsize=_TITLE)
    axis.set_xticks([])
    axis.set_yticks([])


def mark(axis: Axes, points: Sequence[tuple[int, int]]) -> None:
    for colour, (row, column) in zip(_POINT_COLOURS, points, strict=False):
        axis.plot(column, row, "o", markersize=7, markerfacecolor=colour, markeredgecolor="white")


def spectra(
    axis: Axes, cubes: Mapping[str, np.ndarray], wavelengths: Sequence[float], points: Sequence[tuple[int, int]]
) -> None:
    """Solid: the first cube (the truth); the others with dashes and dots."""
    nanometres = np.asarray(wavelengths) * 1e9
    styles: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (6, 2)), (0, (3, 1, 1, 1)))
    for style, (name, cube) in zip(styles, cubes.items(), strict=False):
        for index, (row, column) in enumerate(points):
            label = name if index == 0 and name else None
            axis.plot(
                nanometres,
                cube[:, row, column],
                linestyle=style,
                color=_POINT_COLOURS[index],
                label=label,
                linewidth=1.4,
            )
    plain_axes(axis, "spectra at the points", "wavelength (nm)", "relative irradiance")
    if any(cubes):
        axis.legend(fontsize=_SMALL)


def montage(planes: np.ndarray, chosen: Sequence[int]) -> np.ndarray:
    """The chosen planes side by side in up to four columns; places without one are not a number, and stay white."""
    columns = min(4, len(chosen))
    rows = -(-len(chosen) // columns)
    height, width = planes.shape[1:]
    sheet = np.full((rows * height, columns * width), np.nan, dtype=np.float32)
    for place, index in enumerate(chosen):
        y, x = divmod(place, columns)
        sheet[y * height : (y + 1) * height, x * width : (x + 1) * width] = planes[index]
    return sheet


def evenly(count: int, most: int) -> list[int]:
    """At most ``most`` indices, evenly from the first of ``count`` to the last."""
    return [int(i) for i in np.linspace(0, count - 1, min(most, count)).round()]
