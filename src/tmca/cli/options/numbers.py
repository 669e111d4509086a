"""Numbers on the command line: 1.5 is not a whole one, and is refused, not rounded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter

from tmca.errors import SettingError


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
On = Annotated[bool, Parameter(negative_bool="no-")]
"""A flag that is on; ``--no-NAME`` switches it off."""
MaybeOn = Annotated[bool | None, Parameter(negative_bool="no-")]
"""A flag that is on or off where it is given."""
MaybeWhole = Annotated[int | None, Parameter(converter=whole)]


def numbers(text: str, option: str) -> float | list[float]:
    """One number, or several separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise SettingError(option, repr(text), "a number, or numbers separated by commas") from None
    return values[0] if len(values) == 1 else values


def pair(text: str | None, option: str) -> tuple[float, float]:
    """``ROWS,COLUMNS``; zeros if not given."""
    values = (0.0, 0.0) if text is None else numbers(text, option)
    if not isinstance(values, list | tuple) or len(values) != 2:
        raise SettingError(option, repr(text), "ROWS,COLUMNS in pixels, such as 0,2.5")
    return (values[0], values[1])


def size(
    text: str | None, option: str = "--size", expected: str = "HEIGHTxWIDTH in pixels, such as 256x256"
) -> tuple[int, int] | None:
    """Two whole numbers, ``HxW`` in pixels unless something else is ``expected``."""
    if text is None:
        return None
    try:
        height, width = (int(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        raise SettingError(option, repr(text), expected) from None
    return height, width


def whole_numbers(text: str, option: str) -> list[int]:
    """Whole numbers separated by commas."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise SettingError(option, repr(text), "whole numbers separated by commas") from None
