"""MATLAB files, version 5 (scipy) and 7.3 (HDF5), with the axes in MATLAB's own order in both."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.axes import give_wavelengths
from tmca.data.formats.stored import Contents, Index, Stored
from tmca.errors import DataError

if TYPE_CHECKING:
    import h5py

_CLASSES = {"double": "f8", "single": "f4", "logical": "?"}
_CLASSES |= {f"{sign}int{bits}": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_BROKEN = (OSError, ValueError, TypeError, IndexError, KeyError, OverflowError, MemoryError, zlib.error)
"""What scipy's reader raises on a cut or damaged file, besides its own error."""


@contextmanager
def open_matlab(path: Path) -> Iterator[Contents]:
    """The variables of a ``.mat`` file of version 5 or 7.3.

    Raises:
        DataError: neither, or cut short.
    """
    if _is_73(path):
        with _open_73(path) as contents:
            yield contents
    else:
        yield _open_5(path)


def _is_73(path: Path) -> bool:
    import h5py

    with path.open("rb") as file:
        header = file.read(128)
    return header.startswith(b"MATLAB 7.3") or bool(h5py.is_hdf5(path))


def _damaged(path: Path, error: BaseException) -> DataError:
    return DataError(
        path,
        f"an unreadable or truncated MATLAB file ({type(error).__name__}: {error})",
        "a whole .mat file",
        "fetch or save it again",
    )


def _open_5(path: Path) -> Contents:
    from scipy.io import whosmat
    from scipy.io.matlab import MatReadError

    try:
        listing = whosmat(path)
    except (*_BROKEN, MatReadError) as error:
        raise _damaged(path, error) from error
    if not listing:
        raise DataError(path, "no variables", "a .mat file with a cube", "it may be cut short")
    arrays = {name: _variable_5(path, name, shape, kind) for name, shape, kind in listing}
    return Contents(path, "MATLAB 5", give_wavelengths(arrays))


def _variable_5(path: Path, name: str, shape: tuple[int, ...], kind: str) -> Stored:
    @cache
    def values() -> NDArray[Any]:
        return _load_5(path, name)

    def load(index: Index) -> NDArray[Any]:
        return values()[index]

    return Stored(name, tuple(shape), np.dtype(_CLASSES.get(kind, "O")), load, attrs={"matlab_class": kind})


def _load_5(path: Path, name: str) -> NDArray[Any]:
    """The variable in its MATLAB class: a double that MATLAB packed as bytes on disk is still a double.

    Raises:
        DataError: cut short, or complex: the reader would leave out the imaginary part.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            return np.asarray(loadmat(path, variable_names=[name], mat_dtype=True)[name])
    except np.exceptions.ComplexWarning:
        found, remedy = f"complex values in {name}", "save its real part or its magnitude"
        raise DataError(path, found, "real numbers", remedy) from None
    except (*_BROKEN, MatReadError) as error:
        raise _damaged(path, error) from error


@contextmanager
def _open_73(path: Path) -> Iterator[Contents]:
    import h5py

    try:
        file = h5py.File(path, "r")
    except (OSError, KeyError, RuntimeError) as error:
        raise _damaged(path, error) from error
    with file:
        arrays = {name: _variable_73(path, name, item) for name, item in _datasets_73(file)}
        if not arrays:
            raise DataError(path, "no variables", "a .mat file with a cube", "it may be cut short")
        yield Contents(path, "MATLAB 7.3", give_wavelengths(arrays))


def _datasets_73(file: h5py.File) -> Iterator[tuple[str, h5py.Dataset]]:
    """Variables of the file and the fields of its structs; MATLAB's hidden ``#refs#`` are left out."""
    import h5py

    found: list[tuple[str, h5py.Dataset]] = []

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            found.append((name, item))

    file.visititems(visit)
    yield from found


def _variable_73(path: Path, name: str, item: h5py.Dataset) -> Stored:
    def load(index: Index) -> NDArray[Any]:
        try:
            values = np.asarray(item[index[::-1]]).T
        except (OSError, RuntimeError) as error:
            raise _damaged(path, error) from error
        return values.astype(bool) if kind == "logical" else values

    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    dtype = np.dtype({"logical": "?", "char": "O"}.get(kind, item.dtype))
    if item.attrs.get("MATLAB_empty", 0):
        dtype = np.dtype("O")
    return Stored(name, item.shape[::-1], dtype, load, attrs={"matlab_class": kind} if kind else {})
