"""Arrays: .npy and .npz, NetCDF, HDF5 and Zarr."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats import wavelengths
from tmca.data.formats.hdf5_structure import damaged_scales, lies_elsewhere, misleading
from tmca.data.formats.limits import check_array
from tmca.data.formats.stored import Contents, Stored, from_array, lazy, reads, whole_file
from tmca.data.formats.wavelengths import give_wavelengths
from tmca.errors import DataError

if TYPE_CHECKING:
    import h5py
    import xarray
    import zarr

NETCDF_SUFFIXES = (".nc", ".nc4", ".cdf")
QUANTITY = "relative irradiance"
"""The attribute ``quantity`` with this value marks data that are already scaled: our own files."""
IRRADIANCE = {"quantity": QUANTITY, "units": "1", "long_name": QUANTITY}
"""Attributes of scenes."""
LABELLED = "NetCDF/HDF5 file or Zarr store"
NUMPY = "file of numbers by NumPy"
_HEADERS: dict[tuple[int, int], Callable[[Any], tuple[tuple[int, ...], bool, np.dtype[Any]]]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_HEAD = 4096
"""Bytes that may be asked for anywhere."""
_DEEPEST, _MOST_DATASETS = 64, 100_000
"""Groups within groups, and datasets, of an HDF5 file that is looked into."""


@reads(".npy")
def open_npy(path: Path) -> Contents:
    """A ``.npy`` array, memory-mapped; Python objects are refused."""
    with whole_file(path, NUMPY):
        with path.open("rb") as file:
            if file.read(len(np.lib.format.MAGIC_PREFIX)) != np.lib.format.MAGIC_PREFIX:
                raise ValueError("it does not begin as what numpy.save writes")
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    return Contents(path, "NumPy", {path.stem: from_array(path.stem, array, usual_axis=0)})


@reads(".npz")
def open_npz(path: Path) -> Contents:
    """The arrays of a ``.npz``, each loaded when it is asked for; Python objects are refused."""
    arrays = {name: _member(path, name, *head) for name, head in npz_heads(path).items()}
    return Contents(path, "NumPy", give_wavelengths(arrays))


def npz_heads(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Name → shape and type of the arrays of a ``.npz``, none of which is loaded.

    Raises:
        DataError: no such file, or a damaged one.
    """
    heads = {}
    with whole_file(path, NUMPY), zipfile.ZipFile(path) as packed:
        for entry in packed.namelist():
            if entry.endswith(".npy"):
                with packed.open(entry) as member:
                    read = _HEADERS[np.lib.format.read_magic(member)]
                    shape, _, dtype = read(member)
                heads[entry.removesuffix(".npy")] = shape, dtype
    return heads


