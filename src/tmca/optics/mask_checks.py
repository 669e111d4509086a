"""What a mask does that its simulation cannot follow: light beyond the window, surfaces steeper than their pixels."""

from __future__ import annotations

from math import pi
from warnings import warn

import torch
from torch import Tensor

from tmca.optics.heights import HeightMaps, RotationalProfile, ZernikeHeights
from tmca.optics.point_spread import PointSpread
from tmca.optics.propagation import Undersampled
from tmca.optics.zernike import pupil_coordinates

STEEP = 0.01
"""Share of neighbouring mask pixels that may be more than half a wave apart: point spread functions are then off by up
to 0.04 of their light, and by 2 to 4 times the share beyond (against 256 pixels a side, Zernike masks of 50 to 500 nm
on both preset benches)."""


class StrayLight(UserWarning):
    """A window that holds too little of a point's light."""


def check_mask(spread: PointSpread) -> None:
    """Warns of what ``stray_light`` and ``steep_share`` find.

    Warns:
        StrayLight: light beyond the window.
        Undersampled: a surface steeper than its pixels.
    """
    stray_light(spread, stacklevel=3)
    share = steep_share(spread.heights, spread.per_metre)
    if share > STEEP:
        pixels = max(spread.heights.size)
        found = f"mask: {share:.1%} of {pixels}×{pixels} pixels are more than half a wave from the next one"
        remedy = "their light folds back into the window; take more mask pixels, or a smoother mask"
        warn(f"{found}, {STEEP:.0%} is allowed: {remedy}", Undersampled, stacklevel=2)


@torch.no_grad()
def steep_share(heights: HeightMaps, per_metre: Tensor) -> float:
    """Share of neighbouring pixels in the aperture that differ by more than half a wave of the shortest wavelength.

    Of smooth surfaces only: a free-form map is what its pixels are, and what it sends where is exact.

    Args:
        heights: K maps.
        per_metre: (L,) of ``radians_per_metre``.
    """
    if not isinstance(heights, ZernikeHeights | RotationalProfile):
        return 0.0
    phase = heights() * per_metre.abs().max()
    inside = pupil_coordinates(heights.size)[0].to(phase.device) <= 1
    rows = phase.diff(dim=1)[:, inside[1:] & inside[:-1]]
    columns = phase.diff(dim=2)[:, inside[:, 1:] & inside[:, :-1]]
    return float((torch.cat((rows, columns), 1).abs() > pi).double().mean())


def stray_light(spread: PointSpread, stacklevel: int = 2) -> Tensor:
    """(K, D, L) share of the light behind the aperture that misses the window; it is lost with ``energy="aperture"``.

    Warns:
        StrayLight: more than a tenth, of any slot, depth and wavelength.
    """
    with torch.no_grad():
        missed = 1 - spread.arrived()
    if float(missed.max()) > 0.1:
        found = f"the window misses up to {float(missed.max()):.0%} of a point's light; "
        warn(found + "take a larger one, or a mask of coarser structures", StrayLight, stacklevel=stacklevel + 1)
    return missed
