"""Options of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import whole

_SENSOR = Group("Sensor", sort_key=2)


@Parameter(name="*")
@dataclass(frozen=True)
class SensorOptions:
    """The sensor."""

    read_noise: Annotated[float, Parameter(group=_SENSOR)] = 0.0
    "Standard deviation in snapshot units (1 = one band or view of a white scene)."
    full_well: Annotated[float | None, Parameter(group=_SENSOR)] = None
    "Electrons at full scale; switches shot noise on."
    read_noise_electrons: Annotated[float, Parameter(group=_SENSOR)] = 0.0
    "Read noise in electrons, standard deviation; needs --full-well."
    bits: Annotated[int | None, Parameter(group=_SENSOR, converter=whole)] = None
    "Bits of the analogue-to-digital converter."
