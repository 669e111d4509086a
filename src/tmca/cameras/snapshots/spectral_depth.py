"""Snapshot files of the spectral-depth camera.

A NetCDF file with the variables ``snapshot`` (channel, y, x), ``heights`` (slot, y_mask, x_mask) of the phase mask in
metres, ``shutter`` (slot, y_tile, x_tile), or (slot, y, x) where it does not repeat, ``filters`` (filter, wavelength),
``cells`` (y_tile, x_tile), the index of the filter over every pixel, and ``response`` (channel, wavelength), and as
attributes the exposure convention, bench, depth planes, energy of the point spread functions, and the sensor.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras.phase_codes import MEANING_OF_HEIGHTS
from tmca.cameras.snapshots.parts import (
    UNITS,
    camera_from,
    check_full_scale,
    check_said,
    check_values,
    common_attributes,
    compact,
    json_attribute,
    settings_of,
)
from tmca.cameras.spectral_depth import SpectralDepthCamera
from tmca.errors import DataError
from tmca.optics import PhaseMaskBench, changed_bench

if TYPE_CHECKING:
    import xarray as xr

NEEDED = ("snapshot", "heights", "shutter", "filters", "cells", "response", "wavelength")
SAID = ("exposure", "bench", "depth", "energy", "full_scale", "sensor")
_MEANING = {**UNITS, "long_name": "snapshot, 1 = one band of a white scene, everything open"}


def to_dataset(values: Tensor, camera: SpectralDepthCamera, notes: dict[str, Any]) -> xr.Dataset:
    """The snapshot (1, C, H, W) as a labelled data set."""
    import xarray as xr

    shutter = camera.shutter.tile().detach()
    tiled = camera.shutter.period is not None
    parts = {
        "snapshot": (("channel", "y", "x"), values[0].detach().cpu().numpy(), _MEANING),
        "heights": (("slot", "y_mask", "x_mask"), camera.codes()[0].detach().cpu().numpy(), MEANING_OF_HEIGHTS),
        "shutter": (
            ("slot", *(("y_tile", "x_tile") if tiled else ("y", "x"))),
            compact(shutter),
            {"units": "1 = open"},
        ),
        "filters": (("filter", "wavelength"), camera.filters.filters.cpu().numpy(), {"long_name": "transmittance"}),
        "cells": (("y_tile", "x_tile"), camera.filters.cells().cpu().numpy(), {"long_name": "index of the filter"}),
        "response": (("channel", "wavelength"), camera.response.detach().cpu().numpy(), {"long_name": "response"}),
    }
    waves = np.array(camera.wavelengths)
    coords = {
        "wavelength": ("wavelength", waves, {"units": "m"}),
        "wavelength_nm": ("wavelength", waves * 1e9, {"units": "nm"}),
    }
    return xr.Dataset(parts, coords=coords, attrs={**notes, **_attributes(camera)})


def from_dataset(dataset: xr.Dataset, where: str) -> tuple[Tensor, SpectralDepthCamera, set[str]]:
    """Values, camera and the attributes that are the camera's own.

    Raises:
        DataError: a variable is missing or does not fit the others.
    """
    check_said(dataset, where, NEEDED, SAID, "docs/spectral-depth.md")
    values = check_values(dataset, where, ("channel", "y", "x")).transpose(0, 1)
    camera = _camera(dataset, where, (values.shape[-2], values.shape[-1]))
    check_full_scale(dataset, camera, where)
    if tuple(values.shape[1:]) != camera.snapshot_shape:
        raise DataError(where, f"{values.shape[1]} channels", f"{len(camera.response)}, those of the response")
    return values, camera, {*_attributes(camera)}


def _camera(dataset: xr.Dataset, where: str, size: tuple[int, int]) -> SpectralDepthCamera:
    own = {
        name: torch.from_numpy(np.array(dataset[name].values, dtype=np.float32))
        for name in ("heights", "shutter", "filters", "response")
    }
    settings = settings_of(dataset.attrs, where)
    planes = json_attribute(dataset.attrs, "depth", {}, where)
    bench = json_attribute(dataset.attrs, "bench", {}, where)
    try:
        arguments = {
            "bench": changed_bench(PhaseMaskBench(), bench),
            "depth": (float(planes["near"]), float(planes["far"])),
            "planes": int(planes["count"]),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(where, f"bench or depth that are none ({error})", "those of a camera", "correct it") from error
    return camera_from(
        SpectralDepthCamera, where, "heights, shutter, filters and bench that fit",
        bands=dataset["wavelength"].values.tolist(), size=size, slots=len(own["heights"]), mask=own["heights"],
        shutter=own["shutter"], filters=own["filters"], cells=torch.from_numpy(np.array(dataset["cells"].values)),
        period=dataset["cells"].shape[0], channels=own["response"], energy=str(dataset.attrs["energy"]),
        image_formation=str(dataset.attrs.get("image_formation", "linear")), exposure=settings["exposure"],
        sensor=settings["sensor"], **arguments,
    )  # fmt: skip


def _attributes(camera: SpectralDepthCamera) -> dict[str, Any]:
    return {
        **common_attributes(camera),
        "bench": json.dumps(asdict(camera.bench)),
        "depth": json.dumps(asdict(camera.planes)),
        "energy": camera.spread.energy,
        "image_formation": camera.image_formation,
    }
