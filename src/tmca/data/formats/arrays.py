"""Array files: .npy, NetCDF and HDF5, Zarr."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats import wavelengths
from tmca.data.formats.axes import give_wavelengths
from tmca.data.formats.stored import Contents, Index, Stored, from_array
from tmca.errors import DataError

if TYPE_CHECKING:
    import h5py
    import xarray

NETCDF_SUFFIXES = (".nc", ".nc4", ".cdf")
QUANTITY = "relative irradiance"
"""The attribute ``quantity`` with this value marks data that are already scaled: our own files."""


def open_npy(path: Path) -> Contents:
    """A ``.npy`` array, memory-mapped; arrays of Python objects are refused.

    Raises:
        DataError: not a ``.npy`` file, cut short, or of objects.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise DataError(path, f"an unreadable or truncated .npy file ({error})", "a whole array of numbers") from error
    return Contents(path, "NumPy", {path.stem: from_array(path.stem, array, usual_axis=0)})


@contextmanager
def open_hdf5(path: Path) -> Iterator[Contents]:
    """A NetCDF file (through xarray) or any other HDF5 file (every dataset in it).

    Raises:
        DataError: neither, or cut short.
    """
    if _is_netcdf(path):
        with open_labelled(path) as dataset:
            yield from_dataset(path, "NetCDF", dataset)
    else:
        with _open_h5(path) as file:
            yield Contents(path, "HDF5", _datasets(path, file), attrs=dict(file.attrs))


def _is_netcdf(path: Path) -> bool:
    if _is_classic(path):
        return True
    with _open_h5(path) as file:
        return path.suffix.lower() in NETCDF_SUFFIXES or "_NCProperties" in file.attrs


def _is_classic(path: Path) -> bool:
    """Whether it is a NetCDF file from before version 4."""
    try:
        with path.open("rb") as head:
            return head.read(3) == b"CDF"
    except OSError as error:
        raise damaged(path, error) from error


def damaged(path: Path, error: BaseException) -> DataError:
    """The error for a file that its library cannot open or read."""
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return DataError(
        path,
        f"an unreadable or truncated file ({reason})",
        "a whole NetCDF/HDF5 file or Zarr store",
        "write it again",
    )


@contextmanager
def _open_h5(path: Path) -> Iterator[h5py.File]:
    import h5py

    try:
        file = h5py.File(path, "r")
    except (OSError, KeyError, RuntimeError) as error:
        raise damaged(path, error) from error
    with file:
        yield file


@contextmanager
def open_labelled(path: Path) -> Iterator[xarray.Dataset]:
    """A NetCDF file or an xarray Zarr store, lazily.

    Raises:
        DataError: not one, or cut short.
    """
    import xarray

    options: dict[str, Any] = {"decode_times": False, "chunks": None}
    if path.is_dir():
        options |= {"engine": "zarr", "consolidated": False}
    elif _is_classic(path):
        options |= {"engine": "scipy"}
    else:
        options |= {"engine": "h5netcdf", "phony_dims": "sort"}
    try:
        dataset = xarray.open_dataset(path, **options)
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, RuntimeError) as error:
        raise damaged(path, error) from error
    with dataset:
        yield dataset


def from_dataset(path: Path, kind: str, dataset: xarray.Dataset) -> Contents:
    """The variables of an xarray dataset with their dims, coordinates and wavelengths."""
    arrays = {str(name): _labelled(path, str(name), dataset) for name in dataset.data_vars}
    return Contents(path, kind, arrays, attrs=dict(dataset.attrs), labelled=True)


def _labelled(path: Path, name: str, dataset: xarray.Dataset) -> Stored:
    array = dataset[name]

    def load(index: Index) -> NDArray[Any]:
        try:
            return array[index].values
        except (OSError, RuntimeError, ValueError) as error:
            raise damaged(path, error) from error

    dims = tuple(str(dim) for dim in array.dims)
    coords = {dim: array.indexes[dim].to_numpy() for dim in dims if dim in array.indexes}
    stored = Stored(name, array.shape, array.dtype, load, dims, coords, dict(array.attrs), usual_axis=0)
    scale = 1.0 if array.attrs.get("quantity") == QUANTITY else None
    return replace(stored, full_scale=scale, wavelengths=_spectral_coordinate(array))


def _spectral_coordinate(array: xarray.DataArray) -> NDArray[np.float64] | None:
    """Metres from the first one-dimensional coordinate with a spectral name."""
    for name, coordinate in array.coords.items():
        if str(name).lower() in wavelengths.NAMES and coordinate.ndim == 1:
            unit = coordinate.attrs.get("units", "nm" if str(name).endswith("_nm") else None)
            found = wavelengths.from_file(coordinate.values, unit)
            if found is not None:
                return found
    return None


def _datasets(path: Path, file: h5py.File) -> dict[str, Stored]:
    """Every dataset of a plain HDF5 file by its path, with the wavelengths kept beside it."""
    import h5py

    found: dict[str, Stored] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = _plain(path, name, item, item.dtype, item.shape)

    file.visititems(visit)
    return give_wavelengths(found)


def _plain(path: Path, name: str, item: Any, dtype: Any, shape: tuple[int, ...]) -> Stored:
    def load(index: Index) -> NDArray[Any]:
        try:
            return np.asarray(item[index])
        except (OSError, RuntimeError, ValueError) as error:
            raise damaged(path, error) from error

    return Stored(name, tuple(shape), np.dtype(dtype), load, attrs=dict(item.attrs), usual_axis=0)


@contextmanager
def open_zarr(path: Path) -> Iterator[Contents]:
    """A Zarr store: xarray's (named axes) or a plain array or group.

    Raises:
        DataError: not a Zarr store, or damaged.
    """
    import zarr

    try:
        node: Any = zarr.open(path, mode="r")
        group = isinstance(node, zarr.Group)
        members = {path.stem: node} if not group else dict(node.arrays())
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise damaged(path, error) from error
    if group and members and all(_has_dims(array) for array in members.values()):
        with open_labelled(path) as dataset:
            yield from_dataset(path, "Zarr", dataset)
    else:
        arrays = {name: _plain(path, name, array, array.dtype, array.shape) for name, array in members.items()}
        yield Contents(path, "Zarr", give_wavelengths(arrays), attrs=dict(node.attrs))


def _has_dims(array: Any) -> bool:
    """Whether a Zarr array names its axes, in the way of version 3 or of xarray on version 2."""
    named = getattr(array.metadata, "dimension_names", None)
    return not array.shape or bool(named) or "_ARRAY_DIMENSIONS" in array.attrs
