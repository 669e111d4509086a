"""The rooms whose kinds are known; a new room joins here."""

from __future__ import annotations

from importlib import import_module

ROOMS = ("formats", "own", "lab", "truth", "dbd", "settings")


def load_kinds() -> None:
    """Import every room, which registers its kinds."""
    for room in ROOMS:
        import_module(f"tests.fuzz.kinds_{room}")
