"""Scenarios of YAML files, and what is wrong with one."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from tmca.dbd.scenario import Path, Scenario, Target
from tmca.dbd.waveforms import UNKNOWN_NAME, first_problem
from tmca.errors import DataError, TmcaError, did_you_mean
from tmca.yaml_files import read_yaml

if TYPE_CHECKING:
    from pydantic import ValidationError

_SCENARIOS = FilePath(__file__).parent / "scenarios"
_INTERVAL, _ROUNDING = "pri_s", 1e-12
"""The interval between pulses, in a file in the place of the prefix; share of it that is rounding."""


def read_scenario(source: str | FilePath) -> Scenario:
    """A scenario by its name, or from a YAML file of its arguments with lists of targets and paths.

    A file may have ``pri_s``, the interval between pulses, in the place of ``prefix_s``.

    Raises:
        DataError: no such file or name, or a file that is no such description.
        SettingError: values that make no scenario.
    """
    from pydantic import TypeAdapter, ValidationError

    named = _SCENARIOS / f"{source}.yaml"
    file = named if named.is_file() else FilePath(source)
    if not file.is_file():
        shipped = sorted(known.stem for known in _SCENARIOS.glob("*.yaml"))
        raise DataError(source, "no such file", f"a YAML file, or one of {', '.join(shipped)}")
    described = read_yaml(file, "a description of a scenario: names and values, such as bandwidth_hz: 10e6")
    described |= {name: described.get(name) or [] for name in ("targets", "paths")}
    try:
        return TypeAdapter(Scenario).validate_python(_plain(_with_prefix(file, described)))
    except ValidationError as error:
        raise _refusal(file, error) from error


def _refusal(file: FilePath, error: ValidationError) -> TmcaError:
    """What is wrong with the description in a file."""
    first = first_problem(error)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, TmcaError):
        return type(cause)(f"{file}, {cause.where}", cause.found, cause.expected, cause.remedy)
    place = ".".join(map(str, first["loc"]))
    if first["type"] == UNKNOWN_NAME:
        described_by: type[Any] = {"targets": Target, "paths": Path}.get(str(first["loc"][0]), Scenario)
        known = [one.name for one in fields(described_by)] + [_INTERVAL] * (described_by is Scenario)
        return DataError(file, place, ", ".join(known), did_you_mean(str(first["loc"][-1]), known))
    return DataError(file, f"{place} {first['input']!r}", f"a scenario: {first['msg']}")


def _with_prefix(file: FilePath, described: dict[str, Any]) -> dict[str, Any]:
    """The description with the cyclic prefix that its interval between pulses leaves, where it has one."""
    if _INTERVAL not in described:
        return described
    if "prefix_s" in described:
        raise DataError(file, f"{_INTERVAL} and prefix_s", "one of them", f"prefix_s is {_INTERVAL} - useful_s")
    rest = {name: value for name, value in described.items() if name != _INTERVAL}
    useful = described.get("useful_s", Scenario.useful_s)
    try:
        interval, prefix = float(described[_INTERVAL]), float(described[_INTERVAL]) - float(useful)
    except (TypeError, ValueError) as error:
        found = f"{_INTERVAL} {described[_INTERVAL]!r}, useful_s {useful!r}"
        raise DataError(file, found, "numbers of seconds") from error
    if not prefix >= -_ROUNDING * interval:
        raise DataError(file, f"{_INTERVAL} {interval:g}", f"{float(useful):g} s, useful_s, or more")
    return rest | {"prefix_s": max(prefix, 0.0)}


def _plain(value: Any) -> Any:
    """YAML 1.1 has text for 10e6 and 0.3 - 1j; a switch is no number."""
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return str(value).replace(" ", "") if isinstance(value, bool | str) else value
