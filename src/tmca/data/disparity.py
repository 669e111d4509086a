"""True disparity of a light field's centre view, where a data set has it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.datasets import SUFFIXES as LABELLED
from tmca.data.datasets import read_dataset
from tmca.data.formats.arrays import open_labelled, open_npy
from tmca.data.formats.images import read_picture
from tmca.data.formats.views import open_views
from tmca.data.light_fields import centre_window
from tmca.data.rendering.resample import nearest
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray

USUAL = "gt_disp_lowres.pfm"
"""The HCI benchmark's disparity at the size of its views."""
_MEND = "mend the map, or take it away to go without"


def find_disparity(folder: str | Path) -> Path | None:
    """The disparity map of a folder of views: `USUAL`, or the only ``.pfm`` with ``disp`` in its name; of a labelled
    file, the file itself if it holds ``disparity``."""
    folder = Path(folder)
    if folder.suffix.lower() in LABELLED or not folder.is_dir():
        return folder if _holds_disparity(folder) else None
    if (folder / USUAL).is_file():
        return folder / USUAL
    others = [file for file in sorted(folder.glob("*.pfm")) if "disp" in file.name.lower()]
    return others[0] if len(others) == 1 else None


def _holds_disparity(path: Path) -> bool:
    if path.suffix.lower() not in LABELLED or not path.exists():
        return False
    with open_labelled(path) as stored:
        return "disparity" in stored.data_vars


def read_disparity(
    path: str | Path,
    *,
    crop: tuple[int, int] | None = None,
    scale: int | None = None,
    size: tuple[int, int] | None = None,
    pattern: str | None = None,
) -> xarray.DataArray:
    """Disparity of the centre view in px per view step, brought to the pixels of `read_light_field`.

    A reduced map is sampled at the middle of each new pixel, so that no two sides of an edge are mixed, and its
    values are divided by the scale.

    Args:
        path: a folder of views with its map, a ``.pfm`` or ``.npy`` map, or a labelled file with ``disparity``.
        crop: as in `read_light_field`.
        scale: as in `read_light_field`.
        size: (H, W) that the map must have before both; that of the views for a folder.
        pattern: of the views' names in a folder, as in `read_light_field`.

    Returns:
        dims ``(y, x)``, float32, positive = nearer than the plane in focus; attrs ``source`` and ``units``.

    Raises:
        DataError: there is none, it is broken, of another size than the views, or has NaN or infinite values.
        SettingError: an impossible crop or scale.
    """
    import xarray

    path = Path(path)
    values, source = _values(path)
    expected = _size_of_views(path, pattern) if size is None else size
    if expected is not None and values.shape != tuple(expected):
        found = f"{values.shape[0]}×{values.shape[1]} pixels (height × width)"
        wanted = f"{expected[0]}×{expected[1]} as the views have"
        raise DataError(source, found, wanted, "fetch the map of their size, or take it away to go without")
    if not np.isfinite(values).all():
        found = f"{np.sum(~np.isfinite(values))} NaN or infinite values"
        raise DataError(source, found, "finite disparities", _MEND)
    height, width = values.shape
    window = centre_window((height, width), crop, scale, source)
    step = scale or 1
    chosen = values[window]
    reduced = nearest(chosen, (chosen.shape[0] // step, chosen.shape[1] // step)) / np.float32(step)
    about = {"units": "px per view step", "long_name": "disparity, positive = nearer", "source": str(source)}
    return xarray.DataArray(reduced.astype(np.float32), dims=("y", "x"), name="disparity", attrs=about)


def _values(path: Path) -> tuple[NDArray[np.float32], Path]:
    """The stored map ``(H, W)`` and the file it lies in."""
    if path.is_dir() and path.suffix.lower() not in LABELLED:
        found = find_disparity(path)
        if found is None:
            raise DataError(path, "no disparity map", f"{USUAL} or one *disp*.pfm", "give the map's own path")
        path = found
    if not path.exists():
        raise DataError(path, "no such file", "a disparity map", "check the path")
    if path.suffix.lower() == ".npy":
        values: NDArray[Any] = next(iter(open_npy(path).arrays.values())).whole()
    elif path.suffix.lower() in LABELLED:
        values = read_dataset(path, ["disparity"])["disparity"].values
    elif path.suffix.lower() == ".pfm":
        values = read_picture(path)
    else:
        wanted = ".pfm, .npy or a labelled file with disparity"
        raise DataError(path, f"the suffix {path.suffix!r}", wanted, "write the map as one of them")
    if values.ndim != 2 or values.dtype.kind != "f":
        raise DataError(path, f"{values.dtype} of shape {values.shape}", "a map (y, x) of floats", _MEND)
    return values.astype(np.float32), path


def _size_of_views(path: Path, pattern: str | None) -> tuple[int, int] | None:
    """Height and width of the views in a folder, None for anything else."""
    opened = open_views(path, pattern) if path.is_dir() and path.suffix.lower() not in LABELLED else None
    return None if opened is None else next((s.shape[2], s.shape[3]) for s in opened.arrays.values())
