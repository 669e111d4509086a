"""Spectral cubes: colour composites, bands, spectra of points, reconstructions beside the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isqrt
from operator import index
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.errors import SettingError
from tmca.metrics import psnr
from tmca.plots.style import BLUE, RED, SMALL, TITLE, bright_level, evenly, grid, image, montage, plain_axes, rms

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RGB_WAVELENGTHS = (650e-9, 550e-9, 480e-9)
"""Bands shown as red, green and blue, metres (thesis section 4.2)."""
_SEEN_NM = ((570, 750), (480, 610), (380, 530))
"""Of what is shown as red, green and blue: what may pass for it."""
_POINT_COLOURS = (RED, BLUE, "#edae49", "#66a182", "#8d6a9f", "#5b4a3a")
_LOOKED_AT = 2**20
_UNIT = "relative irradiance"
_ERROR, _PREDICTED = "error (rms over bands)", "predicted error (1 σ)"
_TOGETHER = 2
"""Estimates whose spectra still read well in one panel."""
_COLUMNS, _BANDS, _POINTS, _LINES = 4, 6, 3, 5


def rgb_bands(wavelengths: Sequence[float]) -> tuple[int, int, int]:
    """Indices of the bands shown as red, green and blue: those nearest to 650, 550 and 480 nm; where two of them are
    the same, as of bands that no eye sees, three that are spread over all from long to short."""
    axis = np.asarray(wavelengths)
    red, green, blue = (int(np.abs(axis - w).argmin()) for w in RGB_WAVELENGTHS)
    if len({red, green, blue}) < 3 <= len(axis):
        rising = np.argsort(axis, kind="stable")
        red, green, blue = (int(rising[round(share * (len(axis) - 1))]) for share in (5 / 6, 1 / 2, 1 / 6))
    return red, green, blue


def false_colour(wavelengths: Sequence[float]) -> str:
    """Which bands are shown as red, green and blue, where an eye would see other colours; else nothing."""
    shown = [wavelengths[band] * 1e9 for band in rgb_bands(wavelengths)]
    if all(low <= nm <= high for nm, (low, high) in zip(shown, _SEEN_NM, strict=True)):
        return ""
    return "false colour: {:.0f} nm as red, {:.0f} nm as green, {:.0f} nm as blue".format(*shown)


def note_false_colour(figure: Figure, wavelengths: Sequence[float]) -> Figure:
    """A figure with that above it, where its composites are no colours that an eye would see."""
    note = false_colour(wavelengths)
    if note:
        figure.suptitle(note, fontsize=TITLE)
    return figure


def white_level(cube: np.ndarray, wavelengths: Sequence[float]) -> float:
    """Irradiance shown as white: the 99.5 % quantile of the three bands."""
    return bright_level(cube[list(rgb_bands(wavelengths))])


def rgb_composite(cube: np.ndarray, wavelengths: Sequence[float], white: float | None = None) -> np.ndarray:
    """(L, H, W) cube → (H, W, 3) picture in [0, 1], gamma 2.2.

    Args:
        cube: relative irradiance.
        wavelengths: (L,) metres.
        white: irradiance shown as white; pass the truth's ``white_level`` to compare estimates.
    """
    level = white_level(cube, wavelengths) if white is None else white
    picture = np.clip(cube[list(rgb_bands(wavelengths))] / level, 0, 1) ** (1 / 2.2)
    return np.moveaxis(picture, 0, -1)


def linear_srgb(cube: np.ndarray, wavelengths: Sequence[float], lamp: np.ndarray | None = None) -> np.ndarray:
    """(L, H, W) relative irradiance → (3, H, W) linear sRGB; a spectrum like the lamp's is white.

    ``X = Σ_ℓ x_ℓ Δλ_ℓ x̄(λ_ℓ)`` and so on, with the CIE 1931 observer and the bands' own widths.

    Args:
        cube: spectral density, as a response in proportion to the bands' widths leaves it.
        wavelengths: (L,) metres, rising.
        lamp: (L,) spectrum shown as white; an even one without it.
    """
    import colour

    nm = np.asarray(wavelengths) * 1e9
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    matching = np.stack([np.interp(nm, observer.wavelengths, observer.values[:, i]) for i in range(3)])
    matching = matching * np.gradient(nm)
    to_rgb = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ matching
    white = to_rgb @ (np.ones(len(nm)) if lamp is None else lamp)
    return np.tensordot(to_rgb, cube, axes=1) / white[:, None, None]


def srgb_picture(
    cube: np.ndarray, wavelengths: Sequence[float], lamp: np.ndarray | None = None, level: float | None = None
) -> np.ndarray:
    """(H, W, 3) picture in [0, 1], with the curve of sRGB.

    Args:
        cube, wavelengths, lamp: as for `linear_srgb`.
        level: linear value shown as full; the 99.8 % quantile without it.
    """
    import colour

    linear = linear_srgb(cube, wavelengths, lamp)
    top = shown_level(linear) if level is None else level
    shown = np.clip(linear / top, 0, 1).astype(np.float32)
    return np.moveaxis(np.asarray(colour.cctf_encoding(shown, function="sRGB"), dtype=np.float32), 0, -1)


def shown_level(linear: np.ndarray) -> float:
    """The linear value that a picture shows as full."""
    return bright_level(linear, 0.998)


def cube_figure(cube: np.ndarray, wavelengths: Sequence[float], title: str) -> Figure:
    """A cube: colour composite, the spectra of a few points, and bands from the first to the last."""
    figure, axes = grid(1, 3, width=4.2, aspect=cube.shape[1] / cube.shape[2])
    picture, points, chosen = rgb_composite(cube, wavelengths), sample_points(cube), evenly(len(cube), 12)
    image(axes[0, 0], picture, title)
    mark(axes[0, 0], points)
    spectra(axes[0, 1], {"": cube}, wavelengths, points)
    image(axes[0, 2], montage(cube, chosen), f"{len(chosen)} of {len(cube)} bands", colours="gray")
    for place, band in enumerate(chosen):
        y, x = divmod(place, min(4, len(chosen)))
        label = f"{wavelengths[band] * 1e9:.0f} nm"
        spot = (x * cube.shape[2] + 0.04 * cube.shape[2], (y + 1) * cube.shape[1] - 0.06 * cube.shape[1])
        axes[0, 2].text(*spot, label, color="#ffd166", fontsize=SMALL)
    return note_false_colour(figure, wavelengths)


def sample_points(cube: np.ndarray, count: int = 3) -> list[tuple[int, int]]:
    """A few lit pixels (row, column), each of a spectrum whose shape is farthest from those before; of a large picture
    every second pixel, or third, … is looked at."""
    from scipy.ndimage import uniform_filter

    apart = 1 + isqrt(cube.shape[1] * cube.shape[2] // _LOOKED_AT)
    if apart > 1:
        return [(apart * row, apart * column) for row, column in sample_points(cube[:, ::apart, ::apart], count)]
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


def mark(axis: Axes, points: Sequence[tuple[int, int]]) -> None:
    for colour, (row, column) in zip(_POINT_COLOURS, points, strict=False):
        (point,) = axis.plot(column, row, "o", markersize=7, markerfacecolor=colour, markeredgecolor="white")
        point.set(clip_on=False, zorder=3)  # whole at an edge, above the frame


def spectra(
    axis: Axes,
    cubes: Mapping[str, np.ndarray],
    wavelengths: Sequence[float],
    points: Sequence[tuple[int, int]],
    deviations: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Solid: the first cube (the truth); the others with dashes and dots, and a band of ±1 σ where that is known. The
    legend (`legend_below`) has the first lines of their names."""
    nanometres, bands = np.asarray(wavelengths) * 1e9, deviations or {}
    styles: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (6, 2)), (0, (3, 1, 1, 1)))
    for style, (name, cube) in zip(styles, cubes.items(), strict=False):
        for colour, (row, column) in zip(_POINT_COLOURS, points, strict=False):
            label = name.partition("\n")[0] if (row, column) == tuple(points[0]) and name else None
            values = cube[:, row, column]
            axis.plot(nanometres, values, linestyle=style, color=colour, label=label, linewidth=1.4)
            if name in bands:
                spread = bands[name][:, row, column]
                band = f"{label} ±1 σ" if label else None
                axis.fill_between(
                    nanometres, values - spread, values + spread, color=colour, alpha=0.25, linewidth=0, label=band
                )
    plain_axes(axis, "spectra at the points", "wavelength (nm)", _UNIT)


