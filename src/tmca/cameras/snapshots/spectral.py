"""Snapshot files of the spectral camera.

A NetCDF file with the variables ``snapshot`` (y, x_sensor), ``aperture`` (slot, y, x), ``shutter`` (slot, y, x_sensor),
``displacement`` and ``response`` (wavelength), for a coloured aperture ``coloured_aperture`` (wavelength, y, x), and as
attributes the exposure convention, the direction and origin of the dispersion, and the sensor. Behind a dual disperser
the aperture is the wider plane (x_mask), the snapshot is on x.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras.snapshots.parts import (
    UNITS,
    camera_from,
    check_full_scale,
    check_said,
    check_values,
    code_planes,
    common_attributes,
    json_attribute,
    read_planes,
    settings_of,
    tile_attribute,
)
from tmca.cameras.spectral import DISPERSERS, SpectralCamera
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

NEEDED = ("snapshot", "aperture", "shutter", "displacement", "response", "wavelength")
_MEANING = {**UNITS, "long_name": "snapshot, 1 = one band of a white scene, everything open"}
SAID = ("exposure", "disperser", "origin", "full_scale", "sensor")
"""Attributes without which nobody knows what the values mean."""


def to_dataset(values: Tensor, camera: SpectralCamera, notes: dict[str, Any]) -> xr.Dataset:
    """The snapshot (1, 1, H, W') as a labelled data set."""
    import xarray as xr

    x_aperture, x_sensor = ("x", "x_sensor") if camera.disperser == "single" else ("x_mask", "x")
    dataset = xr.Dataset(
        {
            "snapshot": (("y", x_sensor), values[0, 0].detach().cpu().numpy(), _MEANING),
            **code_planes(camera, ("y", x_aperture), ("y", x_sensor)),
            "displacement": (
                "wavelength",
                np.array(camera.dispersion.displacement),
                {"units": "pixel", "direction": "along x, towards larger x"},
            ),
            "response": ("wavelength", camera.response.detach().cpu().numpy(), {"long_name": "sensor response"}),
        },
        coords={
            "wavelength": ("wavelength", np.array(camera.wavelengths), {"units": "m"}),
            "wavelength_nm": ("wavelength", np.array(camera.wavelengths) * 1e9, {"units": "nm"}),
        },
        attrs={**notes, **_attributes(camera)},
    )
    if camera.coloured is not None:
        colours = camera.coloured.detach().cpu().numpy()
        dataset["coloured_aperture"] = (("wavelength", "y", "x"), colours, {"long_name": "transmittance", "units": "1"})
    if camera.disperser == "single":
        columns = camera.dispersion.origin + np.arange(camera.snapshot_shape[2])
        dataset = dataset.assign_coords(x_sensor=("x_sensor", columns, {"units": "pixel", "long_name": "scene column"}))
    return dataset


def from_dataset(dataset: xr.Dataset, where: str) -> tuple[Tensor, SpectralCamera, set[str]]:
    """Values, camera and the attributes that are the camera's own.

    Raises:
        DataError: a variable is missing or does not fit the others.
    """
    check_said(dataset, where, NEEDED, SAID, "docs/spectral.md")
    values = check_values(dataset, where, ("y", "x"))
    _check_geometry(dataset, where)
    camera = _camera(dataset, where)
    _check_origin(dataset, camera, where)
    check_full_scale(dataset, camera, where)
    return values, camera, {*_attributes(camera)}


def _origin(camera: SpectralCamera) -> int:
    """Scene column on which sensor column 0 lies; a dual disperser displaces nothing on the sensor."""
    return camera.dispersion.origin if camera.disperser == "single" else 0


def _check_geometry(dataset: xr.Dataset, where: str) -> None:
    for name, choices in (("disperser", DISPERSERS), ("dispersion_axis", ("x",)), ("camera", ("spectral",))):
        found = dataset.attrs.get(name, choices[0])
        if found not in choices:
            raise DataError(where, f"{name} = {found!r}", f"one of {', '.join(choices)}", "correct the attribute")


def _check_origin(dataset: xr.Dataset, camera: SpectralCamera, where: str) -> None:
    """What the file says of its origin must be what its displacement says."""
    said = [dataset.attrs["origin"]] if "origin" in dataset.attrs else []
    if "x_sensor" in dataset.coords:
        said.append(dataset["x_sensor"].values[0])
    for value in said:
        if value != _origin(camera):
            raise DataError(
                where,
                f"origin {value}",
                f"{_origin(camera)} from the displacement",
                "correct the displacement or the origin (and x_sensor)",
            )


def _camera(dataset: xr.Dataset, where: str) -> SpectralCamera:
    planes = read_planes(dataset)
    attrs = dataset.attrs
    dual = attrs.get("disperser", "single") == "dual"
    height, width = planes["shutter" if dual else "aperture"].shape[-2:]
    return camera_from(
        SpectralCamera, where, "aperture, shutter and displacement that fit",
        bands=dataset["wavelength"].values.tolist(),
        size=(height, width),
        dispersion=dataset["displacement"].values.tolist(),
        disperser="dual" if dual else "single",
        response=torch.from_numpy(np.array(dataset["response"].values, dtype=np.float32)),
        relay_blur=json_attribute(attrs, "relay_blur", 0.0, where),
        coloured=_coloured(dataset),
        **planes, **settings_of(attrs, where),
    )  # fmt: skip


def _coloured(dataset: xr.Dataset) -> Tensor | None:
    if "coloured_aperture" not in dataset.variables:
        return None
    ordered = dataset["coloured_aperture"].transpose("wavelength", "y", "x")
    return torch.from_numpy(np.array(ordered.values, dtype=np.float32))


def _attributes(camera: SpectralCamera) -> dict[str, Any]:
    return {
        **common_attributes(camera),
        **tile_attribute(camera),
        "disperser": camera.disperser,
        "dispersion_axis": "x",
        "origin": _origin(camera),
        "relay_blur": json.dumps(camera.relay_blur),
    }
