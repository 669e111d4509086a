"""Reconstructions of any camera as files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import xarray as xr


class Decoding(Protocol):
    """What every reconstruction says of itself."""

    decoder: str
    seconds: float
    metrics: dict[str, float]
    notes: dict[str, Any]


class Reconstructed(Decoding, Protocol):
    """A reconstruction of one array, whose error may be known."""

    deviation: xr.DataArray | None


def write_reconstruction(result: Reconstructed, estimate: xr.DataArray, path: str | Path, overwrite: bool) -> Path:
    """Write ``estimate`` and ``deviation`` to a NetCDF file, notes and metrics as its attributes.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    parts = {"estimate": estimate} | ({} if result.deviation is None else {"deviation": result.deviation})
    return write_parts(result, parts, path, overwrite)


def write_parts(result: Decoding, parts: Mapping[str, xr.DataArray], path: str | Path, overwrite: bool) -> Path:
    """Write named arrays to a NetCDF file, notes and metrics as its attributes.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    import xarray as xr

    from tmca.data import write_dataset

    measured = {f"metric_{name}": value for name, value in result.metrics.items()}
    attrs = {**result.notes, "decoder": result.decoder, "seconds": result.seconds, **measured}
    return write_dataset(xr.Dataset(parts, attrs=attrs), path, overwrite=overwrite)
