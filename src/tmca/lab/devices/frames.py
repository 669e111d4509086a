"""Frames of devices as PNG: 1 bit, 8 bits, 16 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError


def write_frame(file: Path, frame: NDArray[np.integer], bits: int) -> Path:
    """A frame (R, C) as PNG: one bit a pixel, 8, or 16."""
    from PIL import Image

    if bits == 1:
        Image.fromarray((frame > 0).astype(np.uint8) * 255).convert("1").save(file)
    else:
        Image.fromarray(frame.astype(np.uint8 if bits <= 8 else np.uint16)).save(file)
    return file


def read_frame(file: Path) -> NDArray[np.integer]:
    """(R, C) what ``write_frame`` wrote; 0 and 1 of one bit.

    Raises:
        DataError: a missing or broken picture, or one in colour.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(file) as picture:
            found = np.asarray(picture)
    except (OSError, UnidentifiedImageError, SyntaxError):
        raise DataError(file, "no picture", "the PNG of the export", "export again") from None
    if found.ndim != 2:
        raise DataError(file, f"an array of shape {found.shape}", "one plane of pixels", "export again")
    return found.astype(np.uint8) if found.dtype == np.bool_ else found
