"""Options of a search for codes: the sensor and its modulator, and what is searched."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import MaybeWhole, Whole
from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    from tmca.design import SensorSheet

_SHEET = Group("Sensor and modulator", sort_key=1)
_SEARCH = Group("Search", sort_key=2)
_Number = Annotated[float | None, Parameter(group=_SHEET)]
_Share = Annotated[float | None, Parameter(group=_SEARCH)]


@Parameter(name="*")
@dataclass(frozen=True)
class SheetOptions:
    """The sensor and its modulator."""

    sensor: Annotated[Path | None, Parameter(group=_SHEET)] = None
    "YAML file with the names of this group; options replace its values."
    full_well: _Number = None
    "Electrons at full scale; switches shot noise on."
    read_noise_electrons: _Number = None
    "Read noise in electrons, standard deviation."
    read_noise: _Number = None
    "Read noise in snapshot units (1 = one band or view of a white scene) where electrons are not known."
    bits: Annotated[MaybeWhole, Parameter(group=_SHEET)] = None
    "Of the analogue-to-digital converter."
    exposure: _Number = None
    "Time of a snapshot, seconds."
    pattern_rate: _Number = None
    "Most patterns per second of aperture (mask) and shutter, Hz."
    slot_time: _Number = None
    "Shortest time a pattern may be shown, seconds."

    def sheet(self) -> SensorSheet:
        """What the file says, replaced by the options."""
        return _sheet(self.sensor, {k: v for k, v in vars(self).items() if k != "sensor" and v is not None})


@Parameter(name="*")
@dataclass(frozen=True)
class SearchOptions:
    """What is searched."""

    split: Annotated[Path | None, Parameter(group=_SEARCH)] = None
    "Split file whose scenes are added."
    slots: Annotated[str | None, Parameter(group=_SEARCH)] = None
    "Numbers of slots to try, separated by commas. [default: those of 2, 4, 8, 16 that fit the exposure]"
    kinds: Annotated[str, Parameter(group=_SEARCH)] = "free,one-hot"
    """Structures of codes to try: free, one-hot, complementary, blue-noise, s-matrix; open-shutter where each pixel
    cannot have a shutter of its own, static-aperture where the mask stands still."""
    throughput: _Share = None
    "Share of light that codes shall let through, as near as their kind allows. [default: free]"
    light: _Share = None
    """Mean irradiance that SCENES are dimmed to before codes are searched, share of white: the same scenes under less
    light, where noise weighs more. [default: as they are]"""
    seed: Annotated[Whole, Parameter(group=_SEARCH)] = 0
    "Of random codes."
    overwrite: Annotated[bool, Parameter(group=_SEARCH, negative="")] = False
    "Replace files that exist."

    def scenes(self, named: Sequence[str]) -> list[str]:
        """Named ones and those of the split."""
        from tmca.data import read_split

        return [*named, *(map(str, read_split(self.split)) if self.split else ())]

    def search(self) -> dict[str, Any]:
        """Arguments of ``design_codes``."""
        own = {name: getattr(self, name) for name in ("throughput", "light", "seed", "overwrite")}
        return {
            **own,
            "slots": whole_numbers(self.slots),
            "kinds": [kind.strip() for kind in self.kinds.split(",")],
            "command": ["tmca", *sys.argv[1:]],
        }


def whole_numbers(text: str | None) -> list[int] | None:
    """Slots that an option lists."""
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise SettingError("--slots", repr(text), "whole numbers separated by commas") from None


def _sheet(file: Path | None, options: dict[str, Any]) -> Any:
    """The sensor's sheet from a YAML file and options."""
    import yaml

    from tmca.design import SensorSheet

    known = list(SensorSheet.__dataclass_fields__)
    described: Any = {}
    if file is not None:
        try:
            described = yaml.safe_load(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise DataError(file, "no such file", f"YAML with some of {', '.join(known)}") from None
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise DataError(file, f"no readable YAML ({error})", f"some of {', '.join(known)}") from None
        if not isinstance(described, dict):
            raise DataError(file, f"a {type(described).__name__}", "names and values, such as full_well: 10000")
    for name, value in described.items():
        if name not in known:
            raise DataError(file or "sensor", f"{name}", f"some of {', '.join(known)}")
        described[name] = _number(file, name, value)
    known_values = {name: value for name, value in described.items() if value is not None}
    return SensorSheet(**{**known_values, **options})


def _number(file: Path | None, name: str, value: Any) -> float | int | None:
    try:
        if isinstance(value, bool):
            raise TypeError
        number = None if value is None else float(value)
    except (TypeError, ValueError):
        raise DataError(file or "sensor", f"{name} = {value}", "a number") from None
    if name != "bits" or number is None:
        return number
    if not number.is_integer():
        raise DataError(file or "sensor", f"bits = {value}", "a whole number")
    return int(number)
