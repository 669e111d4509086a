"""Settings of a decoder on the command line: options of their own, and ``--set NAME=VALUE``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.decoders import Decoder


def given_settings(decoder: type[Decoder] | None, options: dict[str, Any]) -> dict[str, Any]:
    """Settings that have an option of their own; decoders that predict a standard deviation do, unless told not to."""
    from tmca.decoders.registry import predicts_deviation

    predicts = decoder is None or predicts_deviation(decoder)
    options = {**options, "uncertainty": (options["uncertainty"] is not False) if predicts else None}
    return {name: value for name, value in options.items() if value is not None}


def check_dictionary(file: Path, decoder: str, kind: str, available: dict[str, type[Decoder]]) -> None:
    """Raises SettingError for a dictionary beside a decoder that uses none."""
    using = [name for name, cls in available.items() if cls.prior_kind == "dictionary"]
    if decoder not in using:
        wanted = f"one for {', '.join(using)} alone" if using else f"none: no decoder of a {kind} camera uses one"
        raise SettingError("dictionary", str(file), wanted, "leave it out")


def settings_of_texts(decoder: type[Decoder] | None, texts: list[str]) -> dict[str, Any]:
    """Settings of a decoder from ``NAME=VALUE``."""
    from tmca.arguments import checked_settings

    pairs = [text.partition("=") for text in texts]
    for name, equals, _ in pairs:
        if not (name and equals):
            raise SettingError("set", repr(name), "NAME=VALUE, such as iterations=50")
    named = {name.strip(): value.strip() for name, _, value in pairs}
    return dict(named) if decoder is None else checked_settings(decoder, named, texts=True)
