"""Coordinates of the axes that scenes share, with what they mean, as files say it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Axis = tuple[str, Any, dict[str, str]]
"""Name, values and attributes, as xarray takes them."""
COLOURS = ("red", "green", "blue")
WAVELENGTH = {"units": "m", "long_name": "wavelength"}
_VIEWS = {"view_v": "view rows from the centre", "view_u": "view columns from the centre"}


def view_axes(views: tuple[int, int]) -> dict[str, Axis]:
    """``view_v`` and ``view_u`` of a grid of views."""
    return {
        name: (name, centred(count), {"units": "view steps", "long_name": meaning})
        for (name, meaning), count in zip(_VIEWS.items(), views, strict=True)
    }


def centred(count: int) -> NDArray[np.float64]:
    """Whole steps from the middle, or half ones of an even number: −1, 0, 1."""
    return np.arange(count, dtype=np.float64) - (count - 1) / 2


def colour_axis() -> Axis:
    """``colour``: red, green, blue."""
    return "colour", list(COLOURS), {"long_name": "colour"}


def pixel_axes(height: int, width: int) -> dict[str, Axis]:
    """``y`` and ``x`` of a picture."""
    sides = {"y": (height, "row"), "x": (width, "column")}
    return {
        name: (name, np.arange(size), {"units": "pixel", "long_name": word}) for name, (size, word) in sides.items()
    }
