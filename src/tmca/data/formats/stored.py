"""What a file holds before it is loaded: its arrays, their axes, and the wavelengths written in it; who opens it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import cache
from math import prod
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.limits import VARIABLE, check_array, check_declared
from tmca.errors import DataError, SettingError, TmcaError, did_you_mean

_PACKAGE = Path(__file__).parents[2]
Index = tuple[int | slice, ...]


@dataclass(frozen=True)
class Stored:
    """One array of a file, loaded only where it is indexed.

    Attributes:
        name: the array's name in the file.
        shape: its axes in the order a reader expects (MATLAB's own order for a MATLAB file of any version).
        dtype: element type.
        load: takes one integer or slice per axis and gives the numpy array.
        dims: names of the axes where the file has them, else empty.
        coords: one-dimensional coordinates of the labelled axes.
        attrs: what the file says about the array.
        wavelengths: metres, where the file states them for this array.
        usual_axis: where this format usually keeps the bands (0 or -1); decides only between equal lengths.
        pages: the first axis runs over pages, which are bands where nothing tells otherwise.
        full_scale: the divisor to relative irradiance where the file states it, else None.
        misfit: wavelengths of the file that are as many as no axis is long, in words; else empty.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    load: Callable[[Index], NDArray[Any]]
    dims: tuple[str, ...] = ()
    coords: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    attrs: Mapping[str, Any] = field(default_factory=dict)
    wavelengths: NDArray[np.float64] | None = None
    usual_axis: int = -1
    pages: bool = False
    full_scale: float | None = None
    misfit: str = ""

    @property
    def numeric(self) -> bool:
        """Whether the elements are real numbers or logicals."""
        return self.dtype.kind in "buif"

    @property
    def size(self) -> int:
        """How many elements the array has."""
        return prod(self.shape)

    def whole(self) -> NDArray[Any]:
        """The whole array, in its own dtype."""
        return np.asarray(self.load(tuple(slice(None) for _ in self.shape)))

    def plane(self, axis: int, index: int) -> NDArray[Any]:
        """The slice at ``index`` along ``axis``; the other axes keep their order."""
        where: list[int | slice] = [slice(None)] * len(self.shape)
        where[axis] = index
        return np.asarray(self.load(tuple(where)))


@dataclass(frozen=True)
class Contents:
    """The numeric and other arrays of one file or folder.

    Attributes:
        path: the file or folder.
        format: its format in words.
        arrays: by name, in the file's order.
        attrs: what the file says about itself.
        labelled: whether the file names its axes (NetCDF, Zarr from xarray).
    """

    path: Path
    format: str
    arrays: Mapping[str, Stored]
    attrs: Mapping[str, Any] = field(default_factory=dict)
    labelled: bool = False

    def get(self, variable: str) -> Stored:
        """The array called ``variable``.

        Raises:
            DataError: the file has no such array, or it is not numeric.
        """
        if variable not in self.arrays:
            there = ", ".join(self.arrays) or "none: it is empty"
            raise DataError(self.path, f"no variable {variable!r}", f"one of {there}")
        stored = self.arrays[variable]
        if not stored.numeric:
            raise DataError(self.path, f"variable {variable!r} of type {stored.dtype}", "real numbers")
        return stored

    def only(self, candidates: Sequence[Stored], name: str, remedy: str = "") -> Stored:
        """The one candidate.

        Args:
            candidates: what could be meant.
            name: what is looked for, for the message.
            remedy: where there is none.

        Raises:
            DataError: there is none, or there are several.
        """
        if len(candidates) == 1:
            return candidates[0]
        if not candidates:
            raise DataError(self.path, f"no {name} ({self.listing()})", f"a {name}", remedy)
        names = ", ".join(stored.name for stored in candidates)
        remedy = "choose it with variable= (--variable)"
        raise DataError(self.path, f"{len(candidates)} arrays that could be the {name} ({names})", "one", remedy)

    def refuse_snapshot(self) -> None:
        """Raises DataError for a file of a snapshot, whose codes could be taken for a scene."""
        if self.labelled and {"snapshot", "shutter"} <= {*self.arrays}:
            raise DataError(self.path, "a snapshot", "a scene", "name one, such as the scene that it is of")

    def listing(self) -> str:
        """The first arrays with their shapes, for messages."""
        named = [f"{s.name} {s.shape}" if s.numeric else f"{s.name} of type {s.dtype}" for s in self.arrays.values()]
        return ", ".join(named[:6]) or "nothing"


def from_array(name: str, array: NDArray[Any], **about: Any) -> Stored:
    """A `Stored` over an array in memory or memory-mapped."""
    return Stored(name, array.shape, array.dtype, array.__getitem__, **about)


Opener = Callable[[Path], Contents | AbstractContextManager[Contents]]
_Opener = TypeVar("_Opener", bound=Opener)
OPENERS: dict[str, Opener] = {}
"""What opens a file, by suffix in lower case."""


def reads(*suffixes: str) -> Callable[[_Opener], _Opener]:
    """Register the function that opens files of these suffixes.

    It takes the path and gives `Contents`, or is a context manager that does. What it raises becomes a `DataError`
    that names the file, the reader and its line.

    Raises:
        SettingError: a suffix without its dot, in capitals, or of another module's reader.
    """
    for suffix in suffixes:
        if not suffix.startswith(".") or suffix != suffix.lower():
            raise SettingError("reads", repr(suffix), "a suffix in small letters, with its dot")

    def register(opener: _Opener) -> _Opener:
        for suffix in suffixes:
            before = OPENERS.get(suffix, opener)
            if before.__module__ != opener.__module__:
                raise SettingError("reads", f"{suffix}, which {before.__module__} reads", "a suffix of its own")
        OPENERS.update(dict.fromkeys(suffixes, opener))
        return opener

    return register


@contextmanager
def whole_file(path: Path, kind: str = "file", remedy: str = "fetch or write it again") -> Iterator[None]:
    """Within it, whatever a library raises on a file that is missing, empty, cut or damaged is a DataError.

    It is put around calls of the library alone. Names and attributes that our own lines miss are mistakes of ours and
    stay what they are.
    """
    try:
        yield
    except TmcaError:
        raise
    except FileNotFoundError as error:
        raise DataError(path, "no such file", f"a {kind}", nearest_name(path)) from error
    except PermissionError as error:
        raise DataError(path, "no permission to read it", "a readable file", "change its permissions") from error
    except MemoryError as error:
        found, remedy = "more than fits into the memory that is free", f"read less of it, or fetch it again; {VARIABLE}"
        raise DataError(path, found, "", f"{remedy} sets how much may be loaded") from error
    except Exception as error:
        if isinstance(error, NameError | AttributeError) and _raised_here(error):
            raise
        reason = str(error).replace(repr(path), path.name).partition("\n")[0][:200] or type(error).__name__
        empty = path.is_file() and path.stat().st_size == 0
        found = "an empty file (0 bytes)" if empty else f"an unreadable or truncated {kind} ({reason})"
        raise DataError(path, found, f"a whole {kind}", remedy) from error


def nearest_name(path: Path) -> str:
    """The remedy for a file that is not there: the one beside it whose name is nearest, if any is near; no source code
    for data."""
    try:
        beside = [one.name for one in path.parent.iterdir() if one.suffix != ".py" or path.suffix == ".py"]
    except OSError:
        beside = []
    return did_you_mean(path.name, beside, "check the path")


def _raised_here(error: Exception) -> bool:
    """Whether a line of this package raised it, and no library's."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and Path(trace.tb_frame.f_code.co_filename).is_relative_to(_PACKAGE)


def lazy(
    path: Path,
    kind: str,
    name: str,
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    read: Callable[[Index], Any],
    **about: Any,
) -> Stored:
    """A `Stored` of which a library reads what is asked: sizes are checked before, and damage is a DataError.

    Args:
        path: the file.
        kind: its kind, for messages.
        name, shape, dtype, about: of the `Stored`.
        read: gives the values at an index.
    """
    declared = cache(lambda: check_declared(path, name, shape, dtype.itemsize))

    def load(index: Index) -> NDArray[Any]:
        declared()
        check_array(path, name, _selected(shape, index), dtype.itemsize)
        with whole_file(path, kind):
            return np.asarray(read(index))

    return Stored(name, shape, dtype, load, **about)


def _selected(shape: tuple[int, ...], index: Index) -> tuple[int, ...]:
    """The shape that an index picks."""
    chosen = zip(shape, index, strict=False)
    picked = tuple(len(range(*part.indices(size))) for size, part in chosen if isinstance(part, slice))
    return (*picked, *shape[len(index) :])
