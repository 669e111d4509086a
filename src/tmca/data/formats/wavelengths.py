"""What the values of a file mean: wavelengths (metres inside, nanometres in files), spectral axis, full scale.

Public data sets whose files carry no wavelengths are recognised by band count and variable name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.data.formats.stored import Contents, Stored
from tmca.errors import DataError, SettingError, check_range
from tmca.text_files import read_text

NAMES = frozenset(
    {
        *("wavelength", "wavelengths", "wavelength_nm", "wavelengths_nm", "wavelength_um", "wave_length"),
        *("wavelen", "wave", "waves", "wl", "wls", "lambda", "lambdas", "bands", "band", "centers", "centres", "nm"),
    }
)
"""Names, in lower case, under which files keep their wavelengths or label their spectral axis."""

_NM = {
    **dict.fromkeys(("nm", "nanometer", "nanometre"), 1.0),
    **dict.fromkeys(("um", "µm", "μm", "micron", "micrometer", "micrometre"), 1e3),
    **dict.fromkeys(("m", "meter", "metre"), 1e9),
    **dict.fromkeys(("a", "å", "angstrom"), 0.1),
}
"""Nanometres in a unit as files spell it, in the singular."""
_SHORTEST_NM, _LONGEST_NM = 100.0, 20000.0


def metres_to_nm(metres: ArrayLike) -> NDArray[np.float64]:
    """Nanometres, rounded to a femtometre so that 400e-9 m is 400 nm and comes back as the same number."""
    return np.asarray(np.round(np.asarray(metres, dtype=np.float64) * 1e9, 6), dtype=np.float64)


def nm_to_metres(nm: ArrayLike) -> NDArray[np.float64]:
    """Metres; the inverse of `metres_to_nm` to the last bit."""
    return np.asarray(np.round(np.asarray(nm, dtype=np.float64), 6) / 1e9, dtype=np.float64)


def guess_unit(values: NDArray[np.float64]) -> str | None:
    """The unit that makes the values optical wavelengths, 100 nm to 20 µm: "nm", "um" or "m"; None if none does."""
    for unit in ("nm", "um", "m"):
        if values.min() * _NM[unit] >= _SHORTEST_NM and values.max() * _NM[unit] <= _LONGEST_NM:
            return unit
    return None


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
    stated = str(unit).strip().lower().removesuffix("s")
    scale = _NM.get(stated) or _NM.get(guess_unit(vector) or "")
    return None if scale is None else nm_to_metres(vector * scale)


def from_argument(wavelengths: Iterable[float], count: int, where: object) -> NDArray[np.float64]:
    """Check the ``wavelengths=`` argument: metres, one per band.

    Raises:
        SettingError: not metres.
        DataError: not one per band.
    """
    metres = np.asarray(list(wavelengths), dtype=np.float64).ravel()
    if metres.size and np.isfinite(metres).all() and guess_unit(metres) in ("nm", "um"):
        raise SettingError(
            "wavelengths", f"values from {metres.min():g} to {metres.max():g}", "metres", "write 400 nm as 400e-9"
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


_LIST = "a list of wavelengths in nm, one per line"


def read_sidecar(path: Path) -> NDArray[np.float64] | None:
    """Metres from ``<name>.wavelengths.txt|csv`` beside the file (nanometres, one per line or with commas);
    else None.

    Raises:
        DataError: a line that is not a number. One heading line and ``#`` comments are allowed.
    """
    sidecar = next((side for side in sidecar_paths(path) if side.is_file()), None)
    if sidecar is None:
        return None
    lines = [line.split("#")[0].strip() for line in read_text(sidecar, _LIST).splitlines()]
    lines = [line for line in lines if line]
    heading = bool(lines) and re.match(r"[^\W\d]", lines[0].strip("\"'")) is not None
    words = [word for line in lines[heading:] for word in re.split(r"[\s,;]+", line) if word]
    try:
        nm = np.array([float(word) for word in words])
    except ValueError as error:
        raise DataError(sidecar, str(error)[:120], _LIST, "correct the line") from None
    if nm.size == 0 or guess_unit(nm) != "nm":
        values = f"values from {nm.min():g} to {nm.max():g}" if nm.size else "no values"
        raise DataError(sidecar, values, "wavelengths in nm, one per line")
    return nm_to_metres(nm)


_FLOWER_EDGES_NM = (
    *((423, 436), (437, 448), (449, 463), (464, 479), (480, 499), (500, 521)),
    *((522, 546), (547, 577), (578, 618), (619, 673), (674, 700)),
)
_TSA_NM = (
    *(453.3, 457.6, 462.1, 466.8, 471.6, 476.5, 481.6, 486.9, 492.4, 498.0, 503.9, 509.9, 516.2, 522.7),
    *(529.5, 536.5, 543.8, 551.4, 558.6, 567.5, 575.3, 584.3, 594.4, 604.2, 614.4, 625.1, 636.3, 648.1),
)


def _steps(first: float, last: float, count: int) -> tuple[float, ...]:
    return tuple(float(nm) for nm in np.linspace(first, last, count))


@dataclass(frozen=True)
class KnownSet:
    """A data set's signature and what its files leave unsaid.

    Attributes:
        name: the set.
        nm: band centres in nanometres.
        variables: names under which its files keep the cube; empty if the band count alone tells.
        full_scale: the count that stands for 1 where it is not the dtype's maximum.
    """

    name: str
    nm: tuple[float, ...]
    variables: frozenset[str] = frozenset()
    full_scale: float | None = None

    @property
    def label(self) -> str:
        """How the origin of the wavelengths is told to the user."""
        return f"known set {self.name}, {self.nm[0]:g}-{self.nm[-1]:g} nm"


KNOWN_SETS = (
    KnownSet("ICVL", _steps(400, 700, 31), frozenset({"rad"}), full_scale=4095.0),
    KnownSet("Harvard", _steps(420, 720, 31), frozenset({"ref"})),
    KnownSet("CAVE", _steps(400, 700, 31)),
    KnownSet("TSA-Net simulation", _TSA_NM, frozenset({"img", "img_expand", "data_slice"})),
    KnownSet("flower-stars", tuple((a + b) / 2 for a, b in _FLOWER_EDGES_NM), frozenset({"Ori"})),
    KnownSet("Samson", _steps(401, 889, 156)),
)
"""In order of precedence: sets that ask for a variable name come before those that go by count alone."""


def find_known(variable: str, bands: int) -> KnownSet | None:
    """The known set with this many bands whose files call the cube ``variable``."""
    short = variable.rsplit("/", 1)[-1]
    fits = (known for known in KNOWN_SETS if len(known.nm) == bands)
    return next((known for known in fits if not known.variables or short in known.variables), None)


def spectral_axis(stored: Stored, count: int | None = None) -> int | None:
    """The axis of a three-axis array that runs over wavelength.

    In this order: the axis the file labels so; the one as long as the wavelengths (``count`` of them, or
    those in the file); the one as long as a known set; the odd one out of two equal axes; the shortest by
    half or more; the pages of a file that has them.

    Returns:
        0, 1 or 2, or None where nothing tells.
    """
    labelled = [i for i, name in enumerate(stored.dims) if name.lower() in NAMES]
    if len(labelled) == 1:
        return labelled[0]
    count = _stated(stored, count)
    fitting = [i for i, n in enumerate(stored.shape) if n == count]
    fitting = fitting or [i for i, n in enumerate(stored.shape) if find_known(stored.name, n)]
    usual = stored.usual_axis % 3
    return (usual if usual in fitting else fitting[0]) if fitting else _odd_one_out(stored)


def _stated(stored: Stored, count: int | None) -> int | None:
    """How many wavelengths the caller gave, or the file has for this array; None without any."""
    return count or (None if stored.wavelengths is None else len(stored.wavelengths))


def _odd_one_out(stored: Stored) -> int | None:
    shape = stored.shape
    odd = [i for i in range(3) if shape.count(shape[i]) == 1]
    if len(odd) == 1:
        return odd[0]
    shortest = min(range(3), key=lambda i: shape[i])
    others = [n for i, n in enumerate(shape) if i != shortest]
    if 2 * shape[shortest] <= min(others):
        return shortest
    return 0 if stored.pages else None


MAIN = ("estimate", "radiance")
"""Names under which tmca's own files keep their cube, beside others such as its deviation."""
_NO_CUBE = "read masks and captures with tmca.data.read_array"


