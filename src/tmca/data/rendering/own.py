"""Photographs of one's own: which files they are, and their pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.images import PICTURES, read_picture
from tmca.data.formats.opening import read_array
from tmca.data.formats.orientation import orientation_of, upright
from tmca.data.formats.stored import nearest_name
from tmca.errors import DataError

Stamp = tuple[int, int]
"""Size of a file and when it was written, ns."""
SUFFIXES = (*PICTURES, ".tif", ".tiff")
_WANTED = "a photograph: PNG, JPEG, BMP or TIFF of 8 or 16 bits, in red, green and blue"
_GREY = 2 / 255
"""Largest difference between the colours of a picture that counts as grey."""


def stamp_of(path: Path) -> Stamp:
    """What changes with the file.

    Raises:
        DataError: no such file, or no picture by its name.
    """
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise DataError(path, found, _WANTED, "--from renders a folder" if path.is_dir() else nearest_name(path))
    if path.suffix.lower() not in SUFFIXES:
        raise DataError(path, f"a file {path.suffix or 'without a suffix'}", _WANTED)
    about = path.stat()
    return about.st_size, about.st_mtime_ns


def pixels_of(path: Path) -> NDArray[np.float32]:
    """A photograph ``(H, W, 3)`` in [0, 1], upright; grey ones have three equal colours, alpha is dropped.

    Raises:
        DataError: it cannot be read, or is no photograph.
    """
    pixels = read_picture(path) if path.suffix.lower() in PICTURES else _tiff(path)
    if pixels.dtype == np.int32 and path.suffix.lower() == ".png":  # Pillow's type of 16-bit greys
        pixels = pixels.astype(np.uint16)
    if pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[-1] in (1, 2)):
        pixels = np.repeat(pixels.reshape(*pixels.shape[:2], -1)[..., :1], 3, axis=-1)
    colours = pixels.shape[-1] if pixels.ndim == 3 else 0
    most = 1 if pixels.dtype == np.bool_ else _most(pixels.dtype)
    if colours not in (3, 4) or most is None or (colours == 4 and path.suffix.lower() in (".jpg", ".jpeg")):
        inks = " (inks)" if colours == 4 else ""
        raise DataError(path, f"pixels of shape {pixels.shape}{inks} and type {pixels.dtype}", _WANTED)
    return upright(pixels[..., :3].astype(np.float32) / np.float32(most), orientation_of(path))


def _tiff(path: Path) -> NDArray[Any]:
    from tifffile import PHOTOMETRIC, TiffFile, TiffFileError

    pixels = read_array(path)
    try:
        with TiffFile(path) as file:
            inks = file.pages.first.photometric == PHOTOMETRIC.SEPARATED
    except (TiffFileError, OSError, IndexError):
        return pixels
    if inks:
        raise DataError(path, "a picture in inks (CMYK)", _WANTED)
    return pixels


def _most(dtype: np.dtype[Any]) -> int | None:
    return int(np.iinfo(dtype).max) if dtype in (np.uint8, np.uint16) else None


def is_grey(pixels: NDArray[np.float32]) -> bool:
    """Whether a picture ``(H, W, 3)`` has no colours."""
    return bool(np.max(pixels.max(axis=-1) - pixels.min(axis=-1)) <= _GREY)


def photographs_in(folder: Path) -> dict[str, Path]:
    """Photographs of a folder and those in it, by the names of their scenes: the path, its parts joined by ``_``.

    Raises:
        DataError: no folder, one without photographs, or two of one name.
    """
    if not folder.is_dir():
        raise DataError(folder, "a file" if folder.exists() else "no such folder", "a folder of photographs")
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder)
        if path.suffix.lower() not in SUFFIXES or not path.is_file() or any(p.startswith(".") for p in inside.parts):
            continue
        name = "_".join(inside.with_suffix("").parts)
        if name in found:
            raise DataError(path, f"the scene's name {name}, which {found[name].name} has too", "another", "rename it")
        found[name] = path
    if not found:
        raise DataError(folder, "no photographs", f"files {', '.join(SUFFIXES)}", "name another folder")
    return found
