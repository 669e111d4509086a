"""Decoders of files: a class of one's own, ``FILE.py:Class``, and a program of `torch.export`, ``FILE.pt2``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders import Decoder
from tmca.decoders.decoder import Progress
from tmca.decoders.own import decoder_of_file, is_file
from tmca.decoders.registry import all_cameras
from tmca.errors import SettingError
from tmca.lab.checked_graph import CheckedProgram, load_program
from tmca.lab.deploy import DESCRIPTION, Description, check_camera, read_description
from tmca.plugins import names_a_file

_LOADED: dict[str, str] = {}
"""Name of a decoder that was loaded in this process → how it was named, with the whole path."""


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


def decoder_named(text: str, where: str = "decoder", name: str = "") -> str:
    """Name of a decoder, which is registered: its own, or that of a file, which is loaded now.

    This runs the code of ``FILE.py:Class``: call it with what somebody typed, never with what was read.

    Args:
        text: a name, ``FILE.py:Class`` or ``FILE.pt2``.
        where: the option, for errors.
        name: of a decoder of a file that does not say its own, in the place of its class's or its file's.

    Raises:
        SettingError: no such class, one that is no decoder, or one of a name that is taken.
        DataError: no program of a decoder.
    """
    if not is_file(text):
        return text
    cls = decoder_of_file(text, Decoder, where, name) if names_a_file(text) else exported(text, where, name)
    _LOADED[cls.name] = place_of(text)
    return str(cls.name)


def place_of(text: str) -> str:
    """``FILE.py:Class`` or ``FILE.pt2`` with the whole path; a name as it is."""
    if not is_file(text):
        return text
    path, colon, own = text.rpartition(":") if names_a_file(text) else (text, "", "")
    return f"{Path(path).expanduser().resolve()}{colon}{own}"


def decoders_named(texts: str, where: str = "decoders") -> list[str]:
    """Names of decoders that are separated by commas; see ``names_of``."""
    return [*names_of([text.strip() for text in texts.split(",") if text.strip()], where).values()]


def names_of(texts: Iterable[str], where: str = "decoders") -> dict[str, str]:
    """What was typed → name of the decoder, see ``decoder_named``; those of files that would have one name have that of
    the file, or of its folder and the file, in front of it.

    Raises:
        SettingError: a decoder twice; what ``decoder_named`` refuses.
    """
    asked = list(texts)
    places = [place_of(text) for text in asked]
    for text, place in zip(asked, places, strict=True):
        if places.count(place) > 1:
            raise SettingError(where, f"{text} twice", "each decoder once", "leave one out")
    plain = {text: decoder_named(text, where) for text in asked}
    clashing = [text for text in asked if [*plain.values()].count(plain[text]) > 1 and is_file(text)]
    for parts in (1, 2):
        longer = {text: "-".join((*_before(text)[-parts:], plain[text])) for text in clashing}
        if len({*longer.values()}) == len(longer):
            break
    named = plain | {text: decoder_named(text, where, longer[text]) for text in clashing}
    for text, name in named.items():
        if [*named.values()].count(name) > 1:
            raise SettingError(where, f"{name} twice, once as {text}", "decoders of different names", "rename a file")
    return named


def _before(text: str) -> list[str]:
    """Folder and file that tell decoders of one name apart: a program is called by its file already."""
    path = Path(place_of(text).rpartition(":")[0] if names_a_file(text) else place_of(text))
    return [path.parent.name, path.stem] if names_a_file(text) else [path.parent.parent.name, path.parent.name]


def loaded(names: Iterable[str]) -> dict[str, str]:
    """Of decoders by their names, how those of files are named, for processes that are to load them too."""
    return {name: _LOADED[name] for name in names if name in _LOADED}


def exported(file: str | Path, where: str = "decoder", name: str = "") -> type[Decoder]:
    """A decoder that computes an exported program, named after its file.

    Raises:
        SettingError: no such file.
        DataError: no program of a decoder.
    """
    path = Path(file)
    if not path.is_file():
        raise SettingError(where, f"{path}, which is no file", "a file of `tmca decoder export`")
    about = read_description(path.parent) if (path.parent / DESCRIPTION).is_file() else None
    name = name or (path.stem if about is None else path.resolve().parent.name)
    parts = {"name": name, "label": name, "cameras": all_cameras(), "about": about, "program": load_program(path)}
    return type(name, (ExportedDecoder,), {**parts, "file": str(path), "__doc__": ExportedDecoder.__doc__})
