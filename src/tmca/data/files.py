"""Files of our own: text, JSON, labelled arrays and TIFF, written whole or not at all; labelled ones read back."""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.arguments import checked
from tmca.data.atomic import atomic_path
from tmca.data.formats.arrays import LABELLED, labelled_attributes, open_groups, open_labelled
from tmca.data.formats.limits import check_bytes
from tmca.data.formats.stored import nearest_name, whole_file
from tmca.data.formats.wavelengths import metres_to_nm
from tmca.errors import DataError, OutputError, ShapeError

if TYPE_CHECKING:
    import xarray

    Labelled = xarray.DataArray | xarray.Dataset
else:
    Labelled = Any


def write_text(text: str, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write text (UTF-8) whole or not at all, and give the path back.

    Raises:
        OutputError: see `atomic_path`.
    """
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def write_json(value: Any, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write JSON whole or not at all; numpy numbers and arrays become plain ones, NaN and infinity null.

    Raises:
        OutputError: see `atomic_path`.
        TypeError: something that JSON cannot hold.
    """
    return write_text(json.dumps(plain(value), indent=2, ensure_ascii=False) + "\n", path, overwrite=overwrite)


def plain(value: Any) -> Any:
    """The value in JSON's own types: numpy, paths and bytes converted, NaN and infinity as None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value) if isinstance(value, Path) else value


def content_digest(said: Mapping[str, Any], own: str) -> str:
    """SHA-256 of what JSON says but for its entry ``own``, the digest itself, whatever its order and white space."""
    others = {name: value for name, value in said.items() if name != own}
    text = json.dumps(plain(others), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


@checked
def write_dataset(obj: Labelled, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write labelled data as NetCDF4/HDF5 (``.nc``, ``.h5``) or Zarr (``.zarr``), and give the path back.

    Arrays above 64 kB are compressed without loss; in Zarr each band (index of the first axis of a cube) is a
    chunk. Attributes that NetCDF cannot hold (None, dictionaries, mixed lists) are stored as JSON text.

    Raises:
        SettingError: no path.
        OutputError: an unknown suffix, or see `atomic_path`.
    """
    path = Path(path)
    if path.suffix not in (".nc", ".h5", ".zarr"):
        raise OutputError(path, f"the suffix {path.suffix!r}", ".nc, .h5 or .zarr", "rename the output")
    dataset = _storable(obj)
    with atomic_path(path, overwrite=overwrite) as temporary:
        if path.suffix == ".zarr":
            encoding = _zarr_encoding(dataset)
            dataset.to_zarr(temporary, mode="w", encoding=encoding, consolidated=True, zarr_format=2)
        else:
            # HDF5 can crash the process when a write fails under it, so it only writes to memory
            temporary.write_bytes(dataset.to_netcdf(None, engine="h5netcdf", encoding=_netcdf_encoding(dataset)))
    return path


def _storable(obj: xarray.DataArray | xarray.Dataset) -> xarray.Dataset:
    """A copy as a dataset with attributes that NetCDF can hold and no encodings of an earlier file."""
    import xarray

    dataset = obj.to_dataset(name=obj.name or "data") if isinstance(obj, xarray.DataArray) else obj
    dataset = dataset.copy(deep=False).drop_encoding()
    dataset.attrs = _storable_attrs(dataset.attrs)
    for name in dataset.variables:
        dataset[name].attrs = _storable_attrs(dataset[name].attrs)
    return dataset


def _storable_attrs(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(key): _storable_attr(value) for key, value in attrs.items()}


def _storable_attr(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, str | int | float | np.number) or (
        isinstance(value, np.ndarray) and value.dtype.kind in "uif"
    ):
        return value
    items = value if isinstance(value, list | tuple) else ()
    if items and all(isinstance(item, int | float) and not isinstance(item, bool) for item in items):
        return list(items)
    return json.dumps(plain(value), ensure_ascii=False)


def _netcdf_encoding(dataset: xarray.Dataset) -> dict[Any, dict[str, Any]]:
    encoding: dict[Any, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        encoding[name] = {"_FillValue": None} if variable.dtype.kind == "f" else {}
        if variable.dtype.kind in "buif" and variable.nbytes > 65536:
            encoding[name] |= {"zlib": True, "complevel": 1, "shuffle": True}
    return encoding


def _zarr_encoding(dataset: xarray.Dataset) -> dict[Any, dict[str, Any]]:
    cubes = {name: v for name, v in dataset.data_vars.items() if v.ndim >= 3 and v.size}
    return {name: {"chunks": (1, *variable.shape[1:])} for name, variable in cubes.items()}


SUFFIXES = (".nc", ".h5", ".zarr", ".nc4", ".hdf5")


@checked
def read_dataset(path: str | Path, required: Iterable[str] = ()) -> xarray.Dataset:
    """A NetCDF or Zarr file as an ``xarray.Dataset``, loaded whole, the file closed again.

    Args:
        path: a file from `write_dataset`, or any NetCDF file.
        required: variables or coordinates that it must hold.

    Raises:
        SettingError: no path.
        DataError: missing, not such a file, cut short, or without a required variable.
    """
    path = _labelled_file(path)
    with open_labelled(path) as dataset:
        missing = [name for name in required if name not in dataset.variables]
        if missing:
            there = ", ".join(str(name) for name in dataset.variables) or "none"
            raise DataError(path, f"no variable {', '.join(missing)}", f"it beside those there ({there})")
        return _loaded(path, dataset, LABELLED)


def read_attributes(path: str | Path) -> dict[str, Any]:
    """Attributes of a NetCDF or Zarr file; errors as of `read_dataset`."""
    return labelled_attributes(_labelled_file(path))


def _labelled_file(path: str | Path) -> Path:
    path = Path(path)
    if not path.exists():
        raise DataError(path, "no such file", "an existing one", nearest_name(path))
    if path.suffix.lower() not in SUFFIXES:
        raise DataError(path, f"the suffix {path.suffix!r}", f"a labelled file ({' '.join(SUFFIXES[:3])})")
    return path


def read_groups(path: str | Path, kind: str) -> dict[str, xarray.Dataset]:
    """The groups of a NetCDF file by their names, each loaded whole, the file closed again.

    Raises:
        DataError: missing, not such a file, or cut short.
    """
    path = Path(path)
    with open_groups(path, kind) as groups:
        return {name: _loaded(path, group, kind) for name, group in groups.items()}


def _loaded(path: Path, dataset: xarray.Dataset, kind: str) -> xarray.Dataset:
    """The same with its values, if they may be loaded."""
    check_bytes(path, "all its variables", sum(variable.nbytes for variable in dataset.variables.values()))
    with whole_file(path, kind, "write it again"):
        return dataset.load()


_LIMIT = 2**32 - 2**20
"""ImageJ's own TIFF holds one contiguous stack below 4 GiB."""


def write_tiff(cube: xarray.DataArray, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a cube as float32 TIFF, one page per band, each labelled with its wavelength ("450 nm").

    Args:
        cube: dims ``(wavelength, y, x)`` with the coordinate ``wavelength`` in metres.
        path: ending in ``.tif`` or ``.tiff``.
        overwrite: replace an existing file.

    Raises:
        ShapeError: not such a cube.
        OutputError: a wrong suffix, a cube above 4 GiB, or see `atomic_path`.
    """
    path = Path(path)
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise OutputError(path, f"the suffix {path.suffix!r}", ".tif or .tiff", "rename the output")
    if cube.dims != ("wavelength", "y", "x") or "wavelength" not in cube.coords:
        raise ShapeError("cube", f"dims {cube.dims}", "(wavelength, y, x) with a wavelength coordinate")
    if cube.size * 4 > _LIMIT:
        raise OutputError(path, f"a cube of {cube.size * 4 / 2**30:.1f} GiB", "less than 4 GiB", "write .nc or .zarr")
    labels = [f"{nm:.10g} nm" for nm in metres_to_nm(cube.coords["wavelength"].values)]
    about = {"axes": "ZYX", "Labels": labels, "mode": "grayscale", "quantity": str(cube.attrs.get("quantity", ""))}
    with atomic_path(path, overwrite=overwrite) as temporary:
        pixels = np.ascontiguousarray(cube.values, dtype=np.float32)
        temporary.write_bytes(tiff_bytes(pixels, imagej=True, photometric="minisblack", metadata=about))
    return path


def tiff_bytes(pixels: NDArray[Any], **how: Any) -> bytes:
    """A TIFF in memory, as `tifffile.imwrite` makes it, which would cut a small one without an error on a full disk."""
    import tifffile

    memory = io.BytesIO()
    tifffile.imwrite(memory, pixels, **how)
    return memory.getvalue()
