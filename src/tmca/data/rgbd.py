"""`read_rgbd`: pictures with measured depth, from the public data sets' files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.data.depth_maps import label_depth
from tmca.data.formats.arrays import QUANTITY
from tmca.data.formats.rgbd_files import find_rgbd
from tmca.data.light_fields import COLOURS, centre_window
from tmca.data.rendering.resample import area_average, nearest
from tmca.data.rgbd_layouts import SHEETS, load_rgbd
from tmca.data.srgb import decoded
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr


def read_rgbd(path: str | Path, *, crop: tuple[int, int] | None = None, scale: int | None = None) -> xr.Dataset:
    """Read a picture with its depth.

    Reads Middlebury 2005 (``<scene>_rgb.png`` with hole-filled ``<scene>_disp.png``, which covers its centre; the
    original ``view1.png``, ``disp1.png``, ``dmin.txt``), Middlebury 2014 (``im0.png``, ``disp0.pfm``, ``calib.txt``;
    scikit-image's ``motorcycle``), NYU Depth v2 (``rgb_*.jpg`` without its white border, ``sync_depth_*.png``), Open3D
    (``*color_*.jpg``, ``*depth_*.png``, ``camera*.json``), and HCI light fields (centre view and true disparity).

    Args:
        path: the scene's folder, either of its files, or folder and stem: ``middlebury/art``, ``nyuv2/00050``.
        crop: centre (H, W) in pixels of the result, after ``scale``.
        scale: whole number of pixels per axis that are averaged into one (depth is sampled, so that no two sides of an
            edge are mixed).

    Returns:
        A dataset of float32 variables ``rgb`` ``(colour, y, x)``, linear relative irradiance in [0, 1]: the stored
        values through the sRGB curve (IEC 61966-2-1); and ``depth`` ``(y, x)``, metres, NaN where unknown, with the
        counts of `tmca.data.read_depth_map`. Attributes: ``name``, ``source``, ``format``, ``encoding``,
        ``depth_from``; ``focal_px`` (at the stored size), ``baseline_m`` and ``offset_px`` as far as they are known;
        and ``metric``: False where depth is right only up to an affine map of inverse depth, since the files leave out
        its offset or all calibration.

    Raises:
        DataError: no such scene, several, a missing or broken file, sizes that differ, no known depth.
        SettingError: an impossible crop or scale.
    """
    import xarray as xr

    path = Path(path)
    loaded = load_rgbd(path)
    if loaded.picture.shape[:2] != loaded.depth.shape:
        sizes = (f"{shape[0]}×{shape[1]}" for shape in (loaded.depth.shape, loaded.picture.shape))
        depth_size, picture_size = sizes
        raise DataError(path, f"a depth map of {depth_size} pixels", f"{picture_size} as its picture has")
    height, width = loaded.depth.shape
    window = centre_window((height, width), crop, scale, path)
    linear = np.moveaxis(decoded(loaded.picture[window]), -1, 0)
    values = loaded.depth[window].astype(np.float32)
    if scale is not None:
        size = values.shape[0] // scale, values.shape[1] // scale
        linear, values = area_average(linear, size).clip(0, 1), nearest(values, size)
    about = {"name": loaded.name, "source": str(path), **loaded.about, "encoding": "linear, decoded from sRGB"}
    units = {"quantity": QUANTITY, "units": "1", "long_name": f"linear sRGB, {QUANTITY}"}
    rgb = xr.DataArray(np.ascontiguousarray(linear), dims=("colour", "y", "x"), attrs=units)
    variables = {"rgb": rgb, "depth": label_depth(values, path)}
    return xr.Dataset(variables, {"colour": ("colour", list(COLOURS))}, about)


def rgbd_sources(path: str | Path) -> list[Path]:
    """The files that `read_rgbd` takes for a scene: picture, depth map, and the calibrations in their folder.

    Nothing where a path names no picture with its depth, or several; a light field's are its folder's.
    """
    try:
        files = find_rgbd(path)
    except DataError:
        return []
    if files is None or files.picture is None or files.depth is None:
        return []
    sheets = {sheet for pattern in SHEETS for sheet in files.folder.glob(pattern) if sheet.is_file()}
    return [files.picture, files.depth, *sorted(sheets)]


def holds_rgbd(path: str | Path) -> bool:
    """Whether a path names a picture with depth, be it that one of them is missing (light fields apart)."""
    try:
        files = find_rgbd(path)
    except DataError:
        return True
    return files is not None and (files.complete or not Path(path).exists())


def refuse_rgbd(path: str | Path) -> None:
    """Raises DataError if it is an RGB-D scene and no spectral one."""
    if holds_rgbd(path):
        remedy = "make up its spectra with read_spectral_depth(…, from_rgb=True) or spectral_from_rgb of tmca.data"
        raise DataError(path, "an RGB picture with depth", "a spectral scene", remedy)
