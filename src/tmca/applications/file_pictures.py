"""A picture of any file that ``tmca inspect`` can describe."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.applications.camera_figures import snapshot_figure
from tmca.cameras import Snapshot, holds_snapshot
from tmca.data import (
    ESTIMATED,
    describe,
    read,
    read_array,
    read_disparity,
    read_light_field,
    read_rgbd,
    read_spectral_depth,
)
from tmca.data.describe import is_prior
from tmca.data.formats.opening import is_zarr, open_contents
from tmca.data.pixels import encoded
from tmca.errors import DataError
from tmca.plots.cube import cube_figure
from tmca.plots.depth import rgbd_figure, scene_figure
from tmca.plots.style import image_figure, save_figure
from tmca.plots.views import light_field_views
from tmca.priors import load_prior

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOSAIC_PX = 1100
"""Sides of the mosaic, about: what a picture of this width can show."""


def picture_of(path: Path, out: Path, *, variable: str | None = None, overwrite: bool = False, **views: Any) -> Path:
    """Write a PNG of a snapshot, a prior, a cube, a light field, a scene with depth or an image.

    ``views`` are ``pattern`` and ``lens`` of `tmca.data.read_light_field`.

    Raises:
        DataError: nothing in the file can be drawn.
        OutputError: ``out`` exists, or cannot be written.
    """
    return save_figure(_figure(path, variable, views), out, overwrite=overwrite)


def _figure(path: Path, variable: str | None, views: dict[str, Any]) -> Figure:
    description = describe(path, variable, **views)
    if holds_snapshot({*description["variables"]}):
        return snapshot_figure(Snapshot.load(path), path.name)
    if is_prior(description):
        return load_prior(path).figure()
    if description["kind"] == "light field":
        return _light_field(path, variable, description["light_field"], views)
    if description["kind"] == "RGB-D scene":
        return _rgbd(path)
    if description["kind"] == "spectral-depth scene" or (
        description["kind"] == "cube" and "pixels" in (description.get("depth") or {})
    ):
        return _spectral_depth(path, variable)
    if description["kind"] == "cube":
        cube = read(path, variable=variable, negative="keep")
        return cube_figure(cube.values, cube["wavelength"].values.tolist(), path.name)
    values = np.squeeze(read_array(path, variable))
    if values.ndim not in (2, 3):
        raise DataError(path, f"an array of {values.ndim} dimensions", "2 or 3 for a picture")
    return image_figure(values, path.name)


def _light_field(path: Path, variable: str | None, facts: dict[str, Any], how: dict[str, Any]) -> Figure:
    """Views of what `tmca.data.describe` says these ``facts`` of, as a mosaic, and the centre one."""
    most = min(facts["views"])
    views, shortest = most - (most % 2 == 0), min(facts["size"])
    scale = min(shortest, max(1, round(max(facts["size"]) * views / _MOSAIC_PX)))
    small = read_light_field(path, views=views, scale=scale, colour=facts["colour"], variable=variable, **how)
    centre = read_light_field(path, views=1, colour=facts["colour"], variable=variable, **how)
    truth = facts["disparity"]
    has_truth = truth is not None and truth["min"] is not None
    disparity = read_disparity(path, pattern=how.get("pattern")).values if has_truth else None
    matched = _matched(path, centre.shape[-2:]) if disparity is None else None
    said = "true disparity" if matched is None else "disparity matched from the views"
    return light_field_views(centre.values, small.values, disparity if matched is None else matched, path.name, said)


def _matched(path: Path, size: tuple[int, ...]) -> np.ndarray | None:
    """The disparity that an estimate's own views were found to have, from its file."""
    if path.is_dir() and not is_zarr(path):
        return None
    with open_contents(path) as contents:
        stored = contents.arrays.get("disparity")
        usable = stored is not None and stored.attrs.get(ESTIMATED) and stored.shape == size
        return stored.whole() if stored is not None and usable else None


def _rgbd(path: Path) -> Figure:
    """Picture and depth of an RGB-D scene."""
    scene = read_rgbd(path)
    picture = np.moveaxis(encoded(scene["rgb"].values), 0, -1)
    return rgbd_figure(picture, scene["depth"].values, str(scene.attrs["name"]), bool(scene.attrs["metric"]))


def _spectral_depth(path: Path, variable: str | None = None) -> Figure:
    """Colour composite, depth, and spectra of a few points of a spectral scene with depth."""
    scene = read_spectral_depth(path, variable=variable, negative="keep")
    pair, metric = (scene["radiance"].values, scene["depth"].values), bool(scene.attrs["metric"])
    return scene_figure(pair, scene["wavelength"].values.tolist(), path.name, metric)
