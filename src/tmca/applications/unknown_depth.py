"""Pixels of a scene whose depth a camera does not know: counted by why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.data.depth_maps import UNKNOWN_KINDS, unknown_kinds
from tmca.errors import DataError
from tmca.optics import DepthPlanes

if TYPE_CHECKING:
    import xarray as xr

KINDS = (*UNKNOWN_KINDS, "outside")
"""Why depth is unknown; counted in the attributes ``unknown_zero`` and so on of a snapshot."""
TOTAL = "unknown_depth_pixels"
"""Attribute of a snapshot: all of them."""


def unknown_depth(depth: xr.DataArray, planes: DepthPlanes) -> dict[str, int]:
    """How many pixels (y, x) are unknown, in all and by kind: no depth, or outside the range of the planes."""
    kinds = unknown_kinds(depth)
    within = planes.within(torch.from_numpy(np.array(depth.values))).numpy()
    counts = [int(np.sum(kinds == place)) for place in range(1, len(KINDS))] + [int(np.sum((kinds == 0) & ~within))]
    return {TOTAL: int(np.sum(~within)), **{f"unknown_{name}": n for name, n in zip(KINDS, counts, strict=True)}}


def said_unknown(counts: Mapping[str, Any], pixels: int) -> str:
    """``7 of 90 pixels of unknown depth (4 zero, 3 outside)`` of the counts of ``unknown_depth``."""
    each = ((counts.get(f"unknown_{name}", 0), name.replace("_", " ")) for name in KINDS)
    why = ", ".join(f"{count} {name}" for count, name in each if count)
    return f"{counts[TOTAL]} of {pixels} pixels of unknown depth" + (f" ({why})" if why else "")


def check_depth_known(counts: Mapping[str, int], pixels: int, planes: DepthPlanes, where: str) -> None:
    """Raises DataError where no pixel of a scene has a depth that the camera knows."""
    if counts[TOTAL] == pixels:
        expected = f"some within {planes.near:g} to {planes.far:g} m, the camera's depth range"
        remedy = "choose another range (--depth), or map depth onto it (no --metric-depth)"
        raise DataError(where, said_unknown(counts, pixels), expected, remedy)
