"""Normalised coordinates in metres, metres a second and degrees."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tmca.dbd.arrays import Real

if TYPE_CHECKING:
    from tmca.dbd.problem import Units

LIGHT_M_S = 299_792_458.0


def is_radar(name: str) -> bool:
    """Whether the delays of a source are there and back: those of sources whose name starts with ``radar``."""
    return name.startswith("radar")


def physical(values: Real, axis: int, name: str, units: Units) -> Real:
    """Normalised delays (axis 0) in metres, Dopplers (1) of −½ to ½ in metres a second, angles (2) in degrees."""
    values = np.asarray(values, float)
    ways = 2.0 if is_radar(name) else 1.0
    if axis == 0:
        return values * units.delay_s * LIGHT_M_S / ways
    if axis == 1:
        return values * units.doppler_hz * LIGHT_M_S / (ways * units.carrier_hz)
    return np.rad2deg(np.arcsin(np.clip(values / units.spacing, -1, 1)))


def deviation(values: Real, spreads: Real, axis: int, name: str, units: Units) -> Real:
    """Standard deviations of normalised coordinates at ``values`` in the units of :func:`physical`."""
    if axis < 2:
        return spreads * (physical(np.array(0.25), axis, name, units) / 0.25)
    cosine = np.sqrt(np.maximum(1 - (values / units.spacing) ** 2, 0))
    with np.errstate(divide="ignore"):
        return np.rad2deg(spreads / (units.spacing * cosine))


def key(axis: int, name: str) -> str:
    """The name of a physical coordinate in tables and files."""
    return ("range_m" if is_radar(name) else "length_m", "velocity_m_s", "angle_deg")[axis]


def centred(values: Real) -> Real:
    """The same place on the torus in −½ to ½."""
    return (np.asarray(values, float) + 0.5) % 1.0 - 0.5


def from_zero(delays: Real, frequencies: int) -> Real:
    """Delays in [0, 1), but those within half a resolution cell below one as what they are: a little under zero."""
    return delays - (delays > 1 - 0.5 / frequencies)