def _member(path: Path, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Stored:
    @cache
    def values() -> NDArray[Any]:
        with np.load(path, allow_pickle=False) as arrays:
            return np.asarray(arrays[name])

    return lazy(path, NUMPY, name, shape, dtype, lambda index: values()[index], usual_axis=0)


@reads(*NETCDF_SUFFIXES, ".h5", ".hdf5", ".hdf", ".he5")
@contextmanager
def open_hdf5(path: Path) -> Iterator[Contents]:
    """A NetCDF file (through xarray) or any other HDF5 file (every dataset in it)."""
    netcdf = path.suffix.lower() in NETCDF_SUFFIXES or _is_classic(path)
    if not netcdf:
        with open_h5(path) as file:
            netcdf = "_NCProperties" in attrs_of(path, file)
    if netcdf:
        with open_labelled(path) as dataset:
            yield from_dataset(path, "NetCDF", dataset)
    else:
        with open_h5(path) as file:
            arrays = {name: plain(path, name, item) for name, item in datasets_of(path, file).items()}
            yield Contents(path, "HDF5", give_wavelengths(arrays), attrs=attrs_of(path, file))


def _is_classic(path: Path) -> bool:
    """Whether it is a NetCDF file from before version 4."""
    with whole_file(path, LABELLED), path.open("rb") as head:
        return head.read(3) == b"CDF"


@contextmanager
def open_h5(path: Path, kind: str = LABELLED) -> Iterator[h5py.File]:
    """An HDF5 file.

    Raises:
        DataError: not one, or damaged.
    """
    import h5py

    with whole_file(path, kind):
        if found := misleading(path):
            raise DataError(path, found, f"a whole {kind}", "fetch or write it again")
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
    with ExitStack() as opened:
        source: Any = path
        if path.is_dir():
            from tmca.data.formats.zarr_codecs import open_store

            with whole_file(path, LABELLED):
                source = open_store(path).store
            options |= {"engine": "zarr", "consolidated": False}
        elif _is_classic(path):
            _check_head(path)
            options |= {"engine": "scipy"}
        else:
            source = _store(path, opened.enter_context(open_h5(path)))
        with whole_file(path, LABELLED):
            dataset = xarray.open_dataset(source, **options)
        yield opened.enter_context(dataset)


def labelled_attributes(path: Path) -> dict[str, Any]:
    """Attributes of such a file, its variables not looked at where it is HDF5; errors as of `open_labelled`."""
    if path.is_dir() or _is_classic(path):
        with open_labelled(path) as dataset:
            return {str(name): value for name, value in dataset.attrs.items()}
    with open_h5(path) as file:
        stored = {name: value for name, value in attrs_of(path, file).items() if name not in _OF_NETCDF}
    with whole_file(path, LABELLED):
        return {name: _plain_attribute(value) for name, value in stored.items()}


def _plain_attribute(value: Any) -> Any:
    """Text as text, and one number as a number, as xarray has them."""
    if isinstance(value, bytes):
        return value.decode()
    return value[0] if isinstance(value, np.ndarray) and value.shape == (1,) else value


_OF_NETCDF = ("_NCProperties", "_nc3_strict")
"""Attributes of the library that wrote a file."""


def _store(path: Path, file: h5py.File) -> xarray.backends.H5NetCDFStore:
    """What xarray reads an HDF5 file through that was opened and looked at already."""
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    _check_labels(path, file)
    with whole_file(path, LABELLED):
        return H5NetCDFStore(h5netcdf.File(file, "r", phony_dims="sort", decode_vlen_strings=True))


def _check_head(path: Path) -> None:
    """Read the head of a classic NetCDF file once: it may ask for no more than the file holds."""
    from scipy.io import netcdf_file

    with whole_file(path, LABELLED), _Bounded(io.FileIO(path)) as file:
        netcdf_file(file, mmap=True).close()


class _Bounded(io.BufferedReader):
    """A file that refuses to be asked for more than it holds: room would be made for all of it at once."""

    def read(self, size: int | None = -1) -> bytes:
        """See `io.BufferedReader`."""
        left = os.fstat(self.fileno()).st_size - self.tell()
        if size is not None and size > max(left, _HEAD):
            raise EOFError(f"{size} bytes are asked for, and {left} are left")
        return super().read(size)


@contextmanager
def open_groups(path: Path, kind: str) -> Iterator[dict[str, xarray.Dataset]]:
    """The groups of the first level of a NetCDF file (HDF5), lazily.

    Raises:
        DataError: not one, or damaged.
    """
    import xarray

    with open_h5(path) as file:
        store = _store(path, file)
        with whole_file(path, kind):
            groups = {str(name): xarray.open_dataset(store.get_child_store(name)) for name in store.ds.groups}
        yield groups


def _check_labels(path: Path, file: h5py.File) -> None:
    """Coordinates are loaded when a file is opened: none may be larger than what may be loaded, and what ties them to
    the axes has to be whole."""
    with whole_file(path, LABELLED):
        for name, item in datasets_of(path, file).items():
            if attribute := damaged_scales(item):
                found = f"a damaged attribute {attribute} of {name}"
                raise DataError(path, found, f"a whole {LABELLED}", "fetch or write it again")
            if len(item.shape or ()) == 1:
                check_array(path, name, item.shape, item.dtype.itemsize)


def from_dataset(path: Path, kind: str, dataset: xarray.Dataset) -> Contents:
    """The variables of an xarray dataset with their dims, coordinates and wavelengths."""
    arrays = {str(name): _labelled(path, str(name), array) for name, array in dataset.data_vars.items()}
    return Contents(path, kind, arrays, attrs=dict(dataset.attrs), labelled=True)


def _labelled(path: Path, name: str, array: xarray.DataArray) -> Stored:
    dims = tuple(str(dim) for dim in array.dims)
    return lazy(
        path,
        LABELLED,
        name,
        array.shape,
        array.dtype,
        lambda index: array[index].values,
        dims=dims,
        coords={dim: array.indexes[dim].to_numpy() for dim in dims if dim in array.indexes},
        attrs=dict(array.attrs),
        wavelengths=_spectral_coordinate(path, array),
        usual_axis=0,
        full_scale=1.0 if str(array.attrs.get("quantity")) == QUANTITY else None,
    )


def _spectral_coordinate(path: Path, array: xarray.DataArray) -> NDArray[np.float64] | None:
    """Metres from the first one-dimensional coordinate with a spectral name."""
    for name, coordinate in array.coords.items():
        if str(name).lower() in wavelengths.NAMES and coordinate.ndim == 1:
            unit = coordinate.attrs.get("units", "nm" if str(name).endswith("_nm") else None)
            check_array(path, str(name), coordinate.shape, coordinate.dtype.itemsize)
            with whole_file(path, LABELLED):
                values = coordinate.values
            metres = wavelengths.from_file(values, unit)
            if metres is not None:
                return metres
    return None


def datasets_of(path: Path, file: h5py.File, kind: str = LABELLED) -> dict[str, h5py.Dataset]:
    """Every dataset of an HDF5 file by its path.

    Raises:
        DataError: damaged, groups without end, or numbers that lie in another file.
    """
    import h5py

    datasets: dict[str, h5py.Dataset] = {}

    def visit(name: str, item: object) -> str | None:
        if isinstance(item, h5py.Dataset):
            datasets[name] = item
        return name if name.count("/") > _DEEPEST or len(datasets) > _MOST_DATASETS else None

    with whole_file(path, kind):
        endless = file.visititems(visit)
    if endless is not None:
        found = f"groups more than {_DEEPEST} deep, or more than {_MOST_DATASETS} datasets"
        raise DataError(path, found, "a file of arrays", "fetch it again, or save its cube alone")
    with whole_file(path, kind):
        elsewhere = lies_elsewhere(file, datasets)
    if elsewhere:
        raise DataError(path, f"{elsewhere} in another file", "all of it in this one", "copy the numbers into it")
    return datasets


def attrs_of(path: Path, item: h5py.HLObject | zarr.Array[Any] | zarr.Group, kind: str = LABELLED) -> dict[str, Any]:
    """The attributes of an HDF5 file or dataset, or of a Zarr store."""
    with whole_file(path, kind):
        return dict(item.attrs)


def plain(path: Path, name: str, item: Any, kind: str = LABELLED, **about: Any) -> Stored:
    """A dataset of an HDF5 file, or an array of a Zarr store."""
    with whole_file(path, kind):
        shape, dtype, chunks = tuple(item.shape), np.dtype(item.dtype), item.chunks
    check_array(path, f"a chunk of {name}", chunks or (), dtype.itemsize)
    options = {"attrs": attrs_of(path, item, kind), "usual_axis": 0, **about}
    return lazy(path, kind, name, shape, dtype, lambda index: item[index], **options)


@contextmanager
def open_zarr(path: Path) -> Iterator[Contents]:
    """A Zarr store: xarray's (named axes) or a plain array or group; only codecs that run no code."""
    import zarr

    from tmca.data.formats.zarr_codecs import open_store

    with whole_file(path, LABELLED):
        node: Any = open_store(path)
        group = isinstance(node, zarr.Group)
        members = dict(node.arrays()) if group else {path.stem: node}
        labelled = group and bool(members) and all(_has_dims(array) for array in members.values())
    if labelled:
        with open_labelled(path) as dataset:
            yield from_dataset(path, "Zarr", dataset)
    else:
        arrays = {name: plain(path, name, array) for name, array in members.items()}
        yield Contents(path, "Zarr", give_wavelengths(arrays), attrs=attrs_of(path, node))


def _has_dims(array: Any) -> bool:
    """Whether a Zarr array names its axes, in the way of version 3 or of xarray on version 2."""
    named = getattr(array.metadata, "dimension_names", None)
    return not array.shape or bool(named) or "_ARRAY_DIMENSIONS" in array.attrs
