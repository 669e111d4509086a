"""The kinds of files that the package reads: for each one a maker of a small good file and a reader of it.

A kind joins by one line, in the module of its room: ``kind("codes.nc", make_codes, read_codes)``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Kind:
    """One kind of file or folder.

    Attributes:
        name: of the file or folder; its suffix decides how it is damaged.
        make: writes a small good one at a path.
        read: reads it as users do and gives what was read: arrays, tensors, datasets, numbers, or holders of them.
        infinite: whether a good one holds numbers that are not finite.
    """

    name: str
    make: Callable[[Path], object]
    read: Callable[[Path], Any]
    infinite: bool = False


KINDS: dict[str, Kind] = {}


def kind(name: str, make: Callable[[Path], object], read: Callable[[Path], Any], infinite: bool = False) -> None:
    """Register a kind; see `Kind`."""
    assert name not in KINDS, name
    KINDS[name] = Kind(name, make, read, infinite)


def load_kinds() -> None:
    """Import every room, which registers its kinds; a new room joins here, the viewer's, which opens theirs, last."""
    for room in ("formats", "own", "lab", "settings", "viewer"):
        import_module(f"tests.fuzz.kinds_{room}")
