"""Specs of sensors: of a camera, and as a data sheet gives them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field

from tmca.errors import DataError, TmcaError
from tmca.specs.base import Spec, spec_of
from tmca.yaml_files import read_yaml

_Noise = Annotated[float, Field(ge=0, le=1e6)]


class NoiseSpec(Spec):
    """What a sensor does to light that it can hold."""

    read_noise: _Noise = 0.0
    "Standard deviation in snapshot units (1 = one band or view of a white scene)."
    full_well: Annotated[float, Field(ge=1e-3, le=1e15)] | None = None
    "Electrons at full scale; switches shot noise on."
    read_noise_electrons: _Noise = 0.0
    "Read noise in electrons, standard deviation; needs --full-well."
    bits: Annotated[int, Field(ge=1, le=32)] | None = None
    "Bits of the analogue-to-digital converter."


class SensorSpec(NoiseSpec):
    """The sensor."""

    saturates: Annotated[float, Field(gt=0, le=1)] | None = None
    "Share of full scale at which a pixel, or a bucket of it, is full; full scale where a full well or bits are given."


class SheetSpec(NoiseSpec):
    """A sensor and its modulator as their data sheets give them."""

    exposure: Annotated[float, Field(gt=0)] | None = None
    "Time of a snapshot, seconds."
    pattern_rate: Annotated[float, Field(gt=0)] | None = None
    "Most patterns per second of aperture (mask) and shutter, Hz."
    slot_time: Annotated[float, Field(gt=0)] | None = None
    "Shortest time a pattern may be shown, seconds."
    buckets: Annotated[int, Field(ge=1, le=2)] = 1
    "Buckets of a pixel, 1 or 2, each with this noise and full well: with 2, the light of closed slots is read too."


class SensorFileSpec(SensorSpec, SheetSpec):
    """A sensor, and of its modulator what a command that searches no codes passes over."""


S = TypeVar("S", bound=NoiseSpec)
_NOT_IN_ELECTRONS = re.compile("quantum|efficiency|^qe$|pixel|pitch|gain")
"""Names of what data sheets say of a sensor beside its noise in electrons."""
_IN_ELECTRONS = (
    "leave it out: full well and read noise count electrons, "
    "so that quantum efficiency, pixel size and gain do not enter"
)


def sensor_of(values: Mapping[str, Any], kind: type[S], where: object) -> S:
    """A checked sensor of the names and values of a file, of which empty values are left out.

    Raises:
        DataError: the first name or value that is wrong, behind ``where``.
    """
    try:
        return spec_of(kind, {name: value for name, value in values.items() if value is not None})
    except TmcaError as error:
        beside = error.found == "an unknown name" and _NOT_IN_ELECTRONS.search(error.where.lower())
        remedy = _IN_ELECTRONS if beside else error.remedy
        raise DataError(f"{where}: {error.where}", error.found, error.expected, remedy) from None


def read_sensor(file: str | Path, kind: type[S]) -> S:
    """A checked sensor of a YAML file.

    Raises:
        DataError: no such file, or the first of its names and values that is wrong.
    """
    return sensor_of(read_yaml(file, "YAML with names and values, such as full_well: 10000"), kind, file)
