"""Scenes with depth as clouds of points in their colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from tmca.applications.refocusing import all_in_focus
from tmca.arguments import described
from tmca.data import holds_rgbd, read_dataset, read_rgbd, read_spectral_depth
from tmca.data.fitting import unmapped_depth
from tmca.data.formats.opening import is_zarr, open_contents
from tmca.data.formats.views import open_views
from tmca.data.in_memory import SceneWarning
from tmca.data.light_fields import find_light_field
from tmca.data.pixels import encoded
from tmca.data.point_cloud import FOCAL, FOCAL_OF, points_of, write_ply
from tmca.data.rendering import is_rendered, rendered_scene
from tmca.data.spectral_depth import scene_parts
from tmca.decoders import Estimate
from tmca.errors import DataError, SettingError, check_range
from tmca.plots.cube import rgb_composite
from tmca.plots.style import bright_level
from tmca.summaries import Summary

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


AXES = "points in metres, camera at the origin, x to the right, y up, the scene at negative z"
"""Of the head of a file."""
_DOTS = 20_000
"""Points that are drawn."""
_FAR = 100
"""Times the distance in focus: what is farther is warned of."""


@dataclass(frozen=True, repr=False)
class PointCloud(Summary):
    """Points in metres, x to the right, y up, the camera at the origin and looking along -z: what is in front of it has
    a negative z.

    Args:
        points: ``(N, 3)``.
        colours: ``(N, 3)``.
        focal_px: of the pinhole, pixels.
        known: whether that is the camera's own; else it is as long as the picture is wide.
        pixels: of the scene.
        origin: where the focal length comes from, in words.
        left_out: why pixels are no points, and how many.
    """

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]
    focal_px: float
    known: bool
    pixels: int = 0
    origin: str = ""
    left_out: Mapping[str, int] = field(default_factory=dict)

    @property
    def said(self) -> str:
        """How many pixels are points and why others are none, in words."""
        return f"{len(self.points)} points of {self._pixels_said}"

    @property
    def _pixels_said(self) -> str:
        why = ", ".join(f"{count} {reason}" for reason, count in self.left_out.items() if count)
        return f"{self.pixels} pixels" + (f" (left out: {why})" if why else "")

    @property
    def distance(self) -> tuple[float, float]:
        """Metres along the optical axis to the nearest point and to the farthest."""
        return float(-self.points[:, 2].max()), float(-self.points[:, 2].min())

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a PLY file, which MeshLab, CloudCompare and Blender open.

        Raises:
            OutputError: another suffix than ``.ply``, the file exists, or it cannot be written.
        """
        about = f"{AXES}; pinhole camera, focal length {self.focal_px:g} pixels{self.origin}"
        return write_ply(self.points, self.colours, path, comment=about, overwrite=overwrite)

    def plot(self) -> Figure:
        """The points from the side, in their colours; of many every n-th."""
        from tmca.plots.depth import points_figure

        step = -(-len(self.points) // _DOTS)
        return points_figure(self.points[::step], self.colours[::step])

    def _facts(self) -> dict[str, str]:
        near, far = self.distance
        return {
            "points": f"{len(self.points)} of {self._pixels_said}" if self.pixels else str(len(self.points)),
            "distance": f"{near:.3g} to {far:.3g} m",
            "focal length": f"{self.focal_px:g} px{self.origin}",
        }

    def _picture(self) -> Figure:
        return self.plot()


def point_cloud(
    source: str | Path | xr.Dataset | xr.DataArray | Estimate,
    focal_px: float | None = None,
    least_confidence: float = 0.0,
    *,
    baseline: float | None = None,
    focus: float | None = None,
) -> PointCloud:
    """The points that the pixels of a scene with depth show.

    Depth that was mapped onto the range of a camera is mapped back to the metres of the scene, as far as its attributes
    tell. A light field has disparities d in the place of depths z. Of views a ``baseline`` apart that are focused at a
    distance, ``d = focal_px · baseline · (1/z − 1/focus)``.

    Args:
        source: a scene with depth or a light field: an estimate or its file, what `tmca.read` gives, another file, or a
            rendered one by name, such as ``motorcycle`` or ``coffee:1``.
        focal_px: of the camera, pixels. Without it: what the scene says of its camera, else the width of the picture;
            a light field needs it.
        least_confidence: pixels below it are left out, where the depth has a confidence.
        baseline: of a light field, metres between neighbouring views.
        focus: of a light field, metres to the plane whose disparity is 0.

    Raises:
        DataError: no scene with depth, or one without any point.
        SettingError: a focal length that is not above 0, a confidence that the scene does not have, a light field
            without its focal length, baseline and focus, or another scene with these two.

    Warns:
        SceneWarning: points of a light field that are more than a hundred times as far away as the plane in focus.
    """
    of_views = {"baseline": baseline, "focus": focus}
    scene, picture = _scene(source, {"focal": focal_px, **of_views})
    focal, known, origin = _focal(scene, focal_px)
    check_range("focal", focal, above=0, unit="px")
    if "depth" not in scene:
        _check_given({"focal": focal if known else None, **of_views})
    depth = _depth(scene, focal, of_views)
    there = np.isfinite(depth) & (depth > 0)
    sure = _sure(scene, least_confidence)
    points, colours = points_of(depth, picture, focal, sure)
    if not len(points):
        where = str(source) if isinstance(source, str | Path) else "scene"
        raise DataError(where, "no pixel with a depth", "some", "take a lower --confidence" if sure is not None else "")
    why = "without depth" if "depth" in scene else "with a disparity beyond infinity"
    left_out = {why: int(np.sum(~there)), "below the confidence": 0 if sure is None else int(np.sum(there & ~sure))}
    cloud = PointCloud(points, colours, focal, known, depth.size, origin, left_out)
    if focus is not None:
        _warn_of_far(cloud, _FAR * focus)
    return cloud


def _sure(scene: xr.Dataset, least: float) -> NDArray[np.bool_] | None:
    """(H, W) where the depth has this confidence; None where none is asked for."""
    if not least > 0:
        return None
    if "confidence" not in scene:
        raise SettingError("confidence", f"{least:g}", "none: this depth has no confidence", "leave it out")
    return np.asarray(scene["confidence"].values >= least)


def _warn_of_far(cloud: PointCloud, limit: float) -> None:
    """Warn of points so far away that an error of the disparity alone may have put them there."""
    far = int(np.sum(-cloud.points[:, 2] > limit))
    if far:
        where = f"beyond {limit:g} m, {_FAR} times the focus: their disparity is nearly that of infinity"
        warn(f"{far} of {len(cloud.points)} points lie {where}", SceneWarning, 3)


def _focal(scene: xr.Dataset, given: float | None) -> tuple[float, bool, str]:
    """Focal length in pixels, whether it is that of a camera, and where it comes from."""
    stored = float(scene.attrs.get(FOCAL, 0.0))
    if given is not None:
        return given, True, ""
    if stored > 0:
        of_bench = scene.attrs.get(FOCAL_OF) == "bench"
        return (
            stored,
            True,
            ", that of the bench; a simulated scene has its own (--focal, focal_px=)" if of_bench else "",
        )
    return float(scene.sizes["x"]), False, ", the width of the picture, as none is known (--focal, focal_px=)"


def _check_given(geometry: Mapping[str, float | None]) -> None:
    """Raises SettingError unless all of the geometry of a light field is given."""
    missing = [name for name, value in geometry.items() if value is None]
    if missing:
        options, names = (", ".join(f"{mark}{name}" for name in missing) for mark in ("--", ""))
        names = names.replace("focal", "focal_px")
        expected = "what turns the disparity of the light field into metres"
        raise SettingError(missing[0], f"no {names}", expected, f"give {names} ({options})")


def _depth(scene: xr.Dataset, focal: float, of_views: Mapping[str, float | None]) -> NDArray[np.floating]:
    """(H, W) metres of the scene, not those that it was mapped onto; of disparities of views by their geometry,
    infinite and beyond where they are too small."""
    if "depth" in scene:
        for name, value in of_views.items():
            if value is not None:
                raise SettingError(
                    name, f"{value:g}", "none: the scene has depth and is no light field", "leave it out"
                )
        return unmapped_depth(scene["depth"].values, scene.attrs)
    for name, value in of_views.items():
        check_range(f"{name} of the light field", 0.0 if value is None else value, above=0, unit="m")
    baseline, focus = (float(value) for value in of_views.values() if value is not None)
    inverse = 1 / focus + np.asarray(scene["disparity"].values, np.float64) / (focal * baseline)
    return np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1.0), np.nan)