def find_cube(contents: Contents, variable: str | None, count: int | None) -> Stored:
    """The variable to read as a cube: the one asked for, or the only one that can be it.

    Args:
        contents: the open file.
        variable: its name, or None.
        count: how many wavelengths the caller gave, or None.

    Raises:
        DataError: none or several could be the cube, or the one asked for has not three axes.
    """
    if variable is not None:
        stored = contents.get(variable)
        if len(stored.shape) != 3 or not stored.size:
            found = f"variable {stored.name!r} of shape {stored.shape}"
            raise DataError(contents.path, found, "a spectral cube of three axes", _NO_CUBE)
        return stored
    contents.refuse_snapshot()
    cubes = [s for s in contents.arrays.values() if s.numeric and len(s.shape) == 3 and s.size]
    likelier = (
        [s for s in cubes if s.name in MAIN],
        [s for s in cubes if _stated(s, count) in s.shape],
        [s for s in cubes if any(find_known(s.name, n) for n in s.shape)],
    )
    return contents.only(next((few for few in likelier if len(few) == 1), cubes), "array of three axes", _NO_CUBE)


def give_wavelengths(arrays: dict[str, Stored]) -> dict[str, Stored]:
    """Give each cube the vector of wavelengths kept beside it in the file, where its length fits an axis; or note one
    whose length fits no cube."""
    cubes = {name: stored for name, stored in arrays.items() if len(stored.shape) == 3}
    for vector in [s for s in arrays.values() if s.name.rsplit("/", 1)[-1].lower() in NAMES]:
        if not vector.numeric or not vector.size or vector.size != max(vector.shape, default=0):
            continue
        values = vector.whole()
        metres = from_file(values, vector.attrs.get("units"))
        if metres is None:
            continue
        fitting = [name for name, stored in cubes.items() if len(metres) in stored.shape]
        arrays |= {name: replace(arrays[name], wavelengths=metres) for name in fitting}
        if not fitting and _surely(vector.name, values):
            misfit = f"{len(metres)} wavelengths in {vector.name}"
            arrays |= {name: replace(arrays[name], misfit=misfit) for name in cubes}
    return arrays


