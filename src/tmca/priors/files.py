"""Priors on disk: labelled NetCDF4 that opens in plain xarray."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.priors.dictionary import PatchDictionary
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
    "atom": ("number", "view", "y", "x"),
    "scale": ("number",),
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
    "dictionary": ("atom", "scale"),
}
HOW_TO_LEARN = {
    "gaussian": "`tmca prior learn` (of light fields `learn-views`)",
    "gaussian mixture": "`tmca prior learn … --mixture` (of light fields `learn-views`)",
    "dictionary": "`tmca prior learn-views … --dictionary --out …`",
}
"""What writes a file of each kind."""


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
    *,
    overwrite: bool = False,
) -> Path:
    """Write a prior's arrays as NetCDF4, whole or not at all.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    import xarray as xr

    from tmca.data import write_dataset

    variables = {name: (DIMENSIONS[name], value.numpy()) for name, value in arrays.items()}
    data = xr.Dataset(variables, attrs={"format": FORMAT, "kind": kind, "sources": "\n".join(sources)})
    data.attrs["block"] = list(arrays["mean"].shape)
    if wavelengths is not None:
        data = data.assign_coords(wavelength=("channel", np.array(wavelengths), {"units": "m"}))
    return write_dataset(data, path, overwrite=overwrite)


def kind_of(path: str | Path) -> str:
    """``"gaussian"``, ``"gaussian mixture"`` or ``"dictionary"``, as the file says.

    Raises:
        DataError: no such file, or no prior in it.
    """
    return str(_open(path).attrs["kind"])


def read_prior(path: str | Path, kind: str) -> tuple[dict[str, Tensor], tuple[float, ...] | None, tuple[str, ...]]:
    """Arrays, wavelengths in metres and sources of a prior file.

    Raises:
        DataError: no such file, no prior of this kind in it, or damaged content.
    """
    data = _open(path, kind)
    _check(path, data, kind)
    arrays = {n: torch.from_numpy(data[n].values.astype(np.float64)) for n in DIMENSIONS if n in data}
    sources = tuple(line for line in str(data.attrs.get("sources", "")).split("\n") if line)
    lengths = tuple(data["wavelength"].values.tolist()) if "wavelength" in data.coords else None
    return arrays, lengths, sources


def write_dictionary(path: str | Path, dictionary: PatchDictionary, *, overwrite: bool = False) -> Path:
    """Write a dictionary as NetCDF4, whole or not at all; atoms in single precision.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    import xarray as xr

    from tmca.data import write_dataset

    atoms, scales = dictionary.atoms.cpu().numpy(), dictionary.scales.cpu().numpy()
    variables = {
        "atom": (DIMENSIONS["atom"], atoms.astype(np.float32)),
        "scale": (DIMENSIONS["scale"], scales, {"long_name": "mean absolute coefficient"}),
    }
    attrs = {"format": FORMAT, "kind": "dictionary", "sources": "\n".join(dictionary.sources)}
    data = xr.Dataset(variables, attrs=attrs)
    data.attrs |= {"views": list(dictionary.views), "residual": dictionary.residual}
    data.attrs["notes"] = json.dumps(dictionary.notes)
    return write_dataset(data, path, overwrite=overwrite)


def read_dictionary(path: str | Path) -> PatchDictionary:
    """The dictionary in a file.

    Raises:
        DataError: no such file, no dictionary in it, or damaged content.
    """
    from tmca.priors.dictionary import PatchDictionary

    data = _open(path, "dictionary")
    _check(path, data, "dictionary")
    atoms, scales = (torch.from_numpy(data[name].values.astype(np.float64)) for name in ("atom", "scale"))
    try:
        v, u = (int(number) for number in data.attrs["views"])
        notes, residual = json.loads(data.attrs["notes"]), float(data.attrs["residual"])
        sources = tuple(line for line in str(data.attrs.get("sources", "")).split("\n") if line)
        atoms = torch.nn.functional.normalize(atoms.flatten(1), dim=1).reshape(atoms.shape)
        return PatchDictionary(atoms, scales, (v, u), residual, sources, notes)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(path, f"a damaged description ({error})", "views, residual, notes", "copy it again") from error


def _open(path: str | Path, kind: str = "gaussian") -> xr.Dataset:
    from tmca.data import read_dataset

    data = read_dataset(path)
    if data.attrs.get("format") != FORMAT or data.attrs.get("kind") not in REQUIRED:
        found = "no dictionary in it" if kind == "dictionary" else "no prior in it"
        raise DataError(path, found, f"a file written by {HOW_TO_LEARN[kind]}", "learn one and name it")
    return data


def _check(path: str | Path, data: xr.Dataset, kind: str) -> None:
    """Raise DataError unless the file holds a whole prior of this kind."""
    if data.attrs.get("kind") != kind:
        found, wanted = (name if name == "dictionary" else f"{name} prior" for name in (data.attrs["kind"], kind))
        raise DataError(path, f"a {found}", f"a {wanted}", f"name one that {HOW_TO_LEARN[kind]} wrote")
    missing = [name for name in REQUIRED[kind] if name not in data]
    if kind != "dictionary" and not {"covariance", "autocovariance"} & set(data):
        missing.append("covariance")
    if missing:
        raise DataError(path, f"no {', '.join(missing)}", "every part of the prior", "copy the file again")
    if not all(np.isfinite(data[name].values).all() for name in DIMENSIONS if name in data):
        raise DataError(path, "values that are not finite", "numbers", "learn the prior again")
