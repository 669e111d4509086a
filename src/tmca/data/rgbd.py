"""`read_rgbd`: pictures with measured depth, from the public data sets' files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tmca.data.axes import colour_axis
from tmca.data.depth_maps import disparity_to_depth, label_depth, relative_depth, stored_metres
from tmca.data.fitting import centre_window
from tmca.data.formats import rgbd_files
from tmca.data.formats.arrays import IRRADIANCE, QUANTITY
from tmca.data.formats.images import read_picture
from tmca.data.formats.opening import read_array
from tmca.data.formats.rgbd_files import RgbdFiles, Stereo, find_rgbd
from tmca.data.formats.views import open_views
from tmca.data.light_fields import find_disparity, read_disparity, read_light_field
from tmca.data.pixels import area_average, decoded, nearest, wrong_size
from tmca.data.point_cloud import scaled_lengths
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
        ``depth_from``; ``focal_px``, ``baseline_m`` and ``offset_px`` as known, in pixels of the result; and
        ``metric``: False where depth is right only up to an affine map of inverse depth, since the files leave out
        its offset or all calibration.

    Raises:
        DataError: no such scene, several, a missing or broken file, sizes that differ, no known depth.
        SettingError: an impossible crop or scale.
    """
    import xarray as xr

    path = Path(path)
    loaded = load_rgbd(path)
    if loaded.picture.shape[:2] != loaded.depth.shape:
        raise wrong_size(path, "a depth map", loaded.depth.shape, loaded.picture.shape[:2], "its picture has")
    height, width = loaded.depth.shape
    window = centre_window((height, width), crop, scale, path)
    linear = np.moveaxis(decoded(loaded.picture[window]), -1, 0)
    values = loaded.depth[window].astype(np.float32)
    if scale is not None:
        size = values.shape[0] // scale, values.shape[1] // scale
        linear, values = area_average(linear, size).clip(0, 1), nearest(values, size)
    scaled = scaled_lengths(loaded.about, scale)
    about = {"name": scaled["name"], "source": str(path), **scaled, "encoding": "linear, decoded from sRGB"}
    units = {**IRRADIANCE, "long_name": f"linear sRGB, {QUANTITY}"}
    rgb = xr.DataArray(np.ascontiguousarray(linear), dims=("colour", "y", "x"), attrs=units)
    variables = {"rgb": rgb, "depth": label_depth(values, path)}
    return xr.Dataset(variables, {"colour": colour_axis()}, about)


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


BORDER = 8
"""Pixels cut on every side of a NYU picture whose frame is white: what its registration left empty, and its edge."""
ANNOTATIONS = "metric3d_annotations.json"
SHEETS = ("*dmin.txt", "calib.txt", "camera*.json", ANNOTATIONS)
"""Files beside picture and depth map that calibrate them."""
_CROPPED_TO = 32
"""Hole-filled Middlebury 2005 maps cover the centre of their picture, down to whole multiples of this."""
_EXPECTED = "such as " + ", ".join(
    f"{layout.name_of('picture')} with {layout.name_of('depth')}" for layout in rgbd_files.LAYOUTS[:5]
)


class Loaded(NamedTuple):
    """A scene as its files have it.

    Args:
        picture: ``(H, W, 3)`` in [0, 1], sRGB-encoded.
        depth: ``(H, W)`` metres; zeros, negative and not finite values are unknown.
        about: attributes.
    """

    picture: NDArray[np.float32]
    depth: NDArray[np.float64]
    about: dict[str, Any]


def load_rgbd(path: Path) -> Loaded:
    """The scene that a path names, whatever its layout.

    Raises:
        DataError: no such scene, several, or a missing or broken file.
    """
    files = find_rgbd(path)
    light_field = path.is_dir() and find_disparity(path) is not None
    if light_field and not (files and files.complete) and (files is None or open_views(path) is not None):
        loaded = _light_field(path)
        return loaded._replace(about={"name": path.name, "format": "light field", **loaded.about})
    if files is not None:
        loaded = _READERS[files.layout.data_set](files, *files.both())
        return loaded._replace(about={"name": files.name, "format": files.layout.data_set, **loaded.about})
    if path.is_file():
        raise DataError(path, "a file of no known RGB-D scene", _EXPECTED, "rename picture and depth")
    there = ", ".join(sorted(f.name for f in path.parent.iterdir())[:4]) if path.parent.is_dir() else "no such folder"
    found = "no picture with depth in it" if path.is_dir() else f"no files of this name in {path.parent} ({there})"
    raise DataError(path, found, _EXPECTED, "check the path")


def _middlebury_2005(files: RgbdFiles, picture: Path, depth: Path) -> Loaded:
    pixels, disparity = _encoded(picture), read_picture(depth)
    if disparity.ndim != 2:
        raise DataError(depth, f"a picture of shape {disparity.shape}", "grey disparities (y, x)")
    rows, columns = (_inner(n, m) for n, m in zip(pixels.shape, disparity.shape, strict=False))
    shift = files.folder / f"{files.stem}_dmin.txt" if files.stem else files.folder / "dmin.txt"
    stereo = rgbd_files.middlebury_2005(shift if shift.is_file() else None, len(pixels))
    return _stereo(pixels[rows, columns], np.where(disparity == 0, np.nan, disparity), stereo)


