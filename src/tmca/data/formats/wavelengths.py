"""Wavelengths: units, checks, sidecar files. Metres inside, nanometres in files."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.errors import DataError, SettingError

NAMES = frozenset(
    {
        *("wavelength", "wavelengths", "wavelength_nm", "wavelengths_nm", "wavelength_um", "wave_length"),
        *(
            "wavelen",
            "wave",
            "waves",
            "wl",
            "wls",
            "lambda",
            "lambdas",
            "bands",
            "band",
            "centers",
            "centres",
            "nm",
        ),
    }
)
"""Names, in lower case, under which files keep their wavelengths or label their spectral axis."""

_TO_NM = {"nm": 1.0, "um": 1e3, "m": 1e9, "a": 0.1}
_UNIT_NAMES = {
    "nm": ("nm", "nanometer", "nanometers", "nanometre", "nanometres"),
    "um": ("um", "µm", "μm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "a": ("a", "å", "angstrom", "angstroms"),
}


def metres_to_nm(metres: ArrayLike) -> NDArray[np.float64]:
    """Nanometres, rounded to a femtometre so that 400e-9 m is 400 nm and comes back as the same number."""
    return np.asarray(np.round(np.asarray(metres, dtype=np.float64) * 1e9, 6), dtype=np.float64)


def nm_to_metres(nm: ArrayLike) -> NDArray[np.float64]:
    """Metres; the inverse of `metres_to_nm` to the last bit."""
    return np.asarray(np.round(np.asarray(nm, dtype=np.float64), 6) / 1e9, dtype=np.float64)


def unit_of(text: object) -> str | None:
    """``"nm"``, ``"um"``, ``"m"`` or ``"a"`` (ångström) for a unit as files spell it; None for other text."""
    word = str(text).strip().lower()
    return next((unit for unit, names in _UNIT_NAMES.items() if word in names), None)


def guess_unit(values: NDArray[np.float64]) -> str | None:
    """The unit that makes the values optical wavelengths: 100 nm to 20 µm. None if no unit does."""
    ranges = {"nm": (100.0, 20000.0), "um": (0.1, 20.0), "m": (1e-7, 2e-5)}
    return next((unit for unit, (low, high) in ranges.items() if low <= values.min() and values.max() <= high), None)


def from_file(values: Any, unit: object = None) -> NDArray[np.float64] | None:
    """Metres from a vector of a file with an optional unit; None if the numbers are not wavelengths.

    Plain counting (0, 1, 2 … or 1, 2, 3 …) is taken as band numbers, not as micrometres.
    """
    vector = np.asarray(values)
    if vector.dtype.kind not in "uif" or vector.size == 0 or vector.size != max(vector.shape, default=1):
        return None
    vector = vector.astype(np.float64).ravel()
    count = np.arange(vector.size)
    if np.array_equal(vector, count) or np.array_equal(vector, count + 1):
        return None
    if not np.isfinite(vector).all() or (vector <= 0).all():
        return vector  # meant as wavelengths, and refused as such
    known = unit_of(unit) if unit is not None else None
    known = known or guess_unit(vector)
    return None if known is None else nm_to_metres(vector * _TO_NM[known])


def from_argument(wavelengths: Iterable[float], count: int, where: object) -> NDArray[np.float64]:
    """Check the ``wavelengths=`` argument: metres, one per band.

    Raises:
        SettingError: not metres.
        DataError: not one per band.
    """
    metres = np.asarray(list(wavelengths), dtype=np.float64).ravel()
    if metres.size and np.isfinite(metres).all() and guess_unit(metres) in ("nm", "um"):
        raise SettingError(
            "wavelengths",
            f"values from {metres.min():g} to {metres.max():g}",
            "metres",
            "write 400 nm as 400e-9",
        )
    return check(metres, count, where, "wavelengths=")


def check(metres: NDArray[np.float64], count: int, where: object, origin: str) -> NDArray[np.float64]:
    """One finite, positive, distinct wavelength per band.

    Raises:
        DataError: naming the file, the count found and the count expected.
    """
    if metres.size != count:
        raise DataError(where, f"{metres.size} wavelengths from {origin} for {count} bands", f"{count} wavelengths")
    if not np.isfinite(metres).all() or (metres <= 0).any():
        raise DataError(where, f"a wavelength from {origin} that is not a positive number", "metres above 0")
    if np.unique(metres).size != metres.size:
        raise DataError(where, f"the same wavelength twice from {origin}", "a wavelength of its own for each band")
    return metres


def sidecar_paths(path: Path) -> list[Path]:
    """Where a list of wavelengths may lie beside ``path``."""
    stems = dict.fromkeys((path.name, path.name if path.is_dir() else path.stem))
    return [path.with_name(f"{stem}.wavelengths.{kind}") for stem in stems for kind in ("txt", "csv")]


def read_sidecar(path: Path) -> NDArray[np.float64] | None:
    """Metres from ``<name>.wavelengths.txt|csv`` beside the file (nanometres, one per line or with commas);
    else None.

    Raises:
        DataError: a line that is not a number. One heading line and ``#`` comments are allowed.
    """
    found = next((side for side in sidecar_paths(path) if side.is_file()), None)
    if found is None:
        return None
    try:
        lines = [line.split("#")[0].strip() for line in found.read_text(encoding="utf-8-sig").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(found, f"an unreadable file ({error})", "wavelengths in nm, one per line") from error
    lines = [line for line in lines if line]
    if lines and re.match(r"[^\W\d]", lines[0].strip("\"'")):
        lines = lines[1:]
    try:
        nm = np.array([float(word) for line in lines for word in re.split(r"[\s,;]+", line) if word])
    except ValueError as error:
        raise DataError(found, str(error), "wavelengths in nm, one per line") from error
    if nm.size == 0 or guess_unit(nm) != "nm":
        values = f"values from {nm.min():g} to {nm.max():g}" if nm.size else "no values"
        raise DataError(found, values, "wavelengths in nm, one per line")
    return nm_to_metres(nm)
