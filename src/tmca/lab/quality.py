"""How good a measurement is: its residuals held against what good captures leave."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple


class Doubtful(UserWarning):
    """A residual beyond what good captures leave."""


class Limit(NamedTuple):
    """What good captures leave of a residual.

    Args:
        most: largest magnitude.
        hint: what to look at beyond it.
    """

    most: float
    hint: str


Limits = Mapping[str, Limit]


def quality_of(residuals: Mapping[str, float], limits: Limits) -> float:
    """The largest residual over its limit: above 1 something may be wrong with the captures."""
    shares = [abs(residuals[name]) / limit.most for name, limit in limits.items() if name in residuals]
    return float(max((share for share in shares if share == share), default=0.0))


def doubts(residuals: Mapping[str, float], limits: Limits) -> list[str]:
    """A line on every residual beyond its limit."""
    beyond = [(name, limit) for name, limit in limits.items() if abs(residuals.get(name, 0.0)) > limit.most]
    return [
        f"{name.replace('_', ' ')} {residuals[name]:.3g}, usually {most:g} at most: {hint}"
        for name, (most, hint) in beyond
    ]


def warn_of(source: object, residuals: Mapping[str, float], limits: Limits) -> None:
    """A warning for every residual beyond its limit."""
    for line in doubts(residuals, limits):
        warnings.warn(f"{source}: {line}", Doubtful, stacklevel=3)


def warn_of_saturation(source: object, share: float, hint: str, stacklevel: int = 3) -> None:
    """A warning of saturated pixels, where there are any: their share and what to do."""
    if share:
        warnings.warn(f"{source}: {share:.2%} of the pixels are saturated: {hint}", Doubtful, stacklevel=stacklevel)
