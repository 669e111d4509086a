"""The settings of decoders: their help, and checks of the names and types of those that are given."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, get_type_hints

from tmca.errors import SettingError


@dataclass(frozen=True)
class Setting:
    """A setting of a decoder, as commands and documents show it."""

    name: str
    type: str
    default: Any
    help: str


def settings_of(decoder: type[Any]) -> list[Setting]:
    """The fields of a decoder, with what its docstring's ``Args`` say of them."""
    texts = _arguments(inspect.getdoc(decoder) or "")
    defaults = {f.name: f.default if f.default_factory is MISSING else f.default_factory() for f in fields(decoder)}
    return [
        Setting(f.name, getattr(f.type, "__name__", str(f.type)), defaults[f.name], texts.get(f.name, ""))
        for f in fields(decoder)
    ]


def _arguments(text: str) -> dict[str, str]:
    """Name → help of the section ``Args:`` of a docstring."""
    section = re.search(r"^Args:\n((?:    .*\n?|\n)+)", text, re.MULTILINE)
    entries = re.findall(r"^    (\w+): ((?:.*\n?)(?:^        .*\n?)*)", section[1] if section else "", re.MULTILINE)
    return {name: " ".join(words.split()) for name, words in entries}


def checked_settings(decoder: type[Any], given: Mapping[str, Any], *, texts: bool = False) -> dict[str, Any]:
    """Settings of a decoder, each a value of its type.

    Args:
        decoder: a subclass of ``Decoder``.
        given: values by name; ``{"tv_weight": "0.01"}`` where they are ``texts``.
        texts: whether the values are read from words.

    Raises:
        SettingError: a setting that the decoder does not have, or a value of another type.
    """
    from pydantic import ConfigDict, TypeAdapter, ValidationError

    settings, types = {setting.name: setting for setting in settings_of(decoder)}, get_type_hints(decoder)
    checked: dict[str, Any] = {}
    for name, value in given.items():
        if name not in settings:
            found = f"a setting of {decoder.name}" if value is None else f"{value} for {decoder.name}"
            remedy = "put @dataclass above its class" if name in vars(decoder) else "leave it out"
            raise SettingError(name, found, f"one of {', '.join(settings)}" if settings else "no settings", remedy)
        adapter = TypeAdapter[Any](types[name], config=ConfigDict(arbitrary_types_allowed=True))
        try:
            checked[name] = adapter.validate_strings(value) if texts else adapter.validate_python(value)
        except ValidationError:
            raise SettingError(name, repr(value), settings[name].type) from None
        if not texts and isinstance(value, str) and isinstance(checked[name], int | float):
            raise SettingError(name, repr(value), settings[name].type, "give a number, not a text")
    return checked
