"""Decoders of files: a class of one's own, ``FILE.py:Class``, and a program of `torch.export`, ``FILE.pt2``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.cameras import CAMERAS, load_cameras
from tmca.decoders import Decoder
from tmca.decoders.decoder import Progress
from tmca.decoders.registry import DECODERS, register
from tmca.errors import SettingError
from tmca.lab.checked_graph import CheckedProgram, load_program
from tmca.lab.deploy import DESCRIPTION, Description, check_camera, read_description
from tmca.plugins import class_from_file, names_a_file

_LOADED: dict[str, str] = {}
"""Name of a decoder that was loaded in this process → how it was named, with the whole path."""


_FILES: dict[type[Any], Path] = {}
"""Files of the classes of one's own."""


class ExportedDecoder(Decoder):
    """A program of `torch.export` that makes a scene of a snapshot; operators that are not on a list are refused.

    Its subclasses have the program and, where ``decoder.json`` lies beside it, what that says of its camera.
    """

    program: ClassVar[CheckedProgram]
    about: ClassVar[Description | None]
    file: ClassVar[str]

    def setup(self, camera: Any, prior: Any) -> Any:
        if self.about is not None:
            check_camera(self.about, camera, self.file)
        return camera

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Tensor:
        dtype = torch.float32
        return torch.cat([self.program(one[None].to("cpu", dtype)) for one in values]).to(values)


def is_file(text: str) -> bool:
    """Whether a text names a decoder of a file, and not one that is registered."""
    return names_a_file(text) or text.endswith(".pt2")


def decoder_named(text: str, where: str = "decoder") -> str:
    """Name of a decoder, which is registered: its own, or that of a file, which is loaded now.

    This runs the code of ``FILE.py:Class``: call it with what somebody typed, never with what was read.

    Args:
        text: a name, ``FILE.py:Class`` or ``FILE.pt2``.
        where: the option, for errors.

    Raises:
        SettingError: no such class, one that is no decoder, or one of a name that is taken.
        DataError: no program of a decoder.
    """
    if not is_file(text):
        return text
    cls = _own(text, where) if names_a_file(text) else _exported(Path(text), where)
    path, colon, own = text.partition(".py:")
    _LOADED[cls.name] = f"{Path(f'{path}.py' if colon else path).expanduser().resolve()}{colon[3:]}{own}"
    return str(cls.name)


def decoders_named(texts: str, where: str = "decoders") -> list[str]:
    """Names of decoders that are separated by commas; see ``decoder_named``.

    Raises:
        SettingError: a decoder twice; what ``decoder_named`` refuses.
    """
    names = [decoder_named(text.strip(), where) for text in texts.split(",") if text.strip()]
    for name in names:
        if names.count(name) > 1:
            raise SettingError(where, f"{name} twice", "each decoder once", "leave one out")
    return names


def loaded(names: Iterable[str]) -> tuple[str, ...]:
    """Of decoders by their names, how those of files are named, for processes that are to load them too."""
    return tuple(_LOADED[name] for name in names if name in _LOADED)


def file_of(cls: type[Any]) -> Path | None:
    """The file that a class of one's own was loaded from; None of other classes."""
    return _FILES.get(cls)


def _own(text: str, where: str) -> type[Decoder]:
    """A class of a file; its name is that of the class, and it is for all cameras, where it does not say."""
    cls = class_from_file(text, Decoder, where)
    own = vars(cls)
    if "name" not in own:  # one that it inherits is another decoder's
        cls.name = cls.__name__
    if "label" not in own:
        cls.label = cls.name
    if not hasattr(cls, "cameras"):
        cls.cameras = _all()
    if DECODERS.get(cls.name) in _FILES:  # of another file, that was named before
        DECODERS.pop(cls.name)
    register(cls)
    _FILES[cls] = Path(text.rpartition(":")[0]).expanduser().resolve()
    return cls


def _exported(path: Path, where: str) -> type[Decoder]:
    """A decoder that computes an exported program, named after its file."""
    if not path.is_file():
        raise SettingError(where, f"{path}, which is no file", "a file of `tmca decoder export`")
    about = read_description(path.parent) if (path.parent / DESCRIPTION).is_file() else None
    name = path.stem if about is None else path.resolve().parent.name
    parts = {"name": name, "label": name, "cameras": _all(), "about": about, "program": load_program(path)}
    return type(name, (ExportedDecoder,), {**parts, "file": str(path), "__doc__": ExportedDecoder.__doc__})


def _all() -> frozenset[str]:
    load_cameras()
    return frozenset(CAMERAS)
