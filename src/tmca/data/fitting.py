"""Scenes brought to the bands or views, the size and the depth range of a camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.bands import at_bands, nearest_bands
from tmca.data.depth_scenes import middle_of
from tmca.data.fitted_depth import fitted_depth
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

Size = tuple[int, int]
FITTED = ("inverse_depth_scale", "inverse_depth_shift")
"""Attributes of a scene whose inverse depth was mapped: 1/Z' = scale / Z + shift."""


def fit_cube(scene: xr.DataArray, wavelengths: Sequence[float], size: Size, where: str = "scene") -> xr.DataArray:
    """The nearest bands of a cube (wavelength, y, x), the middle (H, W) of it.

    Raises:
        DataError: no cube, a smaller one, or one with fewer bands.
    """
    if "wavelength" not in getattr(scene, "dims", ()):
        raise DataError(where, "no cube (wavelength, y, x)", "a spectral scene", "read it with tmca.read")
    return _middle(nearest_bands(scene, wavelengths), {"y": size[0], "x": size[1]}, where)


def fit_views(scene: xr.DataArray, views: Size, size: Size, where: str = "scene") -> xr.DataArray:
    """The views in the middle of a light field's grid, the middle (H, W) of each.

    Raises:
        DataError: no light field, or a smaller one.
    """
    if "view_v" not in getattr(scene, "dims", ()):
        remedy = 'read it with tmca.read(…, "light-field")'
        raise DataError(where, "no views (view_v, view_u, y, x)", "a light field", remedy)
    wanted = {"view_v": views[0], "view_u": views[1], "y": size[0], "x": size[1]}
    return _middle(scene, wanted, where)


def fit_depth_scene(
    scene: xr.Dataset, wavelengths: Sequence[float], size: Size, near: float, far: float, where: str = "scene"
) -> xr.Dataset:
    """A scene of ``radiance`` and ``depth`` at these bands, the middle (H, W) of it.

    Depth that reaches beyond ``near`` to ``far``, metres, is mapped onto it, evenly in inverse depth, unless attributes
    of the scene say that it was mapped already.

    Raises:
        DataError: no such scene, a smaller one, or one with other bands.
    """
    if not {"radiance", "depth"} <= set(getattr(scene, "data_vars", ())):
        remedy = 'read it with tmca.read(…, "spectral-depth")'
        raise DataError(where, "no radiance with depth", "a scene with depth", remedy)
    cube, attrs = at_bands(scene["radiance"], wavelengths), dict(scene.attrs)
    fitted = scene.drop_dims("wavelength").assign(radiance=cube).assign_attrs(attrs)
    metres = scene["depth"].values[np.isfinite(scene["depth"].values)]
    if FITTED[0] not in attrs and metres.size and (metres.min() < near or metres.max() > far):
        fitted["depth"], mapping = fitted_depth(scene["depth"], near, far)
        fitted.attrs.update(mapping)
    return middle_of(fitted, size, where)


def _middle(scene: Any, wanted: dict[str, int], where: str) -> Any:
    """So many entries from the middle of every axis."""
    middle = {}
    for axis, count in wanted.items():
        if scene.sizes[axis] < count:
            there = "×".join(str(scene.sizes[name]) for name in wanted)
            raise DataError(where, f"{there} ({', '.join(wanted)})", f"at least {'×'.join(map(str, wanted.values()))}")
        start = (scene.sizes[axis] - count) // 2
        middle[axis] = slice(start, start + count)
    return scene.isel(middle)
