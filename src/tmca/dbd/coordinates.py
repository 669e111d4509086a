"""Delays, Dopplers and angles: on a torus, where they wrap around at 1, and in metres, metres a second and degrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.errors import SettingError

Complex = NDArray[np.complexfloating[Any, Any]]
Real = NDArray[np.floating[Any]]
Whole = NDArray[np.signedinteger[Any]]
Mask = NDArray[np.bool_]

AXES = ("delay", "doppler", "angle")
LIGHT_M_S = 299_792_458.0
_TRIES = 20_000


def distance(a: ArrayLike, b: ArrayLike) -> Real:
    """The shorter way around from ``a`` to ``b``, per coordinate, 0 to 0.5; arrays broadcast."""
    apart = np.abs(np.asarray(a, float) - np.asarray(b, float)) % 1.0
    return np.minimum(apart, 1 - apart)


def centred(values: Real) -> Real:
    """The same place on the torus in −½ to ½."""
    return (np.asarray(values, float) + 0.5) % 1.0 - 0.5


def from_zero(delays: Real, frequencies: int) -> Real:
    """Delays in [0, 1), but those within half a resolution cell below one as what they are: a little under zero."""
    return delays - (delays > 1 - 0.5 / frequencies)


def separated_points(rng: np.random.Generator, count: int, separation: Sequence[float]) -> Real:
    """Uniform points that differ from each other by ``separation`` in at least one coordinate.

    Args:
        rng: random numbers.
        count: number of points.
        separation: per coordinate; ``inf`` where a coordinate may not tell two points apart.

    Returns:
        ``(count, len(separation))``.

    Raises:
        SettingError: so many points do not fit this far apart.
    """
    apart = np.asarray(separation)
    for _ in range(_TRIES):
        points = rng.random((count, len(apart)))
        far = (distance(points[:, None], points[None]) >= apart).any(-1)
        if np.all(far | np.eye(count, dtype=bool)):
            return points
    listed = ", ".join(f"{one:.3g}" for one in separation)
    raise SettingError("separation", f"{listed} for {count} points", "points that fit on the torus", "lower either")


def matched(estimate: Real, truth: Real) -> tuple[Whole, Whole]:
    """Pairs with the least sum of largest coordinate errors (Hungarian method): indices into both.

    Args:
        estimate: ``(n, D)``.
        truth: ``(m, D)``.
    """
    from scipy.optimize import linear_sum_assignment

    first, second = linear_sum_assignment(distance(estimate[:, None], truth[None]).max(-1, initial=0.0))
    return first, second


@dataclass(frozen=True)
class Units:
    """From normalised coordinates to seconds and hertz, metres, metres a second and degrees.

    Delays of sources whose name starts with ``radar`` are there and back.

    Args:
        delay_s: seconds of a normalised delay of one: the inverse of the frequency spacing.
        doppler_hz: hertz of a normalised Doppler of one: the pulse repetition frequency.
        carrier_hz: carrier frequency, for velocities.
        spacing: antenna spacing in wavelengths, for angles.
    """

    delay_s: float
    doppler_hz: float
    carrier_hz: float
    spacing: float = 0.5

    def physical(self, values: Real, axis: int, name: str) -> Real:
        """Normalised delays (axis 0) in metres, Dopplers (1) of −½ to ½ in metres a second, angles (2) in degrees."""
        values = np.asarray(values, float)
        ways = 2.0 if is_radar(name) else 1.0
        if axis == 0:
            return values * self.delay_s * LIGHT_M_S / ways
        if axis == 1:
            return values * self.doppler_hz * LIGHT_M_S / (ways * self.carrier_hz)
        return np.rad2deg(np.arcsin(np.clip(values / self.spacing, -1, 1)))

    def deviation(self, values: Real, deviations: Real, axis: int, name: str) -> Real:
        """Standard deviations of normalised coordinates at ``values`` in the units of :meth:`physical`."""
        if axis < 2:
            return deviations * self.physical(np.array(1.0), axis, name)
        cosine = np.sqrt(np.maximum(1 - (values / self.spacing) ** 2, 0))
        with np.errstate(divide="ignore"):
            return np.rad2deg(deviations / (self.spacing * cosine))


def is_radar(name: str) -> bool:
    """Whether the delays of a source are there and back."""
    return name.startswith("radar")