def legend_below(figure: Figure, axis: Axes) -> None:
    """What the lines of an axis are, below all axes, where it covers none of them."""
    figure.legend(*axis.get_legend_handles_labels(), fontsize=SMALL, loc="outside lower center", ncols=3)


def check_points(at: Any, size: tuple[int, int]) -> list[tuple[int, int]]:
    """Pixels (row, column) whose spectra are drawn.

    Raises:
        SettingError: none or too many of them, something else, or a pixel outside ``size``.
    """
    expected = f"1 to {len(_POINT_COLOURS)} pixels (row, column) within {size[0]} × {size[1]}"
    try:
        points = [(index(row), index(column)) for row, column in at]
    except (TypeError, ValueError):
        raise SettingError("at", str(at), expected, "such as [(20, 30)]") from None
    inside = all(0 <= row < size[0] and 0 <= column < size[1] for row, column in points)
    if not (inside and 1 <= len(points) <= len(_POINT_COLOURS)):
        raise SettingError("at", str(at), expected, "counted from 0")
    return points


def reconstruction_figure(
    estimates: Mapping[str, np.ndarray],
    wavelengths: Sequence[float],
    truth: np.ndarray | None = None,
    deviations: Mapping[str, np.ndarray] | None = None,
    at: Sequence[tuple[int, int]] | None = None,
) -> Figure:
    """Colour composites, error and uncertainty maps of one or more reconstructions, and spectral signatures at points:
    one panel for all of them, or one for each where they are more than two.

    Args:
        estimates: name → (L, H, W).
        wavelengths: (L,) metres.
        truth: (L, H, W), if it is known.
        deviations: name → (L, H, W) predicted standard deviation; the spectra have a band of ±1 σ.
        at: pixels (row, column) of the spectra; some of different spectra without.

    Raises:
        SettingError: a pixel outside the picture, or too many.
    """
    known = {name: spread for name, spread in (deviations or {}).items() if name in estimates}
    reference = truth if truth is not None else next(iter(estimates.values()))
    points = sample_points(reference) if at is None else check_points(at, (reference.shape[1], reference.shape[2]))
    errors = {} if truth is None else {name: rms(cube - truth) for name, cube in estimates.items()}
    drawn = _Reconstructions(estimates, wavelengths, truth, known, points, errors)
    return drawn.of_one() if len(estimates) == 1 else drawn.of_several()


