"""Scenes with depth as clouds of points in their colours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tmca.data import holds_rgbd, read_rgbd, read_spectral_depth
from tmca.data.formats.opening import is_zarr, open_contents
from tmca.data.pixels import encoded
from tmca.data.point_cloud import FOCAL, points_of, write_ply
from tmca.data.rendering import is_rendered, rendered_scene
from tmca.decoders import Estimate
from tmca.errors import DataError, SettingError, check_range
from tmca.plots.cube import rgb_composite
from tmca.plots.style import bright_level
from tmca.summaries import Summary

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


_DOTS = 20_000
"""Points that are drawn."""


@dataclass(frozen=True, repr=False)
class PointCloud(Summary):
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

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a PLY file, which MeshLab, CloudCompare and Blender open.

        Raises:
            OutputError: another suffix than ``.ply``, the file exists, or it cannot be written.
        """
        origin = "" if self.known else ", as wide as the picture, since the camera's is not known (--focal)"
        about = f"points in metres before a pinhole camera, focal length {self.focal_px:g} pixels{origin}"
        return write_ply(self.points, self.colours, path, comment=about, overwrite=overwrite)

    def plot(self) -> Figure:
        """The points from the side, in their colours; of many every n-th."""
        from tmca.plots.depth import points_figure

        step = -(-len(self.points) // _DOTS)
        return points_figure(self.points[::step], self.colours[::step])

    def _facts(self) -> dict[str, str]:
        near, far = -self.points[:, 2].max(), -self.points[:, 2].min()
        known = "" if self.known else ", not known: the width of the picture"
        return {
            "points": str(len(self.points)),
            "distance": f"{near:.3g} to {far:.3g} m",
            "focal length": f"{self.focal_px:g} px{known}",
        }

    def _picture(self) -> Figure:
        return self.plot()


def point_cloud(
    source: str | Path | xr.Dataset | Estimate,
    focal_px: float | None = None,
    least_confidence: float = 0.0,
    *,
    baseline: float | None = None,
    focus: float | None = None,
) -> PointCloud:
    """The points that the pixels of a scene with depth show.

    A light field has disparities d in the place of depths z. Of views a ``baseline`` apart that are focused at a
    distance, ``d = focal_px · baseline · (1/z − 1/focus)``.

    Args:
        source: an estimate by the spectral-depth camera or its file, a scene with depth, a rendered one by name, or an
            estimate of a light field.
        focal_px: of the camera, pixels; what the scene says of its camera without it, or the width of the picture.
        least_confidence: pixels below it are left out, where the depth has a confidence.
        baseline: of a light field, metres between neighbouring views.
        focus: of a light field, metres to the plane whose disparity is 0.

    Raises:
        DataError: no scene with depth, or one without any point.
        SettingError: a focal length that is not above 0, a confidence that the scene does not have, a light field
            without its baseline and focus, or another scene with them.
    """
    scene, picture = _scene(source)
    told = float(scene.attrs.get(FOCAL, 0.0))
    focal = focal_px if focal_px is not None else told if told > 0 else float(scene.sizes["x"])
    check_range("focal", focal, above=0, unit="px")
    depth = _depth(scene, focal, {"baseline": baseline, "focus": focus})
    sure = None
    if least_confidence > 0:
        if "confidence" not in scene:
            raise SettingError(
                "confidence", f"{least_confidence:g}", "none: this depth has no confidence", "leave it out"
            )
        sure = scene["confidence"].values >= least_confidence
    points, colours = points_of(depth, picture, focal, sure)
    if not len(points):
        where = str(source) if isinstance(source, str | Path) else "scene"
        raise DataError(where, "no pixel with a depth", "some", "take a lower --confidence" if sure is not None else "")
    return PointCloud(points, colours, focal, focal_px is not None or told > 0)


def _depth(scene: xr.Dataset, focal: float, of_views: Mapping[str, float | None]) -> NDArray[np.floating]:
    """(H, W) metres; of disparities of views by their geometry, infinite and beyond where they are too small."""
    if "depth" in scene:
        for name, value in of_views.items():
            if value is not None:
                raise SettingError(
                    name, f"{value:g}", "none: the scene has depth and is no light field", "leave it out"
                )
        return np.asarray(scene["depth"].values)
    for name, value in of_views.items():
        check_range(f"{name} of the light field", 0.0 if value is None else value, above=0, unit="m")
    baseline, focus = (float(value) for value in of_views.values() if value is not None)
    inverse = 1 / focus + np.asarray(scene["disparity"].values, np.float64) / (focal * baseline)
    return np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1.0), np.nan)


def _scene(source: str | Path | xr.Dataset | Estimate) -> tuple[xr.Dataset, NDArray[np.floating]]:
    """A scene with its depth, or its disparity, and its colours (y, x, 3) in [0, 1]."""
    if isinstance(source, Estimate):
        source = source.to_xarray().assign(source.maps)
    if isinstance(source, str | Path):
        if holds_rgbd(source):
            scene = read_rgbd(source)
            return scene, np.moveaxis(encoded(scene["rgb"].values), 0, -1)
        rendered = not Path(source).exists() and is_rendered(str(source))
        scene = rendered_scene(str(source)) if rendered else _with_confidence(Path(source))
    else:
        scene = source
    if {"disparity", "all_in_focus"} <= set(scene):
        shape = (3, scene.sizes["y"], scene.sizes["x"])
        sharp = np.moveaxis(np.broadcast_to(scene["all_in_focus"].values, shape), 0, -1)
        return scene, encoded(np.clip(sharp / bright_level(sharp), 0, 1))
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
