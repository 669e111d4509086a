"""Lenslet pictures: under every lens one pixel per view, as in the Lytro archive's ``*_eslf.png``."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.images import picture_size, read_picture
from tmca.data.formats.stored import Contents, Index, Stored
from tmca.data.formats.views import DIMS
from tmca.errors import DataError, SettingError

LENS = (14, 14)
"""Views under a lens of the Lytro Illum, as Stanford's archive stores them."""
LIT = 7
"""Views per axis around the centre that no lens of the Lytro Illum vignettes: those taken where none are asked for."""


def is_lenslet(path: Path) -> bool:
    """Whether a picture's name says that it is a lenslet picture."""
    return "eslf" in path.stem.lower()


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
        raise DataError(
            path,
            f"{height}×{width} pixels (height × width)",
            f"a multiple of the {lens[0]}×{lens[1]} views under a lens",
            "fetch it again, or give its lens grid with lens= (--lens)",
        )
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
