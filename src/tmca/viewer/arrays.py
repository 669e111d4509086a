"""Pictures and arrays that are no cube: planes along the axis that looks like it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import Contents, Stored
from tmca.data.formats.wavelengths import spectral_axis
from tmca.viewer.cubes import ONE, said
from tmca.viewer.items import Axis, Item, Layer

_MOST, _COLOURS = 12, (3, 4)
"""Arrays of a file that are shown, and channels of a colour picture."""


def array_items(contents: Contents, title: str, variable: str | None = None, **about: Any) -> list[Item]:
    """Every array of two or three axes in a file, or the one asked for; none where there is none."""
    asked = [contents.get(variable)] if variable is not None else list(contents.arrays.values())
    shown = [stored for stored in asked if stored.numeric and stored.size and len(stored.shape) in (2, 3)]
    several = len(shown) > 1
    return [
        _item(contents, stored, f"{title}: {stored.name}" if several else title, **about) for stored in shown[:_MOST]
    ]


def _item(contents: Contents, stored: Stored, title: str, **about: Any) -> Item:
    facts = {"size": " × ".join(map(str, stored.shape)), "format": f"{contents.format}, {stored.name}, {stored.dtype}"}
    return Item("array", title, (_layer(contents, stored),), {**facts, **said(contents.attrs)}, **about)


def _layer(contents: Contents, stored: Stored) -> Layer:
    label = str(stored.attrs.get("long_name") or stored.name)[:60]
    unit = str(stored.attrs.get("units") or "")[:20]
    if len(stored.shape) == 2:
        return Layer("values", label, (stored.shape[0], stored.shape[1]), ONE, _Planes(stored, None).read, unit)
    if contents.format == "picture" and stored.shape[2] in _COLOURS and stored.dtype == np.uint8:
        size = stored.shape[0], stored.shape[1]
        return Layer("values", label, size, ONE, _Planes(stored, None).colours, colours="picture")
    axis = spectral_axis(stored) or 0
    rows, columns = (length for place, length in enumerate(stored.shape) if place != axis)
    over = Axis.counted(stored.dims[axis] if stored.dims else "plane", stored.shape[axis], first=0)
    return Layer("values", label, (rows, columns), over, _Planes(stored, axis).read, unit)


class _Planes:
    """Planes along an axis of an array, or the whole of one without."""

    def __init__(self, stored: Stored, axis: int | None) -> None:
        self._stored, self._axis = stored, axis

    def read(self, index: int, rows: slice, columns: slice) -> NDArray[Any]:
        """A part of a plane, (rows, columns)."""
        where: list[int | slice] = [rows, columns]
        if self._axis is not None:
            where.insert(self._axis, index)
        return np.asarray(self._stored.load(tuple(where)))

    def colours(self, index: int, rows: slice, columns: slice) -> NDArray[Any]:
        """A part of a picture, (rows, columns, 3)."""
        return np.asarray(self._stored.load((rows, columns, slice(0, 3))))
