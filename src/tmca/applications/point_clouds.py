"""Scenes with depth as clouds of points in their colours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tmca.data import holds_rgbd, read_rgbd, read_spectral_depth
from tmca.data.formats.opening import is_zarr, open_contents
from tmca.data.pixels import encoded
from tmca.data.point_cloud import FOCAL, points_of
from tmca.data.rendering import is_rendered, rendered_scene
from tmca.errors import DataError, SettingError
from tmca.plots.cube import rgb_composite

if TYPE_CHECKING:
    import xarray as xr


class PointCloud(NamedTuple):
    """Points in metres, x to the right, y up, the camera at the origin and looking along -z.

    Args:
        points: ``(N, 3)``.
        colours: ``(N, 3)``.
        focal_px: of the pinhole, pixels.
        known: whether that is the camera's own; else it is as long as the picture is wide.
    """

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]
    focal_px: float
    known: bool


def point_cloud(
    source: str | Path | xr.Dataset, focal_px: float | None = None, least_confidence: float = 0.0
) -> PointCloud:
    """The points that the pixels of a scene with depth show.

    Args:
        source: an estimate by the spectral-depth camera or its file, a scene with depth, or a rendered one by name.
        focal_px: of the camera, pixels; what the scene says of its camera without it, or the width of the picture.
        least_confidence: pixels below it are left out, where the depth has a confidence.

    Raises:
        DataError: no scene with depth, or one without any point.
        SettingError: a focal length that is not above 0, a confidence that the scene does not have.
    """
    scene, picture = _scene(source)
    where, depth = str(source) if isinstance(source, str | Path) else "scene", scene["depth"].values
    told = float(scene.attrs.get(FOCAL, 0.0))
    focal = focal_px if focal_px is not None else told if told > 0 else float(depth.shape[1])
    sure = None
    if least_confidence > 0:
        if "confidence" not in scene:
            raise SettingError(
                "confidence", f"{least_confidence:g}", "none: this depth has no confidence", "leave it out"
            )
        sure = scene["confidence"].values >= least_confidence
    points, colours = points_of(depth, picture, focal, sure)
    if not len(points):
        raise DataError(where, "no pixel with a depth", "some", "take a lower --confidence" if sure is not None else "")
    return PointCloud(points, colours, focal, focal_px is not None or told > 0)


def _scene(source: str | Path | xr.Dataset) -> tuple[xr.Dataset, NDArray[np.floating]]:
    """A scene with its depth, and its colours (y, x, 3) in [0, 1]."""
    if isinstance(source, str | Path):
        if holds_rgbd(source):
            scene = read_rgbd(source)
            return scene, np.moveaxis(encoded(scene["rgb"].values), 0, -1)
        rendered = not Path(source).exists() and is_rendered(str(source))
        scene = rendered_scene(str(source)) if rendered else _with_confidence(Path(source))
    else:
        scene = source
    if not {"radiance", "depth"} <= set(scene):
        raise DataError("scene", ", ".join(map(str, scene)) or "nothing", "radiance and depth")
    cube = scene["radiance"]
    return scene, rgb_composite(cube.values, cube["wavelength"].values.tolist())


def _with_confidence(path: Path) -> xr.Dataset:
    """A scene with depth from files, with the confidence that lies beside the depth of an estimate."""
    scene = read_spectral_depth(path, negative="keep")
    if path.is_dir() and not is_zarr(path):
        return scene
    with open_contents(path) as contents:
        stored = contents.arrays.get("confidence")
        if stored is None or stored.shape != scene["depth"].shape:
            return scene
        return scene.assign(confidence=(("y", "x"), stored.whole()))
