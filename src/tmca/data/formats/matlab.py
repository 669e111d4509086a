"""MATLAB's files, of version 5 and before (scipy) and 7.3 (HDF5), with axes in MATLAB's own order."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.arrays import datasets_of, open_h5, plain
from tmca.data.formats.limits import check_array, check_bytes
from tmca.data.formats.stored import Contents, Index, Stored, lazy, reads, whole_file
from tmca.data.formats.wavelengths import give_wavelengths
from tmca.errors import DataError

if TYPE_CHECKING:
    import h5py

MATLAB = "MATLAB file"
_CLASSES = {"double": "f8", "single": "f4", "logical": "?"}
_CLASSES |= {f"{sign}int{bits}": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_COMPRESSED, _HEADER, _HEAD = 15, 128, 4096
"""Type of a compressed element of version 5, bytes before the first element, and of an element that hold its header."""


@reads(".mat")
@contextmanager
def open_matlab(path: Path) -> Iterator[Contents]:
    """The variables of a ``.mat`` file of version 5 or 7.3, and the fields of its structs in the latter."""
    import h5py
    from scipy.io import whosmat

    with whole_file(path, MATLAB), path.open("rb") as file:
        newer = file.read(10) == b"MATLAB 7.3" or bool(h5py.is_hdf5(path))
    if newer:
        with open_h5(path, MATLAB) as file:
            items = {
                name: item for name, item in datasets_of(path, file, MATLAB).items() if not name.startswith("#")
            }  # its own
            yield _matlab(path, "MATLAB 7.3", {name: _variable_73(path, name, item) for name, item in items.items()})
    else:
        with whole_file(path, MATLAB):
            listing = whosmat(path)
        check_elements(path)
        yield _matlab(path, "MATLAB 5", {name: _variable_5(path, name, shape, kind) for name, shape, kind in listing})


def _matlab(path: Path, version: str, arrays: dict[str, Stored]) -> Contents:
    if not arrays:
        raise DataError(path, "no variables", "a .mat file with a cube", "it may be cut short")
    return Contents(path, version, give_wavelengths(arrays))


def _variable_5(path: Path, name: str, shape: tuple[int, ...], kind: str) -> Stored:
    """The variable in its MATLAB class: a double that MATLAB packed as bytes on disk is still a double."""
    from scipy.io import loadmat

    dtype = np.dtype(_CLASSES.get(kind, "O"))

    @cache
    def values() -> NDArray[Any]:
        check_array(path, name, shape, dtype.itemsize)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", np.exceptions.ComplexWarning)
                return np.asarray(loadmat(path, variable_names=[name], mat_dtype=True)[name])
        except np.exceptions.ComplexWarning:  # the reader leaves out the imaginary part
            found, remedy = f"complex values in {name}", "save its real part or its magnitude"
            raise DataError(path, found, "real numbers", remedy) from None

    return lazy(path, MATLAB, name, tuple(shape), dtype, lambda index: values()[index], attrs={"matlab_class": kind})


def _variable_73(path: Path, name: str, item: h5py.Dataset) -> Stored:
    stored = plain(path, name, item, MATLAB)
    kind = stored.attrs.get("MATLAB_class", b"")
    kind = kind.decode("utf-8", "replace") if isinstance(kind, bytes) else str(kind)
    dtype = np.dtype({"logical": "?", "char": "O"}.get(kind, stored.dtype))
    if np.any(stored.attrs.get("MATLAB_empty", 0)):
        dtype = np.dtype("O")

    def read(index: Index) -> NDArray[Any]:
        values = np.asarray(stored.load(index[::-1])).T
        return values.astype(bool) if kind == "logical" else values

    about = {"matlab_class": kind} if kind else {}
    return Stored(name, stored.shape[::-1], dtype, read, attrs=about)


def check_elements(path: Path) -> None:
    """Look at the beginning of every compressed variable of version 5: what it declares has to be what may be loaded.

    Raises:
        DataError: a part that is larger.
    """
    with whole_file(path, MATLAB), path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(_HEADER)[126:])
        while order and len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            after = file.tell() + size
            if kind == _COMPRESSED:
                inside = zlib.decompressobj().decompress(file.read(min(size, _HEAD)), _HEAD)
                check_bytes(path, "a compressed variable", _largest(inside, order))
            file.seek(after)


def _largest(inside: bytes, order: str) -> int:
    """Bytes that the largest part declares which begins in the first bytes of a variable."""
    largest, place = 0, 0
    while place + 8 <= len(inside):
        kind, size = struct.unpack_from(f"{order}II", inside, place)
        if kind >> 16:  # a small element: its size is in the upper half, its data in the tag
            place += 8
            continue
        largest = max(largest, size)
        place += 8 if place == 0 else 8 + size + -size % 8
    return largest
