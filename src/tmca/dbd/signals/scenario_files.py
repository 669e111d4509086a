"""Scenarios as YAML, and the ones that come with the package."""

from __future__ import annotations

from dataclasses import MISSING, fields
from pathlib import Path as FilePath
from typing import Any

from tmca.dbd.signals.scenario import Scenario
from tmca.dbd.signals.ways import Path, Target
from tmca.errors import DataError, SettingError

_WHOLE = ("pulses", "subspace", "antennas", "seed")
_FOLDER = FilePath(__file__).parent / "scenarios"


def scenario_names() -> list[str]:
    """Scenarios that come with the package."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def read_scenario(source: str | FilePath) -> Scenario:
    """A scenario by its name, or from a YAML file of :class:`Scenario`'s arguments with lists of targets and paths.

    Raises:
        DataError: no such file or name, or a file that is no such description.
        SettingError: values that make no scenario.
    """
    import yaml

    named = _FOLDER / f"{source}.yaml"
    file = named if named.is_file() else FilePath(source)
    if not file.is_file():
        raise DataError(source, "no such file", f"a YAML file, or one of {', '.join(scenario_names())}")
    try:
        described = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise DataError(file, f"no YAML ({str(error).splitlines()[0]})", "a description of a scenario") from error
    return _scenario(file, described)


def _scenario(file: FilePath, described: Any) -> Scenario:
    if not isinstance(described, dict):
        raise DataError(file, f"{type(described).__name__}", "names and values, such as bandwidth_hz: 10e6")
    channels = {name: described.pop(name, None) or [] for name in ("targets", "paths")}
    for name, listed in channels.items():
        if not isinstance(listed, list):
            raise DataError(file, f"{name}: {listed!r}", f"a list of {name}, each on its own")
    targets = [_checked(file, f"target {index + 1}", one, Target) for index, one in enumerate(channels["targets"])]
    paths = [_checked(file, f"path {index + 1}", one, Path) for index, one in enumerate(channels["paths"])]
    scenario: Scenario = _checked(file, "the scenario", {"targets": targets, "paths": paths, **described}, Scenario)
    return scenario


def _checked(file: FilePath, what: str, values: Any, kind: type) -> Any:
    """An object of a dataclass from described values; numbers written as text (``10e6`` in YAML 1.1) are numbers."""
    named = {one.name: one for one in fields(kind) if one.init}
    needed = [name for name, one in named.items() if one.default is MISSING]
    if not isinstance(values, dict) or set(values) - set(named) or set(needed) - set(values):
        found = ", ".join(map(str, values)) if isinstance(values, dict) else repr(values)
        raise DataError(file, f"{what} of {found}", f"{', '.join(needed)}, and maybe others of {', '.join(named)}")
    numbers = {name: _value(name, value) for name, value in values.items()}
    for name, value in numbers.items():
        if value is None and not (values[name] is None and named[name].default is None):
            raise DataError(file, f"{name} {values[name]!r} of {what}", "a number")
    try:
        return kind(**numbers)
    except SettingError as error:
        raise type(error)(f"{file}, {error.where}", error.found, error.expected, error.remedy) from error


def _value(name: str, value: Any) -> Any:
    """A value as the dataclasses want it: whole numbers, complex gains, text of numbers; None where it is no number."""
    if name in ("targets", "paths", "messages"):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        if name == "gain":
            return complex(str(value).replace(" ", ""))
        number = float(value)
        return int(number) if name in _WHOLE and number == int(number) else number
    except (ValueError, OverflowError):
        return None
