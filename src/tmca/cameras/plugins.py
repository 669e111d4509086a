"""Cameras of other packages: what they name in the entry-point group ``tmca.cameras`` is imported when it is needed."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from warnings import warn


class BrokenCamera(UserWarning):
    """A camera of another package that cannot be loaded."""


@cache
def load_cameras() -> None:
    """Import them once: a camera, and its application, register themselves as they are defined."""
    for point in entry_points(group="tmca.cameras"):
        try:
            point.load()
        except Exception as error:
            warn(f"camera {point.name} ({point.value}) cannot be loaded: {error}", BrokenCamera, stacklevel=2)
