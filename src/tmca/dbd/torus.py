"""Points with coordinates that wrap around at 1: normalised delays, Dopplers and angles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from tmca.dbd.arrays import Real, Whole
from tmca.errors import SettingError

_TRIES = 20_000


def distance(a: ArrayLike, b: ArrayLike) -> Real:
    """The shorter way around from ``a`` to ``b``, per coordinate, 0 to 0.5; arrays broadcast."""
    apart = np.abs(np.asarray(a, float) - np.asarray(b, float)) % 1.0
    return np.minimum(apart, 1 - apart)


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

    cost = distance(estimate[:, None], truth[None]).max(-1, initial=0.0)
    found, true = linear_sum_assignment(cost)
    return found, true
