"""Which reader a file or folder goes to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tmca.data.formats import arrays, envi, images, lenslet, matlab, views
from tmca.data.formats.stored import Contents
from tmca.errors import DataError

_HDF5 = (*arrays.NETCDF_SUFFIXES, ".h5", ".hdf5", ".hdf", ".he5")
_TIFF = (".tif", ".tiff")
_PICTURE = (".png", ".jpg", ".jpeg", ".bmp")
_ENVI = (".hdr", *envi.DATA_SUFFIXES[1:])
SUFFIXES = (".mat", ".npy", ".zarr", *_HDF5, *_TIFF, ".hdr", *_PICTURE)
"""What `read` and `read_array` know by suffix, besides folders of bands or views and ENVI data with their header."""


def is_picture(path: Path) -> bool:
    """Whether the suffix is that of a single picture."""
    return path.suffix.lower() in _PICTURE


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
        raise DataError(path, "no such file or folder", "an existing one", "check the path")
    with ExitStack() as stack:
        try:
            opened = _opener(path)
            contents = opened if isinstance(opened, Contents) else stack.enter_context(opened)
        except PermissionError as error:
            raise DataError(path, "no permission to read it", "a readable file") from error
        yield contents


def _opener(path: Path) -> Any:
    """The contents, or a context manager that gives them, by folder, suffix or neighbouring header."""
    suffix = path.suffix.lower()
    if path.is_dir():
        return arrays.open_zarr(path) if is_zarr(path) else _folder_of_pictures(path)
    if path.stat().st_size == 0:
        raise DataError(path, "an empty file (0 bytes)", "a file with data", "fetch or write it again")
    if suffix == ".mat":
        return matlab.open_matlab(path)
    if suffix == ".npy":
        return arrays.open_npy(path)
    if suffix in _HDF5:
        return arrays.open_hdf5(path)
    if suffix in _TIFF:
        return images.open_tiff(path)
    if suffix in _PICTURE:
        return lenslet.open_lenslet(path) if lenslet.is_lenslet(path) else images.open_picture(path)
    if suffix in _ENVI or envi.header_of(path) is not None:
        return envi.open_envi(path)
    raise DataError(path, f"the unknown suffix {suffix!r}", f"one of {' '.join(SUFFIXES)}, or a CAVE folder")


def _folder_of_pictures(path: Path) -> Contents:
    """The bands of a CAVE scene, or the views of a light field."""
    opened = None if images.band_files(path) else views.open_views(path)
    return images.open_cave(path) if opened is None else opened
