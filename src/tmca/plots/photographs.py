"""Refocused photographs as files: one picture, a labelled strip, an animation, or pages of numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data import atomic_path
from tmca.data.files import tiff_bytes
from tmca.errors import OutputError
from tmca.plots.style import save_figure
from tmca.plots.views import shown, strip_figure, views_gif

if TYPE_CHECKING:
    import xarray as xr

PHOTOGRAPHS = (".png", ".gif", ".tif", ".tiff", ".nc")
"""Endings that photographs can be written under."""


def check_photographs(path: Path, count: int) -> None:
    """Raises OutputError unless so many photographs can be written under this suffix."""
    suffix = path.suffix.lower()
    if suffix not in PHOTOGRAPHS:
        raise OutputError(path, f"the suffix {path.suffix!r}", " ".join(PHOTOGRAPHS), "rename the output")
    if suffix == ".gif" and count < 2:
        raise OutputError(path, "one photograph", "several for an animation", "write .png, or give several disparities")


def write_photographs(
    stack: xr.DataArray, path: Path, white: float, *, title: str = "", overwrite: bool = False
) -> Path:
    """Write photographs as PNG, GIF or TIFF, by the suffix, whole or not at all.

    PNG has one as it is, or several in a strip that says their disparity; GIF goes through several and back; TIFF has
    float32 pages, relative irradiance, with the disparities in their description.

    Args:
        stack: (disparity, y, x), or (disparity, colour, y, x).
        path: of the file.
        white: irradiance shown as white; TIFF is not scaled.
        title: above a strip.
        overwrite: replace an earlier file.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
    """
    check_photographs(path, len(stack))
    pictures = np.moveaxis(stack.values if stack.ndim == 4 else stack.values[:, None], 1, -1)
    if path.suffix.lower() == ".gif":
        return views_gif(np.moveaxis(pictures, -1, 0)[:, None], path, seconds=2.4, white=white, overwrite=overwrite)
    if path.suffix.lower() == ".png" and len(stack) > 1:
        steps = [float(step) for step in stack["disparity"].values]
        return save_figure(strip_figure(pictures, steps, white, title), path, overwrite=overwrite)
    with atomic_path(path, overwrite=overwrite) as temporary:
        if path.suffix.lower() == ".png":
            _png(shown(pictures[0], white), temporary)
        else:
            temporary.write_bytes(_pages(pictures, stack))
    return path


def _png(picture: np.ndarray, path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.round(255 * picture).astype(np.uint8)).save(path, format="PNG")


def _pages(pictures: np.ndarray, stack: xr.DataArray) -> bytes:
    """A page for every photograph, with colours where there are some."""
    coloured = pictures.shape[-1] == 3
    about: dict[str, Any] = {"axes": "ZYXS" if coloured else "ZYX", "unit": "relative irradiance"}
    if "disparity" in stack.coords:
        about["disparity_px_per_view_step"] = [float(step) for step in np.atleast_1d(stack["disparity"].values)]
    pages = np.ascontiguousarray(pictures if coloured else pictures[..., 0], dtype=np.float32)
    return tiff_bytes(pages, photometric="rgb" if coloured else "minisblack", metadata=about)
