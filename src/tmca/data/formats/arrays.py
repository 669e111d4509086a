"""Array files: .npy, NetCDF and HDF5, Zarr, and MATLAB's, of version 5 (scipy) and 7.3 (HDF5).

MATLAB's axes are in its own order in both versions.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats import wavelengths
from tmca.data.formats.stored import Contents, Index, Stored, from_array, guarded, reads, whole_file
from tmca.data.formats.wavelengths import give_wavelengths
from tmca.errors import DataError

if TYPE_CHECKING:
    import h5py
    import xarray

NETCDF_SUFFIXES = (".nc", ".nc4", ".cdf")
QUANTITY = "relative irradiance"
"""The attribute ``quantity`` with this value marks data that are already scaled: our own files."""
IRRADIANCE = {"quantity": QUANTITY, "units": "1", "long_name": QUANTITY}
"""Attributes of scenes."""
LABELLED, MATLAB = "NetCDF/HDF5 file or Zarr store", "MATLAB file"
_CLASSES = {"double": "f8", "single": "f4", "logical": "?"}
_CLASSES |= {f"{sign}int{bits}": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


@reads(".npy", ".npz")
def open_numpy(path: Path) -> Contents:
    """A ``.npy`` array, memory-mapped, or the arrays of a ``.npz``; Python objects are refused."""
    with whole_file(path, f"{path.suffix} file of numbers"):
        loaded = np.load(path, mmap_mode="r", allow_pickle=False)
        arrays = {path.stem: loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
    return Contents(path, "NumPy", {name: from_array(name, array, usual_axis=0) for name, array in arrays.items()})


@reads(*NETCDF_SUFFIXES, ".h5", ".hdf5", ".hdf", ".he5")
@contextmanager
def open_hdf5(path: Path) -> Iterator[Contents]:
    """A NetCDF file (through xarray) or any other HDF5 file (every dataset in it)."""
    netcdf = _is_classic(path)
    if not netcdf:
        with _open_h5(path) as file:
            netcdf = path.suffix.lower() in NETCDF_SUFFIXES or "_NCProperties" in file.attrs
    if netcdf:
        with open_labelled(path) as dataset:
            yield from_dataset(path, "NetCDF", dataset)
    else:
        with _open_h5(path) as file:
            arrays = {name: _plain(path, name, item) for name, item in _datasets(file).items()}
            yield Contents(path, "HDF5", give_wavelengths(arrays), attrs=dict(file.attrs))


def _is_classic(path: Path) -> bool:
    """Whether it is a NetCDF file from before version 4."""
    with whole_file(path, LABELLED), path.open("rb") as head:
        return head.read(3) == b"CDF"


@contextmanager
def _open_h5(path: Path, kind: str = LABELLED) -> Iterator[h5py.File]:
    import h5py

    with whole_file(path, kind):
        file = h5py.File(path, "r")
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
    with whole_file(path, LABELLED):
        dataset = xarray.open_dataset(path, **options)
    with dataset:
        yield dataset


def from_dataset(path: Path, kind: str, dataset: xarray.Dataset) -> Contents:
    """The variables of an xarray dataset with their dims, coordinates and wavelengths."""
    arrays = {str(name): _labelled(path, str(name), array) for name, array in dataset.data_vars.items()}
    return Contents(path, kind, arrays, attrs=dict(dataset.attrs), labelled=True)


def _labelled(path: Path, name: str, array: xarray.DataArray) -> Stored:
    load = guarded(path, LABELLED, lambda index: array[index].values)
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
            metres = wavelengths.from_file(coordinate.values, unit)
            if metres is not None:
                return metres
    return None


def _datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Every dataset of an HDF5 file by its path."""
    import h5py

    datasets: dict[str, h5py.Dataset] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            datasets[name] = item

    file.visititems(visit)
    return datasets


