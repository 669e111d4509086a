"""Which pixels have a depth to be trusted, and why the others have none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tmca.lab.structured_light.fringes import FringePlan
from tmca.lab.structured_light.phase import Array, Phases

REASONS = ("known", "saturated", "dark", "frequencies disagree", "mixed light", "out of range", "alone")
"""What ``confidence`` says of a pixel, by its number."""
Why = NDArray[np.uint8]
_DARKEST, _RISK = 0.35, np.pi / 4
"""Radians: a phase less certain than the first is dark; a fringe's number is sure where the phase that the coarser
fringes foretell is known to the second, four times within half a turn."""
_MIXED = 0.6
"""Modulation of the finest fringes, relative to the coarsest and to the usual of all pixels, that edges fall below."""
_DISAGREE = 4.0
_MARGIN = 0.25
"""Finest fringes at either end of the projector that are left out: noise takes them to the other end."""
_STEEP = 4.0


def by_light(phases: Phases, saturated: NDArray[np.bool_]) -> Why:
    """Saturated, dark and mixed pixels ``(H, W)``, as numbers of `REASONS`.

    Light of two surfaces with different phases adds up to weaker fringes, the finer the weaker.
    """
    why = np.zeros(saturated.shape, dtype=np.uint8)
    dark = phases.std > _DARKEST
    if len(phases.modulation) > 1:
        share = phases.modulation[-1] / np.maximum(phases.modulation[0], np.finfo(float).tiny)
        clear = ~dark.any(axis=0)
        why[share < _MIXED * (np.median(share[clear]) if clear.any() else 1.0)] = REASONS.index("mixed light")
    why[dark[-1] | dark[0]] = REASONS.index("dark")
    why[saturated] = REASONS.index("saturated")
    return why


def by_frequencies(why: Why, disagreement: Array, risk: Array) -> Why:
    """Adds pixels whose frequencies tell different phases, or are too noisy to number the fringes."""
    found = why.copy()
    found[(why == 0) & (disagreement > _DISAGREE)] = REASONS.index("frequencies disagree")
    found[(why == 0) & ~(risk <= _RISK)] = REASONS.index("dark")
    return found


def by_range(why: Why, depth: Array, position: Array, plan: FringePlan, ends: tuple[float, float]) -> Why:
    """Adds pixels out of range, and those lit by the ends of the fringes."""
    margin, found = _MARGIN * plan.extent / plan.fringes[-1], why.copy()
    with np.errstate(invalid="ignore"):
        inside = (depth >= ends[0]) & (depth <= ends[1])
        inside &= (position > margin) & (position < plan.extent - 1 - margin)
    found[(why == 0) & ~inside] = REASONS.index("out of range")
    return found


def by_company(why: Why, depth: Array, std: Array, focal: float, fewest: int = 6) -> Why:
    """Adds pixels whose depth fewer than ``fewest`` of their eight neighbours share.

    A pixel that sees two surfaces, or one half in shadow, has a wrong depth, and so may the two beside it along the
    edge. Neighbours share a depth if a surface less steep than 76° can join them, noise apart.

    Args:
        why: so far.
        depth: metres.
        std: of the depth.
        focal: of the camera in pixels.
        fewest: 6 takes away one pixel along straight edges, 3 keeps corners.
    """
    known = why == 0
    values, doubt = np.where(known, depth, np.nan), 4 * np.sqrt(2) * np.where(known, std, 0.0)
    padded = np.pad(values, 1, mode="edge")  # the picture's border is no edge of a surface
    company, (height, width) = np.zeros(depth.shape, dtype=int), depth.shape
    for dy, dx in ((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x):
        other = padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        reach = np.hypot(dy, dx) * _STEEP * values / focal + doubt
        with np.errstate(invalid="ignore"):
            company += np.abs(other - values) <= reach
    found = why.copy()
    found[known & (company < fewest)] = REASONS.index("alone")
    return found
