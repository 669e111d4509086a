"""Which reader a file or folder goes to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from importlib.metadata import entry_points
from inspect import getsourcefile, isfunction, unwrap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats import envi, images, matlab, views  # noqa: F401 (each registers its suffixes)
from tmca.data.formats.arrays import open_zarr
from tmca.data.formats.stored import OPENERS, Contents, Opener, Stored, nearest_name, whole_file
from tmca.errors import DataError, TmcaError, one_line
from tmca.plugins import line_in

GROUP = "tmca.formats"
"""Entry points that name modules with readers of other packages."""
_LONGEST = 1.0
"""Metres: no wavelength of light is longer, and those of one that are given in nanometres are."""


def is_picture(path: Path) -> bool:
    """Whether the suffix is that of a single picture."""
    return path.suffix.lower() in images.PICTURES


def read_array(path: str | Path, variable: str | None = None) -> NDArray[Any]:
    """Read one array as it is: masks, captures, codes. Axes as in `tmca.data.read`, values and dtype untouched:
    what is not finite stays so.

    Args:
        path: any file that `tmca.data.read` opens, or a picture.
        variable: its name, where the file has several.

    Raises:
        DataError: missing or damaged file, no such variable, or several to choose from.
    """
    with open_contents(path) as contents:
        if variable is not None:
            return contents.get(variable).whole()
        numeric = [stored for stored in contents.arrays.values() if stored.numeric and stored.size]
        return contents.only(numeric, "array of numbers").whole()


def is_zarr(folder: Path) -> bool:
    """Whether a folder is a Zarr store."""
    marks = ("zarr.json", ".zgroup", ".zarray")
    return folder.suffix.lower() == ".zarr" or any((folder / mark).exists() for mark in marks)


@contextmanager
def open_contents(path: str | Path) -> Iterator[Contents]:
    """Look into a file or folder without loading its arrays.

    Raises:
        DataError: it does not exist, is of an unknown kind, or cannot be read.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(path, "no such file or folder", "an existing one", nearest_name(path))
    opener = _opener(path)
    with ExitStack() as stack:
        ours = opener.__module__.partition(".")[0] == "tmca"
        with nullcontext() if ours else _foreign(opener, path):
            opened = opener(path)
            contents = opened if isinstance(opened, Contents) else stack.enter_context(_entered(opened, opener, path))
            if not ours:
                _check_arrays(contents, opener, path)
        yield contents


@contextmanager
def _foreign(opener: Opener, path: Path) -> Iterator[None]:
    """Within it, what a reader of another package raises is a DataError that names the reader and its line."""
    try:
        yield
    except (TmcaError, MemoryError):
        raise
    except Exception as error:
        missing = getattr(error, "filename", None)
        if isinstance(error, FileNotFoundError) and missing:
            raise DataError(
                path, f"no {missing} that belongs to it", "both files", nearest_name(Path(missing))
            ) from error
        function = unwrap(opener)
        source = getsourcefile(function) if isfunction(function) else None
        found = f"{one_line(error)}{line_in(Path(source), error) if source else ''} in {_called(opener)}"
        raise DataError(path, found, "a whole file that its reader can read", "mend one of the two") from error


def _entered(opened: Any, opener: Opener, path: Path) -> AbstractContextManager[Contents]:
    """What a reader gave that is no Contents: a context manager, else a DataError."""
    if not isinstance(opened, AbstractContextManager):
        raise DataError(path, f"a {type(opened).__name__} from {_called(opener)}", "Contents")
    return opened


def _check_arrays(contents: Contents, opener: Opener, path: Path) -> None:
    """Raises DataError unless a reader of another package gives arrays as they have to be."""
    for name, stored in contents.arrays.items():
        if not isinstance(stored, Stored):
            raise DataError(path, f"{name} as a {type(stored).__name__} from {_called(opener)}", "from_array(…)")
        longest = 0.0 if stored.wavelengths is None else np.max(stored.wavelengths, initial=0)
        if longest > _LONGEST:
            found = f"wavelengths up to {longest:g} m from {_called(opener)}"
            raise DataError(path, found, "metres", "multiply nanometres by 1e-9")


def _called(opener: Opener) -> str:
    return f"{opener.__module__}.{getattr(opener, '__name__', opener)}"


def _opener(path: Path) -> Opener:
    """What opens it, by folder, suffix or neighbouring header."""
    if path.is_dir():
        return open_zarr if is_zarr(path) else _folder_of_pictures
    suffix = path.suffix.lower()
    if suffix not in OPENERS:
        _load_plugins()
    if suffix in OPENERS:
        return OPENERS[suffix]
    if envi.header_of(path) is not None:
        return envi.open_envi
    known = " ".join([*(suffix for suffix in OPENERS if suffix not in envi.DATA_SUFFIXES), ".zarr"])
    raise DataError(path, f"the unknown suffix {suffix!r}", f"one of {known}, or a CAVE folder")


def _load_plugins() -> None:
    for point in entry_points(group=GROUP):
        try:
            point.load()
        except Exception as error:
            found = f"a format that cannot be loaded ({error})"
            raise DataError(f"{GROUP} {point.name}", found, "a module of readers", "mend or uninstall it") from error


def _folder_of_pictures(path: Path) -> Contents:
    """The bands of a CAVE scene, or the views of a light field."""
    with whole_file(path, "folder"):
        next(path.iterdir(), None)
    opened = None if images.band_files(path) else views.open_views(path)
    return images.open_cave(path) if opened is None else opened
