"""Which decoders there are: those of this package and of plug-ins, each complete and under a name of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tmca.errors import SettingError

DECODERS: dict[str, Any] = {}
"""Every decoder class by its name; `tmca.decoders.decoders` also has those of plug-ins."""


def register(decoder: Any) -> None:
    """Take a decoder class into the registry.

    Raises:
        SettingError: a part of it is missing, or another module has a decoder of that name.
    """
    where = f"{decoder.__module__}.{decoder.__qualname__}"
    _check_parts(decoder, where)
    before = DECODERS.get(decoder.name)
    if before is not None and before.__module__ != decoder.__module__:
        raise SettingError(f"{where}.name", f"{decoder.name!r}, which {before.__module__} has", "a name of its own")
    decoder.cameras = frozenset(decoder.cameras)
    DECODERS[decoder.name] = decoder


def _check_parts(decoder: Any, where: str) -> None:
    """Raises SettingError unless there are a name, a label, kinds of cameras and a way to reconstruct."""
    for part in ("name", "label"):
        value = getattr(decoder, part, None)
        if not (isinstance(value, str) and value):
            raise SettingError(f"{where}.{part}", repr(value), "a short text", "give the class one")
    cameras = getattr(decoder, "cameras", None)
    if not isinstance(cameras, Iterable) or isinstance(cameras, str) or not all(isinstance(k, str) for k in cameras):
        raise SettingError(f"{where}.cameras", repr(cameras), "a set of kinds of cameras", 'such as {"spectral"}')
    if getattr(decoder.reconstruct, "__isabstractmethod__", False):
        raise SettingError(f"{where}.reconstruct", "no such method", "one", "define it in the class")
