"""Sensors of a study of one's own: objects, their arguments, YAML files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tmca.errors import DataError, SettingError
from tmca.evaluation.camera import Settings
from tmca.sensor import Sensor
from tmca.specs import SensorFileSpec, SensorSpec, sensor_of
from tmca.yaml_files import read_yaml


def noises_of(sensor: Any) -> dict[str, Settings]:
    """Name of a noise → arguments of its `Sensor`; an ideal one of None.

    Args:
        sensor: a `Sensor` or its arguments, several by their names, or a YAML file of either.

    Raises:
        SettingError: something else.
        DataError: as ``read_sensors``.
    """
    if sensor is None:
        return {"noise-free": {}}
    if isinstance(sensor, str | Path):
        return read_sensors(sensor)
    if isinstance(sensor, Sensor):
        return {"sensor": _arguments(sensor)}
    if not isinstance(sensor, Mapping):
        expected = "a tmca.Sensor, its arguments by their names, or a YAML file"
        raise SettingError("sensor", repr(sensor)[:60], expected)
    several = bool(sensor) and all(isinstance(one, Sensor | Mapping) for one in sensor.values())
    named = sensor if several else {"sensor": sensor}
    return {str(name): _arguments(one) if isinstance(one, Sensor) else dict(one) for name, one in named.items()}


def _arguments(sensor: Sensor) -> Settings:
    """Those of a sensor that are not as in one of its full well and bits alone."""
    given = {name: value for name in ("full_well", "bits") if (value := getattr(sensor, name)) is not None}
    plain = Sensor(**given).settings()
    return {**given, **{name: value for name, value in sensor.settings().items() if value != plain[name]}}


def read_sensors(file: str | Path) -> dict[str, Settings]:
    """Name → arguments of `Sensor` of a YAML file: of one sensor, named after the file, or of several by their names.

    Raises:
        DataError: no such file, or an entry that no sensor has.
    """
    stored, several = _stored(file)
    return {name: _sensor(f"{file}: {name}" if several else str(file), one) for name, one in stored.items()}


def _stored(file: str | Path) -> tuple[dict[str, Settings], bool]:
    """Name → entries of a sensor, and whether the file gives the names."""
    stored = read_yaml(file, "YAML with a sensor, such as full_well: 10000, or several by their names")
    if not stored:
        raise DataError(str(file), "no entry", "arguments of a sensor, such as full_well: 10000")
    several = all(isinstance(value, Mapping) for value in stored.values())
    sensors = stored if several else {Path(file).stem: stored}
    return {str(name): dict(one) for name, one in sensors.items()}, several


def _sensor(where: str, values: Mapping[str, Any]) -> Settings:
    """Checked arguments of a sensor."""
    try:
        given = sensor_of(values, SensorFileSpec, where).only(*SensorSpec.model_fields)
        Sensor(**given)
    except SettingError as error:
        raise DataError(f"{where}: {error.where}", error.found, error.expected, error.remedy) from None
    return dict(given)


def one_bucket_alone(sensor: Any, codes: Sequence[str]) -> list[str]:
    """A line about ``codes`` that need two buckets where a file of the sensor says one; nothing else."""
    if not codes or not isinstance(sensor, str | Path):
        return []
    single = [name for name, one in _stored(sensor)[0].items() if one.get("buckets") == 1]
    return [f"{sensor}: buckets: 1 ({', '.join(single)}), but two are needed by {', '.join(codes)}"] if single else []
