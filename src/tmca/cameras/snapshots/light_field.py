"""Snapshot files of the light-field camera.

A NetCDF file with the variables ``snapshot`` (y, x), or (colour, y, x), ``aperture`` (slot, y_mask, x_mask),
``shutter`` (slot, y, x) and ``vignetting`` (view_v, view_u), and as attributes the exposure convention, shear and scale
of the mask, and the sensor.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras.light_field import LightFieldCamera
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
from tmca.optics import view_coordinates

if TYPE_CHECKING:
    import xarray as xr

NEEDED = ("snapshot", "aperture", "shutter", "vignetting")
SAID = ("exposure", "shear", "mask_scale", "full_scale", "sensor")
_COLOURS = ("red", "green", "blue")


def to_dataset(values: Tensor, camera: LightFieldCamera, notes: dict[str, Any]) -> xr.Dataset:
    """The snapshot (B, 1, H, W), B = 1 or the three colours, as a labelled data set."""
    import xarray as xr

    colour = ("colour",) if len(values) > 1 else ()
    image = values[:, 0].detach().cpu().numpy() if colour else values[0, 0].detach().cpu().numpy()
    named = {**UNITS, "long_name": "snapshot, 1 = one view of a white scene, everything open"}
    coords: dict[str, Any] = {
        name: (name, np.array(view_coordinates(count), dtype=float), {"units": "view steps"})
        for name, count in zip(("view_v", "view_u"), camera.views, strict=True)
    }
    if colour:
        coords["colour"] = ("colour", list(_COLOURS))
    return xr.Dataset(
        {
            "snapshot": ((*colour, "y", "x"), image, named),
            **code_planes(camera, ("y_mask", "x_mask"), ("y", "x")),
            "vignetting": (("view_v", "view_u"), camera.vignetting.detach().cpu().numpy(), {"units": "1"}),
        },
        coords=coords,
        attrs={**notes, **_attributes(camera)},
    )


def from_dataset(dataset: xr.Dataset, where: str) -> tuple[Tensor, LightFieldCamera, set[str]]:
    """Values, camera and the attributes that are the camera's own.

    Raises:
        DataError: a variable is missing or does not fit the others.
    """
    check_said(dataset, where, NEEDED, SAID, "docs/light-field.md")
    colour = ("colour",) if "colour" in dataset["snapshot"].dims else ()
    values = check_values(dataset, where, (*colour, "y", "x"))
    planes = read_planes(dataset)
    camera = camera_from(
        LightFieldCamera, where, "aperture, shutter and shear that fit",
        views=dataset["vignetting"].shape,
        size=tuple(planes["shutter"].shape[-2:]),
        shear=json_attribute(dataset.attrs, "shear", 1.0, where),
        mask_scale=float(dataset.attrs["mask_scale"]),
        vignetting=torch.from_numpy(np.array(dataset["vignetting"].values, dtype=np.float32)),
        **planes, **settings_of(dataset.attrs, where),
    )  # fmt: skip
    check_full_scale(dataset, camera, where)
    return values, camera, {*_attributes(camera)}


def _attributes(camera: LightFieldCamera) -> dict[str, Any]:
    return {
        **common_attributes(camera),
        **tile_attribute(camera),
        "shear": json.dumps(list(camera.shear.step)),
        "mask_scale": camera.shear.scale,
    }
