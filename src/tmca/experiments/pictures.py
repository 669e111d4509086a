"""A picture of any file that ``tmca inspect`` can describe."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.cameras import Snapshot, holds_snapshot
from tmca.errors import DataError
from tmca.experiments.camera_figures import snapshot_figure
from tmca.experiments.figures import cube_figure, image_figure, save_figure
from tmca.experiments.light_field.picture import light_field_picture
from tmca.experiments.spectral_depth.maps import rgbd_picture, spectral_depth_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def picture_of(path: Path, out: Path, *, variable: str | None = None, overwrite: bool = False, **views: Any) -> Path:
    """Write a PNG of a snapshot, a prior, a cube, a light field, a scene with depth or an image.

    ``views`` are ``pattern`` and ``lens`` of `tmca.data.read_light_field`.

    Raises:
        DataError: nothing in the file can be drawn.
        OutputError: ``out`` exists, or cannot be written.
    """
    return save_figure(_figure(path, variable, views), out, overwrite=overwrite)


def _figure(path: Path, variable: str | None, views: dict[str, Any]) -> Figure:
    from tmca.data import describe, read, read_array

    found = describe(path, variable, **views)
    names = set(found.get("variables", {})) | set(found.get("coords", {}))
    if holds_snapshot(names):
        snapshot = Snapshot.load(path)
        return snapshot_figure(snapshot.values[0, 0].numpy(), snapshot.camera, path.name)
    if "covariance" in names or "autocovariance" in names:
        from tmca.priors import load_prior

        return load_prior(path).figure()
    if {"atom", "scale"} <= names:
        from tmca.priors import PatchDictionary

        return PatchDictionary.load(path).figure()
    if found["kind"] == "light field":
        return light_field_picture(path, variable, **views)
    if found["kind"] == "RGB-D scene":
        return rgbd_picture(path)
    if found["kind"] == "spectral-depth scene" or (found["kind"] == "cube" and "pixels" in (found.get("depth") or {})):
        return spectral_depth_picture(path, variable)
    if found["kind"] == "cube":
        cube = read(path, variable=variable, negative="keep")
        return cube_figure(cube.values, cube["wavelength"].values.tolist(), path.name)
    values = np.squeeze(read_array(path, variable))
    if values.ndim not in (2, 3):
        raise DataError(path, f"an array of {values.ndim} dimensions", "2 or 3 for a picture")
    return image_figure(values, path.name)
