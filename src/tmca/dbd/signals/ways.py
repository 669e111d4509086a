"""What delays, shifts and scales a signal on its way to the receiver: targets of a radar, paths of a transmitter."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from tmca.dbd.physical import LIGHT_M_S
from tmca.errors import SettingError


class Way(Protocol):
    """Something that delays, shifts and scales a signal."""

    @property
    def gain(self) -> complex: ...

    @property
    def angle_deg(self) -> float: ...

    @property
    def velocity_m_s(self) -> float: ...

    @property
    def delay_s(self) -> float: ...

    def doppler_hz(self, carrier_hz: float) -> float: ...


def _check_finite(way: Target | Path) -> None:
    for one in fields(way):
        value = getattr(way, one.name)
        if not np.isfinite(value):
            raise SettingError(f"{one.name} of a {type(way).__name__.lower()}", f"{value}", "a finite number")


@dataclass(frozen=True)
class Target:
    """A point target of the radar.

    Args:
        range_m: distance.
        velocity_m_s: radial, positive away.
        gain: complex amplitude of the echo; one is as strong as a communications path of gain one.
        angle_deg: from the broadside of the array.

    Raises:
        SettingError: a number that is not finite.
    """

    range_m: float
    velocity_m_s: float
    gain: complex = 1.0
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_finite(self)

    @property
    def delay_s(self) -> float:
        """There and back."""
        return 2 * self.range_m / LIGHT_M_S

    def doppler_hz(self, carrier_hz: float) -> float:
        """``2 f v / c``."""
        return 2 * carrier_hz * self.velocity_m_s / LIGHT_M_S


@dataclass(frozen=True)
class Path:
    """A path from the communications transmitter to the receiver.

    Args:
        length_m: of the whole way.
        velocity_m_s: by which the way grows.
        gain: complex amplitude.
        angle_deg: of arrival.

    Raises:
        SettingError: a number that is not finite.
    """

    length_m: float
    velocity_m_s: float
    gain: complex = 1.0
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_finite(self)

    @property
    def delay_s(self) -> float:
        """One way."""
        return self.length_m / LIGHT_M_S

    def doppler_hz(self, carrier_hz: float) -> float:
        """``f v / c``."""
        return carrier_hz * self.velocity_m_s / LIGHT_M_S
