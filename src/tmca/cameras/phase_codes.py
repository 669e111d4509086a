"""Codes of the spectral-depth camera as a file: height maps, shutter and filters of one exposure, and their bench.

Nothing in it depends on bands: filters and channels are kept by name, so that a camera of any bands may show them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.cameras.spectral_depth import SpectralDepthCamera
from tmca.errors import DataError, TmcaError
from tmca.optics import PhaseMaskBench, Stroke, changed_bench, family_parameters, restored_maps

_PARTS = ("heights", "shutter", "cells")
_OF_FAMILY = {
    "coefficients": (("slot", "mode"), {"units": "m", "long_name": "rms of Zernike modes over the aperture"}),
    "noll": (("mode",), {"long_name": "Noll index of the mode"}),
    "radii": (("slot", "radius"), {"units": "m", "long_name": "heights at even radii, from the middle to the rim"}),
}
"""Variables of masks that are not free-form."""
_SAID = ("bench", "depth", "filters", "channels", "exposure", "energy")


def write_phase_codes(
    camera: SpectralDepthCamera,
    path: str | Path,
    filters: str,
    channels: str,
    notes: Mapping[str, Any] | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Write a camera's codes as NetCDF.

    ``heights`` (slot, y_mask, x_mask) in metres, ``shutter`` (slot, y_tile, x_tile), and ``cells`` (y_tile, x_tile),
    the index of the filter over every pixel; of Zernike masks also ``coefficients`` (slot, mode) in metres rms and
    their ``noll`` indices, of rotationally symmetric ones ``radii`` (slot, radius) in metres.

    Args:
        camera: whose shutter repeats.
        path: of the file.
        filters: family of its filters.
        channels: of its sensor.
        notes: further attributes.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    from tmca.data import write_dataset

    camera.tile()  # refuses patterns that do not repeat
    stored = camera.variables()
    heights = camera.point_spread.heights
    for name, values in family_parameters(heights).items():
        axes, meaning = _OF_FAMILY[name]
        stored[name] = (axes, values.numpy(force=True), meaning)
    of_camera = {name: stored.attrs[name] for name in ("bench", "depth", "exposure", "energy")}
    stroke = {} if heights.stroke is None else {"stroke": json.dumps(asdict(heights.stroke))}
    dataset = stored[[*_PARTS, *family_parameters(heights)]].reset_coords(drop=True)
    dataset.attrs = {**(notes or {}), **of_camera, "filters": filters, "channels": channels, **stroke}
    return write_dataset(dataset, path, overwrite=overwrite)


def read_phase_codes(path: str | Path) -> dict[str, Any]:
    """Arguments of ``SpectralDepthCamera`` that show the codes of a file of ``write_phase_codes``, masks as
    ``HeightMaps`` of their family.

    Raises:
        DataError: no such file, or a part of it is missing or does not fit the others.
    """
    from tmca.data import read_dataset

    stored, remedy = read_dataset(path, _PARTS), "write codes with `tmca design spectral-depth`"
    if unsaid := [name for name in _SAID if name not in stored.attrs]:
        raise DataError(path, f"no attribute {', '.join(unsaid)}", f"attributes {', '.join(_SAID)}", remedy)
    numbers = {str(name): torch.from_numpy(stored[name].values.astype(np.float32)) for name in stored.data_vars}
    heights, shutter = numbers["heights"], numbers["shutter"]
    cells = torch.from_numpy(stored["cells"].values.astype(np.int64))
    if (heights.ndim, shutter.ndim) != (3, 3) or shutter.shape != (len(heights), *cells.shape):
        found = f"heights {tuple(heights.shape)}, shutter {tuple(shutter.shape)}, cells {tuple(cells.shape)}"
        raise DataError(path, found, "(K, rows, columns) of maps, (K, Q, Q) and (Q, Q) of a tile", remedy)
    try:
        bench, depth = json.loads(stored.attrs["bench"]), json.loads(stored.attrs["depth"])
        settings: dict[str, Any] = {"bench": changed_bench(PhaseMaskBench(), bench), "planes": int(depth["count"])}
        settings["depth"] = (float(depth["near"]), float(depth["far"]))
        if "stroke" in stored.attrs:
            settings["stroke"] = Stroke(**json.loads(stored.attrs["stroke"]))
        maps = restored_maps(heights, numbers, settings.get("stroke"))
    except (KeyError, TypeError, ValueError, TmcaError) as error:
        raise DataError(path, f"masks, bench or depth that are none ({error})", "those of a camera", remedy) from error
    named = {name: str(stored.attrs[name]) for name in ("filters", "channels", "exposure", "energy")}
    return {**settings, **named, "mask": maps, "shutter": shutter, "cells": cells, "slots": len(heights),
            "period": len(cells)}  # fmt: skip