@dataclass(frozen=True, eq=False)
class _Reconstructions:
    """What `reconstruction_figure` draws."""

    estimates: Mapping[str, np.ndarray]
    wavelengths: Sequence[float]
    truth: np.ndarray | None
    deviations: Mapping[str, np.ndarray]
    points: Sequence[tuple[int, int]]
    errors: Mapping[str, np.ndarray]

    @cached_property
    def reference(self) -> np.ndarray:
        """What is drawn first, and gives the level of white."""
        return next(iter(self.estimates.values())) if self.truth is None else self.truth

    @cached_property
    def real(self) -> dict[str, np.ndarray]:
        """The truth by its name."""
        return {} if self.truth is None else {"truth": self.truth}

    @cached_property
    def predicted(self) -> dict[str, np.ndarray]:
        """Maps of the predicted errors."""
        return {name: rms(values) for name, values in self.deviations.items()}

    @cached_property
    def look(self) -> dict[str, Any]:
        """Of maps of errors, all on one scale."""
        maps = [values.ravel() for values in (*self.errors.values(), *self.predicted.values())]
        return {"colours": "magma", "top": float(np.quantile(np.concatenate(maps or [np.ones(1)]), 0.99))}

    def composite(self, axis: Axes, cube: np.ndarray, title: str) -> None:
        """Of a cube, as bright as the reference."""
        white = white_level(self.reference, self.wavelengths)
        image(axis, rgb_composite(cube, self.wavelengths, white), title)

    def of_one(self) -> Figure:
        """Pictures in two or three columns, and below them the spectra, as wide as all."""
        ((name, cube),) = self.estimates.items()
        count = len(self.real) + 1 + len(self.errors) + len(self.predicted)
        columns = count if count < 4 else 2
        rows = 1 + count // columns
        aspect = cube.shape[1] / cube.shape[2]
        figure, axes = grid(rows, columns, width=3.6, aspect=aspect)
        panels = iter(axes.flat)
        if self.truth is not None:
            self.composite(axis := next(panels), self.truth, "truth")
            mark(axis, self.points)
        self.composite(axis := next(panels), cube, captioned(name, cube, self.truth))
        mark(axis, self.points)
        maps = {_ERROR: self.errors.get(name), _PREDICTED: self.predicted.get(name)}
        drawn = {title: values for title, values in maps.items() if values is not None}
        for title, values in drawn.items():
            image(next(panels), values, title, **self.look, bar=_UNIT if title == list(drawn)[-1] else "")
        panel = _joined(figure, axes[-1])
        spectra(panel, {**self.real, name: cube}, self.wavelengths, self.points, self.deviations)
        places = "\n" * (columns == 1) + ", ".join(map(str, self.points))  # one column is too narrow for one line
        panel.set_title(f"spectra at (row, column) {places}", fontsize=TITLE)
        panel.set_box_aspect(min(1.0, aspect / columns, 0.6))
        legend_below(figure, panel)
        return figure

    def of_several(self) -> Figure:
        """A column for each beside that of the truth."""
        many = len(self.estimates) > _TOGETHER
        rows = 1 + bool(self.errors) + bool(self.predicted) + many
        columns = len(self.estimates) + 1 + (rows == 1)
        figure, axes = grid(rows, columns, width=3.6, aspect=self.reference.shape[1] / self.reference.shape[2])
        self.composite(axes[0, 0], self.reference, "truth" if self.real else "points")
        mark(axes[0, 0], self.points)
        for column, name in zip(axes[:, 1:].T, self.estimates, strict=False):
            self._column(column, name, many)
        if not many:
            panel = _joined(figure, axes[1:, 0]) if rows > 1 else axes[0, -1]
            spectra(panel, {**self.real, **self.estimates}, self.wavelengths, self.points, self.deviations)
            panel.set_box_aspect(min(1.0, self.reference.shape[1] / self.reference.shape[2]))
        predicting = [at for at, name in enumerate(self.estimates, 1) if name in self.deviations]
        legend_below(figure, axes[-1, (predicting or [1])[0]] if many else panel)
        return figure

    def _column(self, column: np.ndarray, name: str, many: bool) -> None:
        """Of an estimate: its colours, its errors, and among many its spectra."""
        cube = self.estimates[name]
        self.composite(column[0], cube, captioned(name, cube, self.truth))
        look = {**self.look, "bar": _UNIT if name == list(self.estimates)[-1] else ""}
        if name in self.errors:
            image(column[1], self.errors[name], _ERROR, **look)
        below = column[-2 if many else -1]
        if name in self.predicted:
            image(below, self.predicted[name], _PREDICTED, **look)
        elif self.predicted:
            below.text(0.5, 0.5, "no error predicted", ha="center", va="center", color="#777777")
        if many:
            own = {"estimate": self.deviations[name]} if name in self.deviations else {}
            spectra(column[-1], {**self.real, "estimate": cube}, self.wavelengths, self.points, own)


