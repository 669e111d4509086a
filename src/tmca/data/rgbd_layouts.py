"""The layouts of RGB-D data sets, each loaded into picture and depth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.depth_maps import disparity_to_depth, relative_depth, stored_metres
from tmca.data.disparity import find_disparity, read_disparity
from tmca.data.formats import calibration, rgbd_files
from tmca.data.formats.calibration import Stereo
from tmca.data.formats.images import read_picture
from tmca.data.formats.rgbd_files import RgbdFiles, find_rgbd
from tmca.data.formats.views import open_views
from tmca.data.light_fields import read_light_field
from tmca.errors import DataError

BORDER = 8
"""Pixels cut on every side of a NYU picture whose frame is white: what its registration left empty, and its edge."""
ANNOTATIONS = "metric3d_annotations.json"
SHEETS = ("*dmin.txt", "calib.txt", "camera*.json", ANNOTATIONS)
"""Files beside picture and depth map that calibrate them."""
_CROPPED_TO = 32
"""Hole-filled Middlebury 2005 maps cover the centre of their picture, down to whole multiples of this."""


@dataclass(frozen=True)
class Loaded:
    """A scene as its files have it.

    Args:
        name: of the scene.
        picture: ``(H, W, 3)`` in [0, 1], sRGB-encoded.
        depth: ``(H, W)`` metres; zeros, negative and not finite values are unknown.
        about: attributes.
    """

    name: str
    picture: NDArray[np.float32]
    depth: NDArray[np.float64]
    about: dict[str, Any]


def load_rgbd(path: Path) -> Loaded:
    """The scene that a path names, whatever its layout.

    Raises:
        DataError: no such scene, several, or a missing or broken file.
    """
    files = find_rgbd(path)
    if files is not None and files.complete:
        return _READERS[files.layout.data_set](files)
    if path.is_dir() and find_disparity(path) is not None and (files is None or open_views(path) is not None):
        return _light_field(path)
    if files is not None:
        files.both()
    if path.is_file():
        raise DataError(path, "a file of no known RGB-D scene", _EXPECTED, "rename picture and depth")
    there = ", ".join(sorted(f.name for f in path.parent.iterdir())[:4]) if path.parent.is_dir() else "no such folder"
    found = "no picture with depth in it" if path.is_dir() else f"no files of this name in {path.parent} ({there})"
    raise DataError(path, found, _EXPECTED, "check the path")


_EXPECTED = "such as " + ", ".join(" with ".join(layout.names) for layout in rgbd_files.LAYOUTS[:5])


def _middlebury_2005(files: RgbdFiles) -> Loaded:
    picture, disparity = _pictures(files)
    rows, columns = (_inner(n, m) for n, m in zip(picture.shape, disparity.shape, strict=False))
    shift = files.folder / f"{files.stem}_dmin.txt" if files.stem else files.folder / "dmin.txt"
    stereo = calibration.middlebury_2005(shift if shift.is_file() else None, len(picture))
    return _stereo(files, picture[rows, columns], np.where(disparity == 0, np.nan, disparity), stereo)


def _inner(whole: int, part: int) -> slice:
    """Where a hole-filled map lies in its picture along one axis; all of it for any other size."""
    start = (whole - part) // 2
    return slice(start, start + part) if part == whole // _CROPPED_TO * _CROPPED_TO else slice(None)


def _middlebury_2014(files: RgbdFiles) -> Loaded:
    picture, depth = files.both()
    stereo = calibration.middlebury_2014(files.folder / "calib.txt")
    return _stereo(files, _encoded(picture), read_picture(depth), stereo)


def _skimage(files: RgbdFiles) -> Loaded:
    picture, depth = files.both()
    pixels, sheet = _encoded(picture), files.folder / "calib.txt"
    if sheet.is_file():
        stereo = calibration.middlebury_2014(sheet)
    else:
        stereo = calibration.motorcycle(pixels.shape[1]) if files.stem == "motorcycle" else Stereo()
    return _stereo(files, pixels, _only_array(depth), stereo)


def _nyuv2(files: RgbdFiles) -> Loaded:
    picture, depth = files.both()
    sheet = files.folder / ANNOTATIONS
    known = calibration.annotated(sheet, picture.name) if sheet.is_file() else None
    focal, units = known or (calibration.NYUV2_FOCAL_PX, 1000.0)
    pixels, metres = _encoded(picture), stored_metres(depth, 1 / units)[0]
    if pixels.shape[:2] == metres.shape and _white_frame(pixels):
        inside = slice(BORDER, -BORDER)
        pixels, metres = pixels[inside, inside], metres[inside, inside]
    return _ranged(files, pixels, metres, focal)


def _white_frame(pixels: NDArray[np.float32]) -> bool:
    frame = np.concatenate([pixels[:3].ravel(), pixels[-3:].ravel(), pixels[:, :3].ravel(), pixels[:, -3:].ravel()])
    return min(pixels.shape[:2]) > 4 * BORDER and bool(np.mean(frame > 0.9) > 0.99)


def _open3d(files: RgbdFiles) -> Loaded:
    picture, depth = files.both()
    cameras = sorted(files.folder.glob("camera*.json"))
    focal = calibration.open3d_focal(cameras[0]) if cameras else None
    return _ranged(files, _encoded(picture), stored_metres(depth, 1e-3)[0], focal)


def _light_field(folder: Path) -> Loaded:
    """Centre view and true disparity; metric where the benchmark's ``parameters.cfg`` is there."""
    view = read_light_field(folder, views=1, colour=True)
    disparity, stereo = read_disparity(folder).values, Stereo()
    if "focus_distance_m" in view.attrs:
        of = view.attrs
        focal = of["focal_length_m"] / of["sensor_size_m"] * max(disparity.shape)
        stereo = Stereo(focal, of["baseline_m"], focal * of["baseline_m"] / of["focus_distance_m"])
    pixels = np.moveaxis(view.values[:, 0, 0], 0, -1)
    depth, about = _metres(disparity, stereo)
    return Loaded(folder.name, pixels, depth, {"format": "light field", **about})