def _inner(whole: int, part: int) -> slice:
    """Where a hole-filled map lies in its picture along one axis; all of it for any other size."""
    start = (whole - part) // 2
    return slice(start, start + part) if part == whole // _CROPPED_TO * _CROPPED_TO else slice(None)


def _middlebury_2014(files: RgbdFiles, picture: Path, depth: Path) -> Loaded:
    """Also scikit-image's copies, which may lack their calibration."""
    pixels, sheet, stereo = _encoded(picture), files.folder / "calib.txt", Stereo()
    if sheet.is_file() or files.layout.data_set == rgbd_files.MIDDLEBURY_2014:
        stereo = rgbd_files.middlebury_2014(sheet)
    elif files.stem == "motorcycle":
        stereo = rgbd_files.motorcycle(pixels.shape[1])
    return _stereo(pixels, read_array(depth), stereo)


def _nyuv2(files: RgbdFiles, picture: Path, depth: Path) -> Loaded:
    sheet = files.folder / ANNOTATIONS
    calibration = rgbd_files.annotated(sheet, picture.name) if sheet.is_file() else None
    focal, units = calibration or (rgbd_files.NYUV2_FOCAL_PX, 1000.0)
    pixels, metres = _encoded(picture), stored_metres(depth, 1 / units)[0]
    if pixels.shape[:2] == metres.shape and _white_frame(pixels):
        inside = slice(BORDER, -BORDER)
        pixels, metres = pixels[inside, inside], metres[inside, inside]
    return _ranged(pixels, metres, focal)


def _white_frame(pixels: NDArray[np.float32]) -> bool:
    frame = np.concatenate([pixels[:3].ravel(), pixels[-3:].ravel(), pixels[:, :3].ravel(), pixels[:, -3:].ravel()])
    return min(pixels.shape[:2]) > 4 * BORDER and bool(np.mean(frame > 0.9) > 0.99)


def _open3d(files: RgbdFiles, picture: Path, depth: Path) -> Loaded:
    cameras = sorted(files.folder.glob("camera*.json"))
    focal = rgbd_files.open3d_focal(cameras[0]) if cameras else None
    return _ranged(_encoded(picture), stored_metres(depth, 1e-3)[0], focal)


def _light_field(folder: Path) -> Loaded:
    """Centre view and true disparity; metric where the benchmark's ``parameters.cfg`` is there."""
    view = read_light_field(folder, views=1, colour=True)
    disparity, stereo = read_disparity(folder).values, Stereo()
    if "focus_distance_m" in view.attrs:
        of = view.attrs
        focal = of["focal_length_m"] / of["sensor_size_m"] * max(disparity.shape)
        stereo = Stereo(focal, of["baseline_m"], focal * of["baseline_m"] / of["focus_distance_m"])
    return _stereo(np.moveaxis(view.values[:, 0, 0], 0, -1), disparity, stereo)


_READERS: dict[str, Callable[[RgbdFiles, Path, Path], Loaded]] = {
    rgbd_files.MIDDLEBURY_2005: _middlebury_2005,
    rgbd_files.MIDDLEBURY_2014: _middlebury_2014,
    rgbd_files.SKIMAGE: _middlebury_2014,
    rgbd_files.NYUV2: _nyuv2,
    rgbd_files.OPEN3D: _open3d,
}


def _stereo(picture: NDArray[np.float32], disparity: NDArray[Any], stereo: Stereo) -> Loaded:
    """A picture whose depth is that of its disparity."""
    if disparity.ndim != 2:
        raise DataError("disparity", f"shape {disparity.shape}", "(y, x)")
    focal, baseline, offset = stereo.focal_px, stereo.baseline_m, stereo.offset_px or 0.0
    if focal is None or baseline is None:
        origin = "disparity without calibration: inverse depth from 1/(2 m) to 1/(1 m)"
        return Loaded(picture, relative_depth(disparity), {"metric": False, "depth_from": origin})
    origin = "disparity, Z = f B / (d + offset)" + ("" if stereo.metric else " with an unknown offset taken as 0")
    about = {"metric": stereo.metric, "depth_from": origin, "focal_px": focal, "baseline_m": baseline}
    depth = disparity_to_depth(disparity, focal, baseline, offset)
    return Loaded(picture, depth, {**about, "offset_px": offset})


def _ranged(picture: NDArray[np.float32], depth: NDArray[np.float64], focal: float | None) -> Loaded:
    about: dict[str, Any] = {"metric": True, "depth_from": "range sensor"}
    return Loaded(picture, depth, about | ({} if focal is None else {"focal_px": focal}))


def _encoded(file: Path) -> NDArray[np.float32]:
    """``(H, W, 3)`` in [0, 1] as stored; an alpha channel is dropped."""
    pixels = read_picture(file)
    if pixels.ndim != 3 or pixels.shape[2] < 3 or pixels.dtype.kind != "u":
        raise DataError(file, f"a picture of shape {pixels.shape} and type {pixels.dtype}", "red, green and blue")
    return pixels[..., :3].astype(np.float32) / np.float32(np.iinfo(pixels.dtype).max)
