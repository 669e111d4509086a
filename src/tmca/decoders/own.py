"""Decoder classes of files of one's own, ``FILE.py:Class`` and ``FILE.pt2``."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tmca.decoders.registry import DECODERS, complete, register
from tmca.plugins import class_from_file, file_of, names_a_file

_PROGRAM = ".pt2"
_PROGRAMS = "tmca.lab.decoder_files"
"""Makes decoders of programs; it lies above this room, and is imported where a program is named."""

_UNNAMED: set[type[Any]] = set()
"""Classes that do not say their name."""


def is_file(text: str) -> bool:
    """Whether a text names a decoder of a file, and not one that is registered."""
    return names_a_file(text) or text.endswith(_PROGRAM)


def class_of_file(text: str, base: type) -> Any:
    """A decoder class of ``FILE.py:Class``, which runs the file, or of ``FILE.pt2``, whose operators are checked.

    Raises:
        SettingError: as `decoder_of_file`, or no such file.
        DataError: no program of a decoder.
    """
    return import_module(_PROGRAMS).exported(text) if text.endswith(_PROGRAM) else decoder_of_file(text, base)


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