def _has_maps(names: Iterable[Any]) -> bool:
    """Whether a light field comes with the maps that its views show."""
    return {"disparity", "all_in_focus"} <= set(names)


def _maps(views: Any, geometry: Mapping[str, float | None]) -> xr.Dataset:
    """Maps of the views of a light field, which take a while, once its geometry is seen to be given."""
    _check_given(geometry)
    return all_in_focus(views)


def _scene(source: Any, geometry: Mapping[str, float | None]) -> tuple[xr.Dataset, NDArray[np.floating]]:
    """A scene with its depth, or its disparity, and its colours (y, x, 3) in [0, 1]."""
    if isinstance(source, Estimate):
        source = source.to_xarray().assign(source.maps)
    if isinstance(source, str | Path) and holds_rgbd(source):
        scene = read_rgbd(source)
        return scene, np.moveaxis(encoded(scene["rgb"].values), 0, -1)
    scene = _read(source, geometry) if isinstance(source, str | Path) else _in_memory(source, geometry)
    if _has_maps(scene):
        shape = (3, scene.sizes["y"], scene.sizes["x"])
        sharp = np.moveaxis(np.broadcast_to(scene["all_in_focus"].values, shape), 0, -1)
        return scene, encoded(np.clip(sharp / bright_level(sharp), 0, 1))
    if not {"radiance", "depth"} <= set(scene):
        raise DataError("scene", ", ".join(map(str, scene)) or "nothing", "radiance and depth, or a light field")
    cube = scene["radiance"]
    return scene, rgb_composite(cube.values, cube["wavelength"].values.tolist())