_OTHERS = frozenset({"band", "bands", "lambda", "lambdas", "centers", "centres"})
"""Of ``NAMES`` those under which files also keep indices, weights or places."""


def _surely(name: str, values: NDArray[Any]) -> bool:
    """Whether a vector can only be a list of wavelengths: by its name, or by numbers that are nanometres."""
    named = name.rsplit("/", 1)[-1].lower() not in _OTHERS
    return values.size > 1 and (named or guess_unit(values.astype(np.float64)) == "nm")


def divisor(stored: Stored, axis: int, scale: float | None, bands: NDArray[Any] | None) -> tuple[float, str]:
    """What the stored values are divided by to become relative irradiance, and where that comes from.

    ``scale`` if given; what the file states; a known set's full scale (ICVL's 12 bits); an integer type's
    maximum; for floats the maximum of the whole cube if it is above 1, else 1.

    Args:
        stored: the array in its file.
        axis: its spectral axis.
        scale: the user's divisor, or None.
        bands: the float pixels if they are all loaded already, else None and they are read band by band.

    Raises:
        SettingError: a ``scale`` that is not a positive number.
    """
    if scale is not None:
        check_range("scale", scale, above=0)
        return float(scale), "argument"
    if stored.full_scale is not None:
        return stored.full_scale, "file"
    known = find_known(stored.name, stored.shape[axis])
    if known is not None and known.full_scale and 1 < _maximum(stored, axis, bands) <= known.full_scale:
        return known.full_scale, known.label
    if stored.dtype.kind in "iu":
        return float(np.iinfo(stored.dtype).max), "integer type"
    top = 1.0 if stored.dtype.kind == "b" else _maximum(stored, axis, bands)
    return (top, "maximum") if top > 1 else (1.0, "file")


_CONVERTERS = (8, 10, 12, 14, 16)
"""Bits of counts that files of larger integers hold."""


def few_counts(dtype: np.dtype[Any], top: float) -> str:
    """What to say of integers that were divided by their type's maximum where the largest leaves two of its bits free,
    as counts of fewer bits do; empty where there is nothing to say, as of bytes, which are seldom counts of fewer."""
    white = np.iinfo(dtype).max if dtype.kind in "iu" else 0
    fits = [bits for bits in _CONVERTERS if 2**bits > top]
    if not fits or not 0 < top < (white + 1) / 4 or white < 2 ** _CONVERTERS[0]:
        return ""
    counts = f"counts of {fits[0]} bits take --scale {2 ** fits[0] - 1} (scale=), reflectance in ten-thousandths 10000"
    return f"its brightest value is {100 * top / white:.2g} % of white (scale {white}); {counts}"


def _maximum(stored: Stored, axis: int, bands: NDArray[Any] | None) -> float:
    """The largest finite value of the whole array, read band by band unless it is in memory."""
    planes = (stored.plane(axis, i) for i in range(stored.shape[axis])) if bands is None else (bands,)
    return max(map(_finite_maximum, planes))


def _finite_maximum(values: NDArray[Any]) -> float:
    values = values.astype(np.float32, copy=False)
    top = float(values.max())
    if np.isfinite(top):
        return top
    return float(np.max(values, initial=0.0, where=np.isfinite(values)))
