"""Spectra from text files: a spectrometer's references, filter responses, the reflectance of a white tile."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError

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
        if not width_nm >= 0:
            raise SettingError("bandwidth", repr(width_nm), "nanometres from 0 up")
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
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise DataError(path, f"no readable file ({error.strerror})", "a text file of spectra") from error
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
