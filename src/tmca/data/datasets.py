"""Reading back the labelled files that tmca writes: snapshots, priors, reconstructions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from tmca.data.formats.arrays import damaged, open_labelled
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".nc", ".h5", ".zarr", ".nc4", ".hdf5")


def read_dataset(path: str | Path, required: Iterable[str] = ()) -> xarray.Dataset:
    """A NetCDF or Zarr file as an ``xarray.Dataset``, loaded whole, the file closed again.

    Args:
        path: a file from `write_dataset`, or any NetCDF file.
        required: variables or coordinates that it must hold.

    Raises:
        DataError: missing, not such a file, cut short, or without a required variable.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(path, "no such file", "an existing one", "check the path")
    if path.suffix.lower() not in SUFFIXES:
        raise DataError(path, f"the suffix {path.suffix!r}", f"a labelled file ({' '.join(SUFFIXES[:3])})")
    if path.is_file() and path.stat().st_size == 0:
        raise DataError(path, "an empty file (0 bytes)", "a labelled file", "write it again")
    with open_labelled(path) as dataset:
        missing = [name for name in required if name not in dataset.variables]
        if missing:
            there = ", ".join(str(name) for name in dataset.variables) or "none"
            raise DataError(path, f"no variable {', '.join(missing)}", f"it beside those there ({there})")
        try:
            return dataset.load()
        except (OSError, RuntimeError, ValueError) as error:
            raise damaged(path, error) from error
