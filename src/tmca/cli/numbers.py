"""Whole numbers on the command line: 1.5 is refused, not rounded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter


def whole(type_: Any, tokens: Sequence[Any]) -> int:
    """The integer that one token says; ``30.0`` is 30."""
    text = tokens[0].value
    try:
        number = float(text) if "." in text or "e" in text.lower() else int(text)
    except ValueError:
        number = 0.5
    if not float(number).is_integer():
        raise ValueError(f"found {text}, expected a whole number")
    return int(number)


Whole = Annotated[int, Parameter(converter=whole)]
MaybeWhole = Annotated[int | None, Parameter(converter=whole)]
