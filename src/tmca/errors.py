"""The errors that tmca raises on purpose: one line that says where, what was found, what was expected, what to do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf, isfinite
from numbers import Real
from typing import Any

__all__ = [
    "DataError",
    "DeviceError",
    "OutputError",
    "SettingError",
    "ShapeError",
    "TmcaError",
    "check_choice",
    "check_range",
    "check_shape",
    "did_you_mean",
    "one_line",
]
_LONGEST, _END = 250, 50
"""Characters of what is shown of what was met, which may come from a file, and of its end."""


def __dir__() -> list[str]:
    return sorted(__all__)


class TmcaError(Exception):
    """An input that tmca cannot use.

    The message is one line: ``where: found …, expected …; remedy``.

    Args:
        where: the file, argument or option at fault.
        found: the value or condition met.
        expected: what it should have been.
        remedy: what the reader can change.
    """

    def __init__(self, where: object, found: str, expected: str = "", remedy: str = "") -> None:
        found = _shortened(found)
        self.where, self.found, self.expected, self.remedy = str(where), found, expected, remedy
        text = f"{where}: found {self.found}"
        if expected:
            text += f", expected {expected}"
        if remedy:
            text += f"; {remedy}"
        super().__init__(" ".join(text.split()))

    def __reduce__(self) -> tuple[type[TmcaError], tuple[str, str, str, str]]:
        """The parts: that is how it comes out of another process."""
        return type(self), (self.where, self.found, self.expected, self.remedy)


def _shortened(text: str) -> str:
    """A text that is too long to be read without its middle."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - _END]} … {text[-_END:]}"


def one_line(error: BaseException) -> str:
    """What an error says, in one line: ours as it is, others behind the name of their class."""
    if isinstance(error, TmcaError):
        return str(error)
    return _shortened(f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": "))


class DataError(TmcaError):
    """A file whose content is not what it should be."""


class ShapeError(TmcaError, ValueError):
    """An array whose shape does not fit the camera, the codes or the other array."""


class SettingError(TmcaError, ValueError):
    """A parameter, option or description with an impossible value."""


class OutputError(TmcaError):
    """An output that exists already or cannot be written."""


class DeviceError(TmcaError):
    """A device that does not do what it is told."""


def check_shape(where: object, found: Any, expected: Sequence[Any], remedy: str = "") -> None:
    """Raise ShapeError unless an array has the shape that is expected.

    Args:
        where: see ``TmcaError``.
        found: an array or a tensor, or a shape.
        expected: size of every axis: a number, or a letter for any size above 0, which is the same wherever the letter
            is; ``...`` at the beginning stands for any axes.
        remedy: see ``TmcaError``.
    """
    shape = getattr(found, "shape", found)
    if not isinstance(shape, Sequence) or not _fits(shape, expected):
        text = f"shape {tuple(shape)}" if isinstance(shape, Sequence) else f"a {type(found).__name__}"
        sizes = ", ".join("…" if size is ... else str(size) for size in expected)
        raise ShapeError(where, text, f"({sizes})", remedy)


def _fits(shape: Sequence[int], expected: Sequence[Any]) -> bool:
    if expected and expected[0] is ...:
        expected = expected[1:]
        shape = shape[max(0, len(shape) - len(expected)) :]
    letters: dict[Any, int] = {}
    return len(shape) == len(expected) and all(
        size == wanted if isinstance(wanted, int) else size > 0 and letters.setdefault(wanted, size) == size
        for size, wanted in zip(shape, expected, strict=True)
    )


def check_choice(where: object, value: object, choices: Iterable[object]) -> None:
    """Raise SettingError unless a value is one of the choices."""
    known = list(choices)
    if value not in known:
        remedy = did_you_mean(str(value), map(str, known))
        raise SettingError(where, repr(value), f"one of {', '.join(map(str, known))}", remedy)


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """The remedy for a name that may be misspelt: the nearest one that there is, if any is near."""
    from difflib import get_close_matches

    near = get_close_matches(name, list(known), 1)
    return f"did you mean {near[0]}?" if near else otherwise


def check_range(
    where: object,
    value: object,
    low: float | None = None,
    high: float | None = None,
    *,
    above: float | None = None,
    below: float | None = None,
    unit: str = "",
    whole: bool = False,
    remedy: str = "",
) -> None:
    """Raise SettingError unless a value is a finite number within bounds.

    Args:
        where: see ``TmcaError``.
        value: what is checked; infinity passes where ``high`` is infinite.
        low, high: bounds that are allowed themselves.
        above, below: bounds that are not.
        unit: of the value and its bounds.
        whole: whether it has to be a whole number.
        remedy: what to do about it.
    """
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not (number and _within(float(value), low, high, above, below) and (not whole or value == int(value))):  # type: ignore[arg-type, call-overload]
        text = f"{value:g}" if number else repr(value)
        bounds = _bounds(low, high, above, below, whole)
        raise SettingError(where, f"{text} {unit}".rstrip(), f"{bounds} {unit}".rstrip(), remedy)


def _within(value: float, low: float | None, high: float | None, above: float | None, below: float | None) -> bool:
    return (
        (isfinite(value) or value == high)
        and (low is None or value >= low)
        and (high is None or value <= high)
        and (above is None or value > above)
        and (below is None or value < below)
    )


def _bounds(low: float | None, high: float | None, above: float | None, below: float | None, whole: bool) -> str:
    """The bounds in words, such as ``a whole number, 1 or more``."""
    high = None if high == inf else high
    if low is not None and high is not None:
        words = [f"{low:g} to {high:g}"]
    else:
        words = [] if low is None else [f"{low:g} or more"]
        words += [] if high is None else [f"at most {high:g}"]
    words += [f"{name} {bound:g}" for name, bound in (("above", above), ("below", below)) if bound is not None]
    text = " and ".join(words)
    return ", ".join(part for part in ("a whole number" if whole else "", text) if part) or "a number"
