"""Light fields as items: every view, and the disparity of the centre one where it is known."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import ESTIMATED, Contents, Stored, find_disparity, read_disparity
from tmca.data.axes import centred
from tmca.data.formats.wavelengths import divisor
from tmca.data.light_fields import VIEW_DIMS, has_colour
from tmca.errors import TmcaError
from tmca.plots.views import brightest, shown
from tmca.viewer.cubes import ONE, said
from tmca.viewer.items import Axis, Item, Layer, in_memory

_USUAL = 2.0
"""Px per view step over which a light field without a disparity is refocused."""
_STEP = 0.5
"""Px per view step, of which the ends of the disparities are multiples."""


def light_field_item(contents: Contents, stored: Stored, title: str, **about: Any) -> Item:
    """The views of an open light field, as pictures, and its disparity; ``about`` of the `Item`.

    Args:
        contents: the open file or folder.
        stored: its array over views.
        title: of the item.
    """
    size = dict(zip(stored.dims, stored.shape, strict=True))
    rows, columns, height, width = (size[dim] for dim in VIEW_DIMS)
    places = [(v, u) for v in centred(rows) for u in centred(columns)]
    names = tuple(f"view {v:g}, {u:g}" for v, u in places)
    axis = Axis.counted("view", len(places), names, first=0)
    views = Layer("values", "views", (height, width), axis, _Views(stored, columns).read, colours="picture")
    layers = [views, *_disparity(contents, (height, width))]
    reach = _reach(layers[1]) if len(layers) > 1 else (-_USUAL, _USUAL)
    facts = {
        "views": f"{rows} × {columns} of {height} × {width} pixels",
        "colours": "red, green, blue" if has_colour(stored) else "grey",
        "format": f"{contents.format}, {stored.name}, {stored.dtype}",
        "disparity": _origin(contents) if len(layers) > 1 else "none in the file",
    }
    view = {"grid": [rows, columns], "places": places, "reach": reach}
    return Item("light field", title, tuple(layers), {**facts, **said(contents.attrs)}, view=view, **about)


def _reach(disparity: Layer) -> tuple[float, float]:
    """The disparities over which a light field is refocused: those of its map."""
    low, high = (float(end) / _STEP for end in disparity.shown_span())
    first = _STEP * float(np.floor(low))
    return first, max(first + _STEP, _STEP * float(np.ceil(high)))


class _Views:
    """Views as 8-bit pictures, of one brightness, which the centre view gives."""

    def __init__(self, stored: Stored, columns: int) -> None:
        self._stored, self._columns = stored, columns
        self._white: float | None = None

    def read(self, index: int, rows: slice, columns: slice) -> NDArray[np.uint8]:
        """A part of a view, (rows, columns, 3)."""
        if self._white is None:
            grid = [self._stored.shape[self._stored.dims.index(dim)] for dim in VIEW_DIMS]
            middle = self._values(grid[0] // 2, grid[1] // 2, slice(None), slice(None))
            self._white = brightest(np.moveaxis(middle, -1, 0)[:, None, None])
        values = self._values(*divmod(index, self._columns), rows, columns)
        picture = shown(np.nan_to_num(values), self._white)
        return np.broadcast_to(np.round(255 * picture).astype(np.uint8), (*values.shape[:2], 3))

    def _values(self, v: int, u: int, rows: slice, columns: slice) -> NDArray[np.float32]:
        """(rows, columns, 3), or of grey views (rows, columns, 1), relative irradiance."""
        stored = self._stored
        at: dict[str, int | slice] = {"view_v": v, "view_u": u, "y": rows, "x": columns}
        values = np.asarray(stored.load(tuple(at.get(dim, slice(None)) for dim in stored.dims)), np.float32)
        left = [dim for dim in stored.dims if dim not in VIEW_DIMS[:2]]
        values = np.atleast_3d(np.moveaxis(values, (left.index("y"), left.index("x")), (0, 1)))
        channels = values[..., :3] if values.shape[2] >= 3 else values[..., :1]
        return channels / np.float32(divisor(stored, 0, None, None)[0])


def _origin(contents: Contents) -> str:
    """Where the disparity that is shown comes from."""
    stored = contents.arrays.get("disparity")
    return "matched from the views" if stored is not None and stored.attrs.get(ESTIMATED) else "in the file"


def _disparity(contents: Contents, size: tuple[int, int]) -> list[Layer]:
    """The disparity map of a folder or file, where it has one that fits, and its confidence."""
    values: NDArray[np.float32] | None = None
    if "disparity" in contents.arrays and contents.arrays["disparity"].shape == size:
        values = contents.arrays["disparity"].whole().astype(np.float32)
    elif contents.path.exists() and find_disparity(contents.path) is not None:
        try:
            values = read_disparity(contents.path).values
        except TmcaError:
            return []
    if values is None or values.shape != size:
        return []
    read = in_memory(values[None])
    layers = [Layer("disparity", "disparity", size, ONE, read, "px per view step", "depth")]
    sure = contents.arrays.get("confidence")
    if sure is not None and sure.shape == size and sure.numeric:
        confidence = in_memory(sure.whole().astype(np.float32)[None])
        layers.append(Layer("confidence", "confidence", size, ONE, confidence, span=(0.0, 1.0)))
    return layers
