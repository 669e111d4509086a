"""What the viewer shows: items made of layers, whose planes are read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from threading import RLock
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.data import plain

Rows = tuple[int, int]
Read = Callable[[int, slice, slice], NDArray[Any]]
"""Takes the index of a plane, rows and columns; gives (rows, columns), or (rows, columns, 3) of a colour picture."""
Colours = Literal["values", "signed", "level", "depth", "deviation", "binary", "picture"]
_BLOCK = 32 * 2**20
"""Bytes that are read at once where a plane is thinned out."""
_LOOKED_AT, _SIDE = 5, 256
"""Planes, and pixels of a side of each, from which the range of values is taken."""
_numbers = count()


@dataclass(frozen=True)
class Axis:
    """What the planes of a layer run over.

    Args:
        label: such as ``wavelength``.
        unit: of the positions, empty without.
        values: position of every plane.
        names: of the planes, where numbers do not say enough.
    """

    label: str
    unit: str
    values: tuple[float, ...]
    names: tuple[str, ...] = ()

    @classmethod
    def counted(cls, label: str, planes: int, names: Sequence[str] = (), first: int = 1) -> Axis:
        """Planes that are only counted, from ``first``."""
        return cls(label, "", tuple(map(float, range(first, first + planes))), tuple(names))


@dataclass(frozen=True)
class Layer:
    """A stack of planes of one size.

    Args:
        name: by which it is asked for.
        label: of its values, such as ``relative irradiance``.
        size: rows and columns.
        axis: of its planes.
        read: a part of a plane.
        unit: of the values.
        colours: which colour map suits it.
        span: values shown as darkest and brightest; found from the planes without.
        column: all planes of some rows and columns (planes, rows, columns), where that is faster than plane by plane.
        view: further facts for the page, such as what the two axes of the picture are.
    """

    name: str
    label: str
    size: tuple[int, int]
    axis: Axis
    read: Read
    unit: str = ""
    colours: Colours = "values"
    span: tuple[float, float] | None = None
    column: Callable[[slice, slice], NDArray[Any]] | None = None
    view: Mapping[str, Any] = field(default_factory=dict)

    @property
    def planes(self) -> int:
        """How many there are."""
        return len(self.axis.values)

    def plane(self, index: int, step: int = 1, rows: Rows | None = None, columns: Rows | None = None) -> NDArray[Any]:
        """Every ``step``-th pixel of a part of a plane, float32, or uint8 (rows, columns, 3) of a colour picture."""
        (top, bottom), (left, right) = rows or (0, self.size[0]), columns or (0, self.size[1])
        if step == 1:
            return self._as_shown(self.read(index, slice(top, bottom), slice(left, right)))
        high = max(step, _BLOCK // (8 * max(right - left, 1)) // step * step)
        blocks = (slice(at, min(at + high, bottom)) for at in range(top, bottom, high))
        parts = [self._as_shown(self.read(index, block, slice(left, right))[::step, ::step]) for block in blocks]
        return np.concatenate(parts)

    def _as_shown(self, values: NDArray[Any]) -> NDArray[Any]:
        return np.ascontiguousarray(values, dtype=np.uint8 if self.colours == "picture" else np.float32)

    def profile(self, rows: Rows, columns: Rows) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and standard deviation over some pixels, of every plane; what is not finite is left out."""
        across, deviations = np.full((2, self.planes), np.nan)
        for index, values in enumerate(self._columns(slice(*rows), slice(*columns))):
            good = values[np.isfinite(values)].astype(np.float64)
            if good.size:
                across[index], deviations[index] = good.mean(), good.std()
        return across, deviations

    def _columns(self, rows: slice, columns: slice) -> Any:
        few = self.planes * (rows.stop - rows.start) * (columns.stop - columns.start) * 8 <= _BLOCK
        if self.column is not None and few:
            return self.column(rows, columns)
        return (self.read(index, rows, columns) for index in range(self.planes))

    def shown_span(self) -> tuple[float, float]:
        """The values shown as darkest and brightest."""
        if self.span is not None or self.colours == "picture":
            return self.span or (0.0, 255.0)
        step = max(1, min(self.size) // _SIDE)
        chosen = sorted({round(at) for at in np.linspace(0, self.planes - 1, min(self.planes, _LOOKED_AT))})
        values = np.concatenate([self.plane(index, step).ravel() for index in chosen])
        return usual_span(values, self.colours)

    def about(self, step: int) -> dict[str, Any]:
        """What the page has to know before it asks for a plane."""
        axis = {"label": self.axis.label, "unit": self.axis.unit, "values": self.axis.values, "names": self.axis.names}
        return {
            "name": self.name, "label": self.label, "unit": self.unit, "size": self.size, "planes": self.planes,
            "axis": axis, "colours": self.colours, "span": self.shown_span(), "step": step, **self.view,
        }  # fmt: skip


@dataclass(frozen=True)
class Item:
    """A file, or what is shown of it as one.

    Args:
        kind: of the page that shows it, such as ``cube``.
        title: short, above its pictures.
        layers: the first is shown first.
        facts: what else there is to say, by name.
        role: ``truth`` where it is one.
        view: further facts for the page.
        check: raises a DataError where the file is not what it was when it was opened.
        lock: held while something is read.
    """

    kind: str
    title: str
    layers: tuple[Layer, ...]
    facts: Mapping[str, Any] = field(default_factory=dict)
    role: str = ""
    view: Mapping[str, Any] = field(default_factory=dict)
    check: Callable[[], None] = lambda: None
    lock: Any = field(default_factory=RLock)
    number: int = field(default_factory=lambda: next(_numbers))

    def layer(self, name: str) -> Layer | None:
        """The layer of that name, None without."""
        return next((layer for layer in self.layers if layer.name == name), None)

    def about(self, most: int) -> dict[str, Any]:
        """What the page has to know; a plane of more than ``most`` pixels is thinned out at first."""
        with self.lock:
            layers = [layer.about(thinning(layer.size, most)) for layer in self.layers]
        about = {"kind": self.kind, "title": self.title, "facts": self.facts, "role": self.role, "layers": layers}
        about |= self.view
        return dict(plain(about))


def thinning(size: tuple[int, int], most: int) -> int:
    """Every how many-th pixel of a plane is as many as ``most``."""
    return max(1, int(np.ceil(np.sqrt(size[0] * size[1] / most))))


def usual_span(values: NDArray[Any], colours: str = "values") -> tuple[float, float]:
    """Values shown as darkest and brightest: all but the outermost; what is not finite does not count."""
    good = values[np.isfinite(values)]
    if not good.size:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(good, [0.2, 99.8]))
    if colours == "signed":
        low = -(high := max(abs(low), abs(high)))
    elif colours in ("values", "deviation", "level") and 0 <= low < 0.5 * high:
        low = 0.0
    return (low, high) if high > low else (low, low + max(abs(low), 1.0) * 1e-3)


def in_memory(values: NDArray[Any]) -> Read:
    """Planes of an array (planes, rows, columns), or of one (planes, rows, columns, 3)."""
    return lambda index, rows, columns: np.asarray(values[index, rows, columns])
