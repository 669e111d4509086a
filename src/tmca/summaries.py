"""What an object says of itself: a few lines as text, the same facts beside a small picture in a notebook.

A class gives its facts and a picture; layout, colours and size of the page are decided here.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

MOST_CHARACTERS = 60_000
"""Of a picture in a page: notebooks hold every one that was shown."""
_LONGEST = 90
"""Characters of a fact in a line of text."""
_STEPS = ((100, 256), (100, 48), (80, 32), (60, 16), (40, 8))
"""Dots per inch and colours of a picture, until it is small enough."""
_CELL = "text-align:left;padding:1px 14px 1px 0;border:0;background:transparent;color:inherit"
_TABLE = "margin:0;border:0;font-size:90%;color:inherit;background:transparent"
_PICTURE = "background:#fff;border-radius:4px;max-width:100%;margin-top:4px"


class Summary:
    """What is shown of itself as text and, in a notebook, as a table with a picture."""

    _uncut: ClassVar[tuple[str, ...]] = ()
    """Facts that are shown whole, however long."""

    def _facts(self) -> Mapping[str, str]:
        """What is told of it, by name: sizes, settings and results, no arrays."""
        return {}

    def _picture(self) -> Figure | None:
        """A small picture of it, about six inches wide."""
        return None

    def __repr__(self) -> str:
        facts = [(name, " ".join(str(text).split())) for name, text in self._facts().items() if str(text)]
        lines = (f"  {name}: {text if name in self._uncut else _cut(text)}" for name, text in facts)
        return "\n".join((type(self).__name__, *lines))

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr style="background:transparent"><th style="{_CELL};opacity:0.7;font-weight:normal">{escape(name)}</th>'
            f'<td style="{_CELL}">{escape(str(text))}</td></tr>'
            for name, text in self._facts().items() if str(text)
        )  # fmt: skip
        figure = self._picture()
        shown = "" if figure is None else f'<img style="{_PICTURE}" alt="" src="{data_uri(figure)}"/>'
        title, table = (
            escape(type(self).__name__),
            f'<table style="{_TABLE}">{rows}</table>',
        )
        return f'<div style="font-family:sans-serif"><strong>{title}</strong>{table}{shown}</div>'


def _cut(text: str) -> str:
    return f"{text[:_LONGEST]}{'…' * (len(text) > _LONGEST)}"


def data_uri(figure: Figure) -> str:
    """A figure as PNG in a ``data:`` address of at most `MOST_CHARACTERS`; fewer colours and dots where it is large."""
    from PIL import Image

    for dots, colours in _STEPS:
        drawn, packed = BytesIO(), BytesIO()
        figure.savefig(drawn, format="png", dpi=dots, facecolor="white")
        with Image.open(drawn) as picture:
            few = picture.convert("RGB").quantize(colours, dither=Image.Dither.NONE)
            few.save(packed, "PNG", optimize=True)
        address = f"data:image/png;base64,{b64encode(packed.getvalue()).decode()}"
        if len(address) <= MOST_CHARACTERS:
            break
    return address


def as_numpy(values: Any, dtype: Any = None, copy: bool | None = None) -> np.ndarray[Any, Any]:
    """What ``__array__`` returns of values, an array or a tensor: a view where nothing has to be converted.

    Args:
        values: NumPy's or torch's, on any device.
        dtype: of the result; as they are if None.
        copy: as NumPy 2 asks: True for a copy, False for none, None where it has to be.

    Raises:
        ValueError: ``copy=False`` where values have to be converted.
    """
    import numpy as np

    held = np.asarray(values.numpy(force=True) if hasattr(values, "numpy") else values)
    moved = getattr(getattr(values, "device", "cpu"), "type", "cpu") != "cpu"
    if copy is False and (moved or (dtype is not None and np.dtype(dtype) != held.dtype)):
        raise ValueError("found copy=False, expected a copy: the values have another type or lie on another device")
    return held.astype(dtype or held.dtype, copy=bool(copy))


def range_nm(wavelengths: Any) -> str:
    """``400 to 700 nm`` of wavelengths in metres; nothing where there are none."""
    return f"{min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm" if len(wavelengths or ()) else ""


def sizes(shape: Any) -> str:
    """``3×4`` of a shape."""
    return "×".join(map(str, shape))
