"""Which way up a picture is shown: the EXIF orientation, which phones write beside pixels that they do not turn."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TAG = 274  # Orientation, of EXIF and TIFF
_FLIPS = {
    1: (False, False, False), 2: (False, False, True), 3: (False, True, True), 4: (False, True, False),
    5: (True, False, False), 6: (True, False, True), 7: (True, True, True), 8: (True, True, False),
}  # fmt: skip
"""Orientation → whether rows and columns are exchanged, then rows reversed, then columns (EXIF 2.32, 4.6.4 A)."""


def orientation_of(file: Path) -> int:
    """1 to 8, of a PNG, JPEG, BMP or TIFF; 1 of what says nothing, or nothing that is known."""
    stored = _of_tiff(file) if file.suffix.lower() in (".tif", ".tiff") else _of_picture(file)
    return int(stored) if stored in _FLIPS else 1


def _of_picture(file: Path) -> object:
    from PIL import Image

    with Image.open(file) as image:
        if "exif" not in image.info:  # getexif would decode a PNG in search of it
            return None
        try:
            return image.getexif().get(_TAG)
        except (SyntaxError, ValueError, OSError, struct.error):  # damaged
            return None


def _of_tiff(file: Path) -> object:
    from tifffile import TiffFile

    with TiffFile(file) as tiff:
        tag = tiff.pages.first.tags.get(_TAG)
        return None if tag is None else int(tag.value)


def upright(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Stored pixels (H, W, …) as viewers show them."""
    exchanged, rows, columns = _FLIPS[orientation]
    turned = pixels.swapaxes(0, 1) if exchanged else pixels
    return np.ascontiguousarray(turned[:: -1 if rows else 1, :: -1 if columns else 1])


def upright_size(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    """(H, W) of them, of the stored (H, W)."""
    return (size[1], size[0]) if _FLIPS[orientation][0] else size
