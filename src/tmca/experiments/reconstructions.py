"""Reconstructions of any camera as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import xarray as xr


class Reconstructed(Protocol):
    """What every reconstruction says of itself."""

    deviation: xr.DataArray | None
    decoder: str
    seconds: float
    metrics: dict[str, float]
    notes: dict[str, Any]


def write_reconstruction(result: Reconstructed, estimate: xr.DataArray, path: str | Path, overwrite: bool) -> Path:
    """Write ``estimate`` and ``deviation`` to a NetCDF file, notes and metrics as its attributes.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    import xarray as xr

    from tmca.data import write_dataset

    parts = {"estimate": estimate} | ({} if result.deviation is None else {"deviation": result.deviation})
    measured = {f"metric_{name}": value for name, value in result.metrics.items()}
    attrs = {**result.notes, "decoder": result.decoder, "seconds": result.seconds, **measured}
    return write_dataset(xr.Dataset(parts, attrs=attrs), path, overwrite=overwrite)
