"""The errors that tmca raises on purpose: one line that says where, what was found, what was expected, what to do."""

from __future__ import annotations


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
        self.where, self.found, self.expected, self.remedy = str(where), found, expected, remedy
        text = f"{where}: found {found}"
        if expected:
            text += f", expected {expected}"
        if remedy:
            text += f"; {remedy}"
        super().__init__(" ".join(text.split()))


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