_READERS: dict[str, Callable[[RgbdFiles], Loaded]] = {
    rgbd_files.MIDDLEBURY_2005: _middlebury_2005,
    rgbd_files.MIDDLEBURY_2014: _middlebury_2014,
    rgbd_files.SKIMAGE: _skimage,
    rgbd_files.NYUV2: _nyuv2,
    rgbd_files.OPEN3D: _open3d,
}


def _stereo(files: RgbdFiles, picture: NDArray[np.float32], disparity: NDArray[Any], stereo: Stereo) -> Loaded:
    depth, about = _metres(disparity, stereo)
    return Loaded(files.name, picture, depth, {"format": files.layout.data_set, **about})


def _metres(disparity: NDArray[Any], stereo: Stereo) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Depth and what it was made with."""
    if disparity.ndim != 2:
        raise DataError("disparity", f"shape {disparity.shape}", "(y, x)")
    if stereo.focal_px is None or stereo.baseline_m is None:
        about = {"metric": False, "depth_from": "disparity without calibration: inverse depth from 1/(2 m) to 1/(1 m)"}
        return relative_depth(disparity), about
    formula = "disparity, Z = f B / (d + offset)"
    offset = 0.0 if stereo.offset_px is None else stereo.offset_px
    about = {
        "metric": stereo.metric,
        "depth_from": formula if stereo.metric else f"{formula} with an unknown offset taken as 0",
        "focal_px": stereo.focal_px,
        "baseline_m": stereo.baseline_m,
        "offset_px": offset,
    }
    return disparity_to_depth(disparity, stereo.focal_px, stereo.baseline_m, offset), about


def _ranged(files: RgbdFiles, picture: NDArray[np.float32], depth: NDArray[np.float64], focal: float | None) -> Loaded:
    about = {"format": files.layout.data_set, "metric": True, "depth_from": "range sensor"}
    return Loaded(files.name, picture, depth, about | ({} if focal is None else {"focal_px": focal}))


def _pictures(files: RgbdFiles) -> tuple[NDArray[np.float32], NDArray[Any]]:
    """Picture and disparities of a pair of pictures."""
    picture, depth = files.both()
    disparity = read_picture(depth)
    if disparity.ndim != 2:
        raise DataError(depth, f"a picture of shape {disparity.shape}", "grey disparities (y, x)")
    return _encoded(picture), disparity


def _encoded(file: Path) -> NDArray[np.float32]:
    """``(H, W, 3)`` in [0, 1] as stored; an alpha channel is dropped."""
    pixels = read_picture(file)
    if pixels.ndim != 3 or pixels.shape[2] < 3 or pixels.dtype.kind != "u":
        raise DataError(file, f"a picture of shape {pixels.shape} and type {pixels.dtype}", "red, green and blue")
    return pixels[..., :3].astype(np.float32) / np.float32(np.iinfo(pixels.dtype).max)


def _only_array(file: Path) -> NDArray[Any]:
    """The one array of a ``.npz``."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            if len(arrays.files) != 1:
                raise DataError(file, f"{len(arrays.files)} arrays", "one: the disparities")
            return np.asarray(arrays[arrays.files[0]])
    except (ValueError, OSError, EOFError) as error:
        raise DataError(file, f"an unreadable or truncated .npz file ({error})", "one array of disparities") from error