def _plain(path: Path, name: str, item: Any) -> Stored:
    load = guarded(path, LABELLED, lambda index: item[index])
    return Stored(name, tuple(item.shape), np.dtype(item.dtype), load, attrs=dict(item.attrs), usual_axis=0)


@contextmanager
def open_zarr(path: Path) -> Iterator[Contents]:
    """A Zarr store: xarray's (named axes) or a plain array or group."""
    import zarr

    with whole_file(path, LABELLED):
        node: Any = zarr.open(path, mode="r")
        group = isinstance(node, zarr.Group)
        members = dict(node.arrays()) if group else {path.stem: node}
    if group and members and all(_has_dims(array) for array in members.values()):
        with open_labelled(path) as dataset:
            yield from_dataset(path, "Zarr", dataset)
    else:
        arrays = {name: _plain(path, name, array) for name, array in members.items()}
        yield Contents(path, "Zarr", give_wavelengths(arrays), attrs=dict(node.attrs))


def _has_dims(array: Any) -> bool:
    """Whether a Zarr array names its axes, in the way of version 3 or of xarray on version 2."""
    named = getattr(array.metadata, "dimension_names", None)
    return not array.shape or bool(named) or "_ARRAY_DIMENSIONS" in array.attrs


@reads(".mat")
@contextmanager
def open_matlab(path: Path) -> Iterator[Contents]:
    """The variables of a ``.mat`` file of version 5 or 7.3, and the fields of its structs in the latter."""
    import h5py
    from scipy.io import whosmat

    with whole_file(path, MATLAB), path.open("rb") as file:
        newer = file.read(10) == b"MATLAB 7.3" or bool(h5py.is_hdf5(path))
    if newer:
        with _open_h5(path, MATLAB) as file:
            items = {name: item for name, item in _datasets(file).items() if not name.startswith("#")}  # its own
            yield _matlab(path, "MATLAB 7.3", {name: _variable_73(path, name, item) for name, item in items.items()})
    else:
        with whole_file(path, MATLAB):
            listing = whosmat(path)
        yield _matlab(path, "MATLAB 5", {name: _variable_5(path, name, shape, kind) for name, shape, kind in listing})


def _matlab(path: Path, version: str, arrays: dict[str, Stored]) -> Contents:
    if not arrays:
        raise DataError(path, "no variables", "a .mat file with a cube", "it may be cut short")
    return Contents(path, version, give_wavelengths(arrays))


def _variable_5(path: Path, name: str, shape: tuple[int, ...], kind: str) -> Stored:
    """The variable in its MATLAB class: a double that MATLAB packed as bytes on disk is still a double."""
    from scipy.io import loadmat

    @cache
    def values() -> NDArray[Any]:
        try:
            with whole_file(path, MATLAB), warnings.catch_warnings():
                warnings.simplefilter("error", np.exceptions.ComplexWarning)
                return np.asarray(loadmat(path, variable_names=[name], mat_dtype=True)[name])
        except DataError as error:
            if isinstance(error.__cause__, np.exceptions.ComplexWarning):  # the reader leaves out the imaginary part
                found, remedy = f"complex values in {name}", "save its real part or its magnitude"
                raise DataError(path, found, "real numbers", remedy) from None
            raise

    def load(index: Index) -> NDArray[Any]:
        return values()[index]

    return Stored(name, tuple(shape), np.dtype(_CLASSES.get(kind, "O")), load, attrs={"matlab_class": kind})


def _variable_73(path: Path, name: str, item: h5py.Dataset) -> Stored:
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    dtype = np.dtype({"logical": "?", "char": "O"}.get(kind, item.dtype))
    if item.attrs.get("MATLAB_empty", 0):
        dtype = np.dtype("O")

    def read(index: Index) -> NDArray[Any]:
        values = np.asarray(item[index[::-1]]).T
        return values.astype(bool) if kind == "logical" else values

    load = guarded(path, MATLAB, read)
    return Stored(name, item.shape[::-1], dtype, load, attrs={"matlab_class": kind} if kind else {})
