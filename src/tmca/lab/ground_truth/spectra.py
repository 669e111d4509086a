"""Spectra from text files, and spectra of points of a cube held against a spectrometer's."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError, check_choice, check_range
from tmca.metrics import sam
from tmca.text_files import read_text

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
_FEWEST = 3


@dataclass(frozen=True)
class Spectra:
    """``values`` ``(n, L)`` at ``nm`` ``(L,)``, ascending; ``names`` of the n spectra."""

    source: Path
    names: tuple[str, ...]
    nm: Array
    values: Array

    def at(self, nm: Array, width_nm: float = 0.0) -> Array:
        """``(n, len(nm))``: the spectra as bands of Gaussian shape see them.

        Args:
            nm: centres of the bands.
            width_nm: full width at half maximum; 0 for interpolation between the stored points.

        Raises:
            DataError: bands outside the file's wavelengths by more than a nanometre.
            SettingError: a negative width.
        """
        check_range("bandwidth", width_nm, 0, unit="nm")
        if nm.min() < self.nm[0] - 1 or nm.max() > self.nm[-1] + 1:
            found = f"spectra from {self.nm[0]:g} to {self.nm[-1]:g} nm"
            raise DataError(self.source, found, f"{nm.min():g} to {nm.max():g} nm", "measure or choose those bands")
        if not width_nm:
            return np.stack([np.interp(nm, self.nm, row) for row in self.values])
        sigma = width_nm / np.sqrt(8 * np.log(2))
        # points of a spectrometer are not evenly apart: each counts for its share of the axis
        weight = np.exp(-(((nm[:, None] - self.nm) / sigma) ** 2) / 2) * np.gradient(self.nm)
        total = weight.sum(axis=1, keepdims=True)
        narrow = total[:, 0] < 1e-12 * sigma
        return np.where(narrow, self.at(nm), self.values @ (weight / np.where(total > 0, total, 1)).T)


def read_spectra(path: str | Path) -> Spectra:
    """Read columns of numbers: wavelength in nm, then one spectrum or filter response per column.

    Separators are commas, semicolons, tabs or spaces. Lines before the numbers are the instrument's; the last of them
    names the columns if it has as many words as they, else they are named after the file and their number.

    Raises:
        DataError: no such file, no numbers, wavelengths that are not nm or that come twice, or values that are no
        numbers.
    """
    path = Path(path)
    lines = read_text(path, "a text file of spectra", lenient=True).splitlines()
    rows, heading = _rows(path, lines)
    table = np.array(rows)
    nm, values = table[:, 0], table[:, 1:].T
    if not np.isfinite(table).all():
        raise DataError(path, "values that are not finite", "numbers", "take those lines away")
    if nm.min() < 100 or nm.max() > 20000:
        raise DataError(path, f"wavelengths from {nm.min():g} to {nm.max():g}", "nanometres in the first column")
    order = np.argsort(nm)
    if (np.diff(nm[order]) <= 0).any():
        raise DataError(path, "a wavelength twice", "each once", "average its values")
    return Spectra(path, _names(path, heading, len(values)), nm[order], values[:, order])


def _rows(path: Path, lines: list[str]) -> tuple[list[list[float]], str]:
    """The lines of numbers, and the line before them."""
    rows: list[list[float]] = []
    heading = ""
    for number, line in enumerate(lines, 1):
        words = [word for word in re.split(r"[\s,;]+", line.split("#")[0].strip()) if word]
        try:
            values = [float(word) for word in words]
        except ValueError:
            if rows and not line.startswith(">"):
                raise DataError(path, f"line {number}: {line.strip()[:40]!r}", "numbers") from None
            heading = line if not rows and not line.startswith(">") else heading
            continue
        if len(values) == 1 or (rows and values and len(values) != len(rows[0])):
            width = len(rows[0]) if rows else 2
            raise DataError(path, f"line {number} with {len(values)} numbers", f"{width} or more columns")
        rows += [values] if values else []
    if len(rows) < _FEWEST:
        raise DataError(path, f"{len(rows)} lines of numbers", "wavelength and values, a line for each wavelength")
    return rows, heading


def _names(path: Path, heading: str, count: int) -> tuple[str, ...]:
    words = [word.strip().strip("\"'") for word in re.split(r"[\t,;]+|\s{2,}", heading.lstrip("# ").strip())]
    if len(words) != count + 1:
        words = heading.lstrip("# ").split()
    if len(words) == count + 1 and len(set(words)) == len(words):
        return tuple(words[1:])
    return (path.stem,) if count == 1 else tuple(f"{path.stem} {i + 1}" for i in range(count))


@dataclass(frozen=True)
class Comparison:
    """One point: its mean spectrum, its spread over the box and the reference at ``nm``, all ``(L,)``.

    ``angle`` is the SAM in degrees, ``rmse`` the root mean square difference; ``filters`` has per filter response
    what it sees of (spectrum, reference).
    """

    name: str
    place: tuple[int, int]
    nm: Array
    spectrum: Array
    spread: Array
    reference: Array
    angle: float
    rmse: float
    filters: dict[str, tuple[float, float]]

    def row(self) -> dict[str, Any]:
        """For a table or JSON."""
        seen = {f"filter {name}": values for name, values in self.filters.items()}
        y, x = self.place
        return {"point": self.name, "y": y, "x": x, "bands": self.nm.size, "sam": self.angle, "rmse": self.rmse, **seen}


def compare_spectra(
    cube: xr.DataArray,
    references: Spectra,
    points: Mapping[str, tuple[int, int]],
    *,
    box: int = 5,
    width_nm: float = 0.0,
    filters: Spectra | None = None,
) -> list[Comparison]:
    """Compare boxes of a cube with the reference spectra of the same names, as in figure 30 of the thesis.

    Args:
        cube: ``(wavelength, y, x)``; NaN is left out, and a band with nothing else is not compared.
        references: of a spectrometer.
        points: (row, column) of a box's middle, by the name of its reference.
        box: pixels along each side, odd.
        width_nm: of the scan's bands, by which the references are smoothed; see `Spectra.at`.
        filters: responses through which both are seen too.

    Raises:
        SettingError: an even box, no points, or one without reference.
        DataError: a point outside, or whose box has no spectrum; references that do not cover the bands.
    """
    if box < 1 or box % 2 == 0:
        raise SettingError("box", str(box), "an odd number of pixels")
    if not points:
        raise SettingError("points", "none", "NAME=ROW,COLUMN for each reference")
    nm = metres_to_nm(cube["wavelength"].values)
    by_name = dict(zip(references.names, references.at(nm, width_nm), strict=True))
    for name in points:
        check_choice("points", name, by_name)
    responses = {} if filters is None else dict(zip(filters.names, filters.at(nm), strict=True))
    return [_compared(cube, nm, name, place, by_name[name], box, responses) for name, place in points.items()]


def _compared(
    cube: xr.DataArray,
    nm: Array,
    name: str,
    place: tuple[int, int],
    reference: Array,
    box: int,
    responses: Mapping[str, Array],
) -> Comparison:
    half, (y, x), size = box // 2, place, cube.shape[1:]
    where = cube.attrs.get("source", "cube")
    if not (half <= y < size[0] - half and half <= x < size[1] - half):
        found = f"point {name} at {y},{x} with a box of {box}"
        raise DataError(where, found, f"a box inside {size[0]}×{size[1]} pixels")
    pixels = cube.values[:, y - half : y + half + 1, x - half : x + half + 1].reshape(len(nm), -1).astype(np.float64)
    seen = np.isfinite(pixels).any(axis=1)
    if seen.sum() < 2:
        raise DataError(where, f"{seen.sum()} bands measured at {name} ({y},{x})", "2 or more", "choose another point")
    nm, reference, pixels = nm[seen], reference[seen], pixels[seen]
    spectrum, spread = np.nanmean(pixels, axis=1), np.nanstd(pixels, axis=1)
    angle = float(sam(spectrum[:, None, None], reference[:, None, None]))
    rmse = float(np.sqrt(np.mean((spectrum - reference) ** 2)))
    through = {n: (_through(r[seen], spectrum), _through(r[seen], reference)) for n, r in responses.items()}
    return Comparison(name, place, nm, spectrum, spread, reference, angle, rmse, through)


def _through(response: Array, spectrum: Array) -> float:
    total = response.sum()
    return float(response @ spectrum / total) if total > 0 else float("nan")


def comparison_figure(compared: Sequence[Comparison]) -> Figure:
    """A panel per point: measured with its spread over the box, reference, and their angle above."""
    from tmca.plots.lab import compared_spectra_figure

    titles = [f"{one.name} at {one.place[0]},{one.place[1]}: SAM {one.angle:.2f}°" for one in compared]
    arrays = [(one.nm, one.spectrum, one.spread, one.reference) for one in compared]
    return compared_spectra_figure(dict(zip(titles, arrays, strict=True)))