def _joined(figure: Figure, axes: np.ndarray) -> Axes:
    """One axis in the place of several in a row or a column."""
    first, last = (axis.get_subplotspec() for axis in (axes[0], axes[-1]))
    place = first.get_gridspec()[first.rowspan.start : last.rowspan.stop, first.colspan.start : last.colspan.stop]
    for axis in axes:
        axis.remove()
    return figure.add_subplot(place)


def captioned(name: str, cube: np.ndarray, truth: np.ndarray | None) -> str:
    """The name, with the PSNR where the truth is known."""
    return name if truth is None else f"{name}\n{psnr(cube, truth):.2f} dB"


def composites(
    truth: np.ndarray, estimates: Mapping[str, np.ndarray], wavelengths: Sequence[float], conditions: str
) -> Figure:
    """Colour composites (650, 550, 480 nm) with their PSNR beside the truth, under ``conditions`` (figure 20)."""
    rows = -(-(1 + len(estimates)) // _COLUMNS)
    figure, axes = grid(rows, _COLUMNS, width=3.2, aspect=truth.shape[1] / truth.shape[2] + 0.06)
    white = white_level(truth, wavelengths)
    image(axes[0, 0], rgb_composite(truth, wavelengths, white), f"truth\n{conditions}")
    for axis, (name, cube) in zip(axes.flat[1:], estimates.items(), strict=False):
        image(axis, rgb_composite(cube, wavelengths, white), f"{name}: {psnr(cube, truth):.2f} dB")
    return figure


def signatures(truth: np.ndarray, estimates: Mapping[str, np.ndarray], wavelengths: Sequence[float]) -> Figure:
    """Spectra of the truth and of some rows at a few points (figure 21)."""
    points = sample_points(truth, _POINTS)
    figure, axes = grid(1, 1 + _POINTS, width=3.6, aspect=0.85)
    image(axes[0, 0], rgb_composite(truth, wavelengths), "truth")
    mark(axes[0, 0], points)
    nanometres = np.asarray(wavelengths) * 1e9
    for axis, (row, column) in zip(axes[0, 1:], points, strict=True):
        axis.plot(nanometres, truth[:, row, column], "k-", linewidth=2, label="truth")
        for name in _some(list(estimates), _LINES):
            axis.plot(nanometres, estimates[name][:, row, column], linewidth=1, label=name.replace("\n", " + "))
        plain_axes(axis, f"row {row}, column {column}", "wavelength (nm)", "relative irradiance")
    axes[0, -1].legend(fontsize=6)
    return figure


def bands(truth: np.ndarray, estimates: Mapping[str, np.ndarray], wavelengths: Sequence[float]) -> Figure:
    """Six bands of the truth and of some rows (figure 22)."""
    chosen, names = evenly(len(truth), _BANDS), _some(list(estimates), _LINES - 1)
    figure, axes = grid(1 + len(names), len(chosen), width=2.2, aspect=truth.shape[1] / truth.shape[2])
    for row, (name, cube) in zip(axes, {"truth": truth, **{n: estimates[n] for n in names}}.items(), strict=True):
        for axis, band in zip(row, chosen, strict=True):
            top = float(np.quantile(truth[band], 0.995)) or 1.0
            title = f"{wavelengths[band] * 1e9:.0f} nm" if cube is truth else ""
            image(axis, cube[band].clip(0), title, colours="gray", top=top)
        row[0].set_ylabel(name, fontsize=7)
    return figure


def _some(names: list[str], count: int) -> list[str]:
    """The first, the last and names evenly between."""
    return [names[i] for i in evenly(len(names), count)]
