"""Decoder classes of files of one's own, ``FILE.py:Class``."""

from __future__ import annotations

from typing import Any

from tmca.decoders.registry import DECODERS, complete, register
from tmca.plugins import class_from_file, file_of

_UNNAMED: set[type[Any]] = set()
"""Classes that do not say their name."""


def decoder_of_file(text: str, base: type, where: str = "decoder", name: str = "") -> Any:
    """A decoder class of a file, registered. This runs the file: call it with what somebody typed.

    Its name is that of the class, and it is for all cameras, where it does not say.

    Args:
        text: ``FILE.py:Class``.
        base: what it has to be a subclass of.
        where: the option or argument, for errors.
        name: of a class that does not say its own, in the place of its class's.

    Raises:
        SettingError: no such class, one that is no decoder, or one of a name that is taken.
    """
    cls: Any = class_from_file(text, base, where)
    own = vars(cls)
    if "name" not in own or cls in _UNNAMED:  # one that it inherits is another decoder's
        _UNNAMED.add(cls)
        cls.name, before = name or cls.__name__, own.get("name")
        if "label" not in own or cls.label == before:
            cls.label = cls.name
    elif "label" not in own:
        cls.label = cls.name
    complete(cls)
    for known in [known for known, other in DECODERS.items() if other is cls]:
        DECODERS.pop(known)
    if cls.name in DECODERS and file_of(DECODERS[cls.name]):  # of another file, that was named before
        DECODERS.pop(cls.name)
    register(cls)
    return cls
