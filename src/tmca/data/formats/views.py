"""A folder with one picture per view as one array, loaded view by view."""

from __future__ import annotations

from configparser import ConfigParser
from configparser import Error as ConfigError
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.images import picture_size, read_picture
from tmca.data.formats.stored import Contents, Index, Stored
from tmca.data.formats.view_names import Place, ViewFiles, find_views
from tmca.errors import DataError

DIMS = ("view_v", "view_u", "y", "x")
PARAMETERS = "parameters.cfg"
NEEDED = {
    "intrinsics": ("image_resolution_x_px", "image_resolution_y_px", "focal_length_mm", "sensor_size_mm"),
    "extrinsics": ("num_cams_x", "num_cams_y", "baseline_mm", "focus_distance_m"),
}
"""What a ``parameters.cfg`` of the HCI benchmark must state."""
_MOST_A_SIDE = 999


def open_views(folder: Path, pattern: str | None = None) -> Contents | None:
    """The views in a folder as one array ``(view_v, view_u, y, x[, channel])``; None where none are recognised.

    Args:
        folder: with one picture per view; that of the HCI benchmark may hold a ``parameters.cfg``.
        pattern: of the names, see `find_views`.

    Raises:
        DataError: missing, extra, broken or unequal views, or a ``parameters.cfg`` that does not fit them.
    """
    about = read_parameters(folder / PARAMETERS) if (folder / PARAMETERS).is_file() else {}
    side: Place | None = (int(about["num_cams_y"]), int(about["num_cams_x"])) if about else None
    views = find_views(folder, pattern, side)
    if views is None:
        return None
    if side is not None and views.shape != side:
        raise DataError(folder, f"{views.shape[0]}×{views.shape[1]} views", f"{side[0]}×{side[1]} as {PARAMETERS} says")
    size = _size(views)
    stated = (about.get("image_resolution_y_px"), about.get("image_resolution_x_px"))
    if about and stated != size:
        raise DataError(
            folder / PARAMETERS, f"{stated[1]:g}×{stated[0]:g} px", f"{size[1]}×{size[0]} px as the views have"
        )
    stored = _stored(folder, views, size)
    return Contents(folder, "folder of views", {stored.name: stored}, attrs={"pattern": views.naming, **_si(about)})


def _size(views: ViewFiles) -> Place:
    """Height and width that all views share."""
    sizes = [picture_size(file) for file in views.files]
    usual = max(set(sizes), key=sizes.count)
    for file, size in zip(views.files, sizes, strict=True):
        if size != usual:
            found, expected = (f"{h}×{w} pixels (height × width)" for h, w in (size, usual))
            raise DataError(file, found, f"{expected} as most views have", "crop or replace it")
    return usual


def _stored(folder: Path, views: ViewFiles, size: Place) -> Stored:
    first, numbers = read_picture(views.files[0]), np.arange(len(views.files)).reshape(views.shape)
    channels = first.shape[2:]

    def load(index: Index) -> NDArray[Any]:
        chosen = numbers[index[:2]]
        pixels = [_like(first, views.files[number])[index[2:]] for number in np.ravel(chosen)]
        return np.stack(pixels).reshape(*np.shape(chosen), *pixels[0].shape)

    dims = (*DIMS, *("channel" for _ in channels))
    return Stored(folder.name or "light_field", (*views.shape, *size, *channels), first.dtype, load, dims)


def _like(first: NDArray[Any], file: Path) -> NDArray[Any]:
    pixels = read_picture(file)
    if pixels.shape != first.shape or pixels.dtype != first.dtype:
        raise DataError(file, f"{pixels.shape} {pixels.dtype}", f"{first.shape} {first.dtype} as in the first view")
    return pixels


def read_parameters(path: Path) -> dict[str, float]:
    """The numbers of a ``parameters.cfg``, of all its sections; `NEEDED` ones are all there.

    Raises:
        DataError: unreadable, without a needed key, or with an impossible number of views.
    """
    parser = ConfigParser()
    try:
        parser.read_string(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ConfigError) as error:
        raise DataError(path, f"an unreadable file ({error})", "a parameters.cfg of the HCI benchmark") from error
    numbers = {
        key: number for s in parser.sections() for key, v in parser.items(s) if (number := _number(v)) is not None
    }
    gone = [f"[{s}] {key}" for s, keys in NEEDED.items() for key in keys if key not in numbers]
    remedy = "fetch it again, or take it away to go by the pictures alone"
    if gone:
        raise DataError(path, f"no number for {', '.join(gone)}", "the keys of the HCI benchmark", remedy)
    for name in ("num_cams_x", "num_cams_y"):
        if not (numbers[name].is_integer() and 1 <= numbers[name] <= _MOST_A_SIDE):
            wanted = f"a whole number of views from 1 to {_MOST_A_SIDE}"
            raise DataError(path, f"{name} = {numbers[name]:g}", wanted, remedy)
    return numbers


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _si(about: dict[str, float]) -> dict[str, float]:
    """The geometry in metres and pixels, under names of ours."""
    metres = {
        "baseline_m": ("baseline_mm", 1e-3),
        "focal_length_m": ("focal_length_mm", 1e-3),
        "sensor_size_m": ("sensor_size_mm", 1e-3),
        "focus_distance_m": ("focus_distance_m", 1.0),
    }
    return {ours: about[key] * unit for ours, (key, unit) in metres.items() if key in about}
