"""Priors on disk: labelled NetCDF4 that opens in plain xarray."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, OutputError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.priors.mixture import GaussianMixturePrior

FORMAT = "tmca prior 1"
DIMENSIONS = {
    "mean": ("channel", "y", "x"),
    "covariance": ("pixel", "other_pixel"),
    "autocovariance": ("channel", "other_channel", "dy", "dx"),
    "basis": ("pixel", "direction"),
    "kind_mean": ("kind", "direction"),
    "kind_covariance": ("kind", "direction", "other_direction"),
    "kind_scale": ("kind",),
    "gain_level": ("gain",),
    "weight": ("kind", "gain"),
}
REQUIRED = {
    "gaussian": ("mean",),
    "gaussian mixture": (
        "mean",
        "basis",
        "kind_mean",
        "kind_covariance",
        "kind_scale",
        "gain_level",
        "weight",
    ),
}


def mixture_arrays(prior: GaussianMixturePrior) -> dict[str, Tensor]:
    """The arrays of a mixture prior by their names in the file."""
    moments = "autocovariance" if prior.base.stationary else "covariance"
    return {
        "mean": prior.base.mean,
        moments: prior.base.moments,
        "basis": prior.basis,
        "kind_mean": prior.means,
        "kind_covariance": prior.covariances,
        "kind_scale": prior.scales,
        "gain_level": prior.gains,
        "weight": prior.weights,
    }


def write_prior(
    path: str | Path,
    kind: str,
    arrays: dict[str, Tensor],
    wavelengths: tuple[float, ...] | None,
    sources: tuple[str, ...],
) -> None:
    """Write a prior's arrays as NetCDF4, under a temporary name until the file is whole.

    Raises:
        OutputError: the file cannot be written.
    """
    import xarray as xr

    path = Path(path)
    variables = {name: (DIMENSIONS[name], value.numpy()) for name, value in arrays.items()}
    data = xr.Dataset(variables, attrs={"format": FORMAT, "kind": kind, "sources": "\n".join(sources)})
    data.attrs["block"] = list(arrays["mean"].shape)
    if wavelengths is not None:
        data = data.assign_coords(wavelength=("channel", np.array(wavelengths), {"units": "m"}))
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        data.to_netcdf(temporary, engine="h5netcdf", encoding={name: {"zlib": True} for name in variables})
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(path, f"it cannot be written ({error})", "a writable place with room") from error
    finally:
        temporary.unlink(missing_ok=True)


def read_prior(path: str | Path, kind: str) -> tuple[dict[str, Tensor], tuple[float, ...] | None, tuple[str, ...]]:
    """Arrays, wavelengths in metres and sources of a prior file.

    Raises:
        DataError: no such file, no prior of this kind in it, or damaged content.
    """
    data = _open(path)
    _check(path, data, kind)
    arrays = {n: torch.from_numpy(data[n].values.astype(np.float64)) for n in DIMENSIONS if n in data}
    sources = tuple(line for line in str(data.attrs.get("sources", "")).split("\n") if line)
    lengths = tuple(data["wavelength"].values.tolist()) if "wavelength" in data.coords else None
    return arrays, lengths, sources


def prior_kind(path: str | Path) -> str:
    """Which kind of prior a file says it holds.

    Raises:
        DataError: no such file, or no NetCDF4.
    """
    return str(_open(path).attrs.get("kind"))


def _open(path: str | Path) -> xr.Dataset:
    """The whole content of a file, or DataError."""
    import xarray as xr

    if not Path(path).is_file():
        raise DataError(path, "no such file", "a prior", "learn one and save it there")
    try:
        with xr.open_dataset(path, engine="h5netcdf") as data:
            return data.load()
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise DataError(path, f"no readable NetCDF4 ({error})", "a prior file") from error


def _check(path: str | Path, data: xr.Dataset, kind: str) -> None:
    """Raise DataError unless the file holds a whole prior of this kind."""
    if data.attrs.get("format") != FORMAT:
        raise DataError(path, f"format {data.attrs.get('format')!r}", repr(FORMAT), "write it with the prior's save()")
    if data.attrs.get("kind") != kind:
        raise DataError(path, f"a {data.attrs.get('kind')} prior", f"a {kind} prior", "load it with its own class")
    missing = [name for name in REQUIRED[kind] if name not in data]
    if not {"covariance", "autocovariance"} & set(data):
        missing.append("covariance")
    if missing:
        raise DataError(path, f"no {', '.join(missing)}", "every part of the prior", "copy the file again")
    if not all(np.isfinite(data[name].values).all() for name in DIMENSIONS if name in data):
        raise DataError(path, "values that are not finite", "numbers", "learn the prior again")
