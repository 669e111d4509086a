"""What an estimate's file holds beside the scene: maps that the views of a light field show, the focal length."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data import ESTIMATED
from tmca.data.point_cloud import FOCAL, FOCAL_OF
from tmca.metrics.refocusing import has_parallax, view_geometry

if TYPE_CHECKING:
    import xarray as xr

_MAPS = {
    "disparity": {"units": "px per view step", "long_name": "disparity matched from the views, positive = nearer"},
    "confidence": {"units": "1", "long_name": "how clearly no other disparity fits, 0 to 1"},
    "all_in_focus": {"units": "1", "long_name": "centre view, mean over the views along the disparity"},
}


def focal_length(camera: Any) -> dict[str, Any]:
    """Attributes of an estimate with depth: distance from the aperture to the sensor in pixels, where it is known."""
    bench = getattr(camera, "bench", None)
    distance, pitch = getattr(bench, "distance", 0.0), getattr(bench, "pitch", 0.0)
    return {FOCAL: distance / pitch, FOCAL_OF: "bench"} if distance > 0 and pitch > 0 else {}


def view_maps(stored: xr.Dataset) -> dict[str, xr.DataArray]:
    """Disparity, its confidence and an all-in-focus image of the views in ``estimate``.

    Args:
        stored: as `Estimate.to_xarray` labels it.

    Returns:
        ``disparity`` and ``confidence`` (y, x), ``all_in_focus`` (y, x) or (colour, y, x), see
        `tmca.metrics.Geometry`; nothing of other scenes, of one view alone, of several snapshots, and of scenes that
        change.
    """
    import xarray as xr

    views: Any = stored.get("estimate")
    if views is None or tuple(views.dims)[-4:] != ("view_v", "view_u", "y", "x"):
        return {}
    if tuple(views.dims)[:-4] not in ((), ("colour",)) or not has_parallax(views.values):
        return {}
    seen = view_geometry(views.values)._asdict()
    maps = {}
    for name, about in _MAPS.items():
        dims = ("colour", "y", "x")[-seen[name].ndim :]
        coords = {dim: views.coords[dim] for dim in dims if dim in views.coords}
        marked = {**about, ESTIMATED: 1} if name == "disparity" else about
        maps[name] = xr.DataArray(seen[name].astype(np.float32), coords, dims, attrs=marked)
    return maps
