"""Light fields as one array: a folder with one picture per view, loaded view by view, and lenslet pictures."""

from __future__ import annotations

from configparser import ConfigParser
from contextlib import suppress
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.images import PICTURES, open_picture, picture_size, read_picture, stack_pictures
from tmca.data.formats.stored import Contents, Index, Stored, reads, whole_file
from tmca.data.formats.view_names import Place, ViewFiles, find_views
from tmca.data.pixels import wrong_size
from tmca.errors import DataError, SettingError
from tmca.text_files import read_text

DIMS = ("view_v", "view_u", "y", "x")
PARAMETERS = "parameters.cfg"
NEEDED = {
    "intrinsics": ("image_resolution_x_px", "image_resolution_y_px", "focal_length_mm", "sensor_size_mm"),
    "extrinsics": ("num_cams_x", "num_cams_y", "baseline_mm", "focus_distance_m"),
}
"""What a ``parameters.cfg`` of the HCI benchmark must state."""
_LENGTHS = ("focal_length_mm", "sensor_size_mm", "baseline_mm", "focus_distance_m")
_CFG = "parameters.cfg of the HCI benchmark"
_MOST_A_SIDE = 999
_WITHOUT = "take it away to go by the pictures alone"
_FETCH, _CORRECT = f"fetch it again, or {_WITHOUT}", f"correct it, or {_WITHOUT}"


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
    size = _size(views)
    stated = (about.get("image_resolution_y_px"), about.get("image_resolution_x_px"))
    if side and views.shape != side:
        (rows, columns), found = views.shape, f"num_cams_y = {side[0]} and num_cams_x = {side[1]}"
        raise DataError(folder / PARAMETERS, found, f"{rows} and {columns}, as the views beside it make", _CORRECT)
    if about and stated != size:
        found = f"a resolution of {stated[0]:g}×{stated[1]:g} pixels (height × width)"
        raise DataError(folder / PARAMETERS, found, f"{size[0]}×{size[1]} as the views have", _CORRECT)
    stored = stack_pictures(folder.name or "light_field", views.files, views.shape, DIMS[:2])
    return Contents(folder, "folder of views", {stored.name: stored}, attrs={"pattern": views.naming, **_si(about)})


def _size(views: ViewFiles) -> Place:
    """Height and width that all views share."""
    sizes = [picture_size(file) for file in views.files]
    usual = max(set(sizes), key=sizes.count)
    for file, size in zip(views.files, sizes, strict=True):
        if size != usual:
            raise wrong_size(file, "a view", size, usual, "most views have")
    return usual


def read_parameters(path: Path) -> dict[str, float]:
    """The numbers of a ``parameters.cfg``, of all its sections; `NEEDED` ones are all there.

    Raises:
        DataError: unreadable, without a needed key, or with an impossible number of views or length.
    """
    parser, numbers = ConfigParser(interpolation=None), dict[str, float]()
    text = read_text(path, f"a {_CFG}", _FETCH)
    with whole_file(path, _CFG, _FETCH):
        parser.read_string(text)
    for section in parser.sections():
        for key, value in parser.items(section):
            with suppress(ValueError):
                numbers[key] = float(value)
    gone = [f"[{s}] {key}" for s, keys in NEEDED.items() for key in keys if key not in numbers]
    if gone:
        raise DataError(path, f"no number for {', '.join(gone)}", "the keys of the HCI benchmark", _FETCH)
    for name in ("num_cams_x", "num_cams_y"):
        if not (numbers[name].is_integer() and 1 <= numbers[name] <= _MOST_A_SIDE):
            wanted = f"a whole number of views from 1 to {_MOST_A_SIDE}"
            raise DataError(path, f"{name} = {numbers[name]:g}", wanted, _FETCH)
    for name in _LENGTHS:
        if not 0 < numbers[name] < inf:
            raise DataError(path, f"{name} = {numbers[name]:g}", "a finite length above 0", _FETCH)
    return numbers


def _si(about: dict[str, float]) -> dict[str, float]:
    """The geometry in metres and pixels, under names of ours."""
    metres = {
        "baseline_m": ("baseline_mm", 1e-3),
        "focal_length_m": ("focal_length_mm", 1e-3),
        "sensor_size_m": ("sensor_size_mm", 1e-3),
        "focus_distance_m": ("focus_distance_m", 1.0),
    }
    return {ours: about[key] * unit for ours, (key, unit) in metres.items() if key in about}


LENS = (14, 14)
"""Views under a lens of the Lytro Illum, as Stanford's archive stores them."""
LIT = 7
"""Views per axis around the centre that no lens of the Lytro Illum vignettes: those taken where none are asked for."""


@reads(*PICTURES)
def open_single(path: Path) -> Contents:
    """A single picture; one whose name says so is a lenslet picture, as in the Lytro archive's ``*_eslf.png``."""
    return open_lenslet(path) if "eslf" in path.stem.lower() else open_picture(path)


def open_lenslet(path: Path, lens: tuple[int, int] = LENS) -> Contents:
    """The views of a lenslet picture: view (v, u) is every ``lens``-th pixel from row v and column u on.

    Raises:
        DataError: the picture's size is no multiple of the lens grid, or it cannot be read.
        SettingError: an impossible lens grid.
    """
    if len(lens) != 2 or any(isinstance(n, bool) or not isinstance(n, int) or n < 1 for n in lens):
        raise SettingError("lens", repr(lens), "rows and columns of the views under a lens, such as 14 and 14")
    height, width = picture_size(path)
    if height % lens[0] or width % lens[1]:
        found = f"{height}×{width} pixels (height × width)"
        expected = f"a multiple of the {lens[0]}×{lens[1]} views under a lens"
        remedy = "fetch it again, or give its lens grid with lens= (--lens)"
        if "eslf" not in path.stem.lower() and lens == LENS:
            remedy = "give the folder of the views: one picture is no light field without its lens grid, lens= (--lens)"
        raise DataError(path, found, expected, remedy)
    pixels = cache(lambda: read_picture(path))
    dtype, channels = pixels().dtype, pixels().shape[2:]

    def load(index: Index) -> NDArray[Any]:
        whole = pixels().reshape(height // lens[0], lens[0], width // lens[1], lens[1], *channels)
        return np.moveaxis(whole, (1, 3), (0, 1))[index]

    dims = (*DIMS, *("channel" for _ in channels))
    shape = (*lens, height // lens[0], width // lens[1], *channels)
    about = {"default_views": LIT} if min(lens) >= LIT else {}
    stored = Stored(path.stem, shape, dtype, load, dims, attrs=about)
    return Contents(path, "lenslet picture", {stored.name: stored}, attrs={"pattern": f"lenslet {lens[0]}×{lens[1]}"})
