"""All that one viewer shows, and the answers it has for its page: facts in JSON, planes and profiles as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import plain
from tmca.viewer.items import Item, Layer, Rows
from tmca.viewer.opening import open_items
from tmca.viewer.truths import beside_truth

MOST = 2**22
"""Pixels of a plane that are sent at once; more of it are sent when the page looks closer."""


class NotShown(Exception):
    """What was asked for is not there."""


class Gallery:
    """Items of open files; `close` closes them.

    Args:
        things: see `tmca.viewer.opening.open_items`.
        truth: the scene that they are estimates of.
        variable: which array, where a file has several.
    """

    def __init__(self, things: Sequence[Any], truth: Any = None, variable: str | None = None) -> None:
        self._stack = ExitStack()
        with ExitStack() as opening:
            opening.callback(self._stack.close)
            self.items: list[Item] = []
            for thing in things:
                if truth is None:
                    self.items += open_items(thing, self._stack, variable)
                else:
                    self.items += beside_truth(thing, truth, self._stack, with_truth=thing is things[-1])
            opening.pop_all()

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def about(self) -> dict[str, Any]:
        """What the page has to know first."""
        return {"items": [item.about(MOST) for item in self.items]}

    def newest(self, after: int) -> dict[str, Any]:
        """What there is to say of the newest exposure of a loop; files have none.

        Raises:
            NotShown: nothing that changes.
        """
        raise NotShown

    def plane(self, item: int, layer: str, index: int, step: int, rows: Rows, columns: Rows) -> NDArray[Any]:
        """A part of a plane; the last row and column are cut to those that there are.

        Raises:
            NotShown: no such item, layer, plane or part.
            DataError: the file is not what it was.
        """
        shown, found = self._layer(item, layer)
        places = _within(rows, found.size[0]), _within(columns, found.size[1])
        count = -(-(places[0][1] - places[0][0]) // step) * -(-(places[1][1] - places[1][0]) // step)
        if not 0 <= index < found.planes or count > 2 * MOST:
            raise NotShown
        with shown.lock:
            shown.check()
            return found.plane(index, step, *places)

    def profile(self, item: int, layer: str, rows: Rows, columns: Rows) -> dict[str, Any]:
        """Mean and standard deviation over some pixels, of every plane; errors as of `plane`."""
        shown, found = self._layer(item, layer)
        places = _within(rows, found.size[0]), _within(columns, found.size[1])
        with shown.lock:
            shown.check()
            mean, deviation = found.profile(*places)
        return dict(plain({"mean": np.float32(mean), "deviation": np.float32(deviation)}))

    def _layer(self, item: int, layer: str) -> tuple[Item, Layer]:
        found = self.items[item].layer(layer) if 0 <= item < len(self.items) else None
        if found is None:
            raise NotShown
        return self.items[item], found


def _within(part: Rows, length: int) -> Rows:
    first, last = max(part[0], 0), min(part[1], length)
    if first >= last:
        raise NotShown
    return first, last