def _in_memory(scene: Any, geometry: Mapping[str, float | None]) -> xr.Dataset:
    """A dataset of depth, or the maps of the views of a light field."""
    if not hasattr(scene, "dims"):
        raise DataError("scene", described(scene), "radiance and depth, or a light field, as tmca.read gives it")
    held = getattr(scene, "data_vars", {"": scene})
    if not _has_maps(held) and any("view_v" in one.dims for one in held.values()):
        return _maps(scene, geometry)
    if not hasattr(scene, "data_vars"):
        found = f"an array by {', '.join(map(str, scene.dims))}"
        raise DataError("scene", found, "radiance and depth, or a light field")
    dataset: xr.Dataset = scene
    return dataset


def _read(source: str | Path, geometry: Mapping[str, float | None]) -> xr.Dataset:
    """A scene with depth, or the maps of the views of a light field, from files or rendered."""
    path = Path(source)
    if not path.exists():
        name, _, number = str(source).partition(":")
        if number and is_rendered(name):
            return _maps(source, geometry)
        return rendered_scene(str(source)) if is_rendered(str(source)) else _with_confidence(path)
    if path.is_dir() and not is_zarr(path):
        views = scene_parts(path) is None and open_views(path)
        return _maps(path, geometry) if views else _with_confidence(path)
    with open_contents(path) as contents:
        maps, stored = _has_maps(contents.arrays), find_light_field(contents)
    if stored is None:
        return _with_confidence(path)
    return read_dataset(path) if maps else _maps(path, geometry)


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
