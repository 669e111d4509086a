"""Are the targets and paths far enough apart, all together?

A joint condition on the points of all sources, radar and communications, follows from the Beurling–Selberg extremal
functions (Monsalve, Vargas, Mishra, Sadler and Arguello, "Beurling–Selberg extremization for dual-blind deconvolution
recovery in joint radar-communications", 2022). Of N samples, the Vandermonde matrix of coordinates that are at least Δ
apart on the torus has squared singular values between ``N − 1 − 1/Δ`` and ``N − 1 + 1/Δ`` (Moitra, "Super-resolution,
extremal functions and the condition number of Vandermonde matrices", 2015, theorem 2.3): ``Δ > 1/(N − 1)`` keeps it
from being singular, whatever the number of points. Here it is asked of the delays (N = M), for which it was published,
and, by the same inequality, of the Dopplers (N = P); one of them is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, Real, distance

if TYPE_CHECKING:
    from tmca.dbd.recovery import Recovery


@dataclass(frozen=True)
class Separation:
    """How far the points of all sources are apart in one coordinate.

    Args:
        axis: ``delay`` or ``doppler``.
        least: torus distance of the two nearest points, 0 to 0.5; infinite for a single point.
        needed: that it has to exceed, ``1/(N − 1)``.
        nearest: source and number, from 0, of these two; empty for a single point.
    """

    axis: str
    least: float
    needed: float
    nearest: tuple[tuple[str, int], ...]

    @property
    def satisfied(self) -> bool:
        """Whether the joint condition holds in this coordinate."""
        return self.least > self.needed

    @property
    def condition_number(self) -> float:
        """A bound on the condition number of the points' Vandermonde matrix; infinite where the condition fails."""
        samples, inverse = 1 / self.needed, 1 / self.least
        return float(np.sqrt((samples + inverse) / (samples - inverse))) if self.satisfied else float("inf")


def joint_separation(recovery: Recovery | Sequence[Channel]) -> tuple[Separation, ...]:
    """The joint separation in every coordinate that all sources see, delays first.

    Dopplers that only count from each other's within a source cannot be compared with another source's, and are left
    out, as are coordinates of one sample.

    Args:
        recovery: or its channels, one of every source.
    """
    channels = list(recovery)
    shape = channels[0].atoms.shape
    found = []
    for axis, samples in ((0, shape[2]), (1, shape[1])):
        relative = axis == 1 and any(one.relative_doppler for one in channels)
        seen = all(axis in one.atoms.columns for one in channels)
        if samples > 2 and seen and not relative:
            found.append(_least(channels, axis, 1 / (samples - 1)))
    return tuple(found)


def _least(channels: Sequence[Channel], axis: int, needed: float) -> Separation:
    names = [(one.name, path) for one in channels for path in range(len(one))]
    if len(names) < 2:
        return Separation(AXES[axis], float("inf"), needed, ())
    values: Real = np.concatenate([one.points[:, axis] for one in channels])
    apart = distance(values[:, None], values[None])
    apart[np.diag_indices(len(values))] = np.inf
    first, second = np.unravel_index(int(np.argmin(apart)), apart.shape)
    return Separation(AXES[axis], float(apart.min()), needed, (names[first], names[second]))
