"""How far neighbouring views are shifted: a check of orientation, and facts about a light field."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import ShapeError

if TYPE_CHECKING:
    import xarray

_BLOCKS = 6
"""Blocks per axis, at most: enough to tell signs, few enough to take a second."""


def view_shifts(light_field: xarray.DataArray, block: int = 64) -> NDArray[np.float64]:
    """Disparity of blocks of the centre view, once from its neighbours in the column and once from those in the row.

    By phase correlation of the views one step before and one after. In the package's orientation both are
    equal up to noise and occlusion; opposite signs mean that one axis of the grid runs the other way.

    Args:
        light_field: grey, ``(view_v, view_u, y, x)``, 3×3 views or more.
        block: pixels per side, at most those of a view.

    Returns:
        ``(N, 2)`` in px per view step: along view rows and y, along view columns and x; blocks without texture are
        left out.

    Raises:
        ShapeError: fewer than 3×3 views, or in colour.
    """
    if light_field.ndim != 4 or min(light_field.shape[:2]) < 3:
        raise ShapeError("light_field", f"{light_field.dims} {light_field.shape}", "3×3 grey views or more")
    views = light_field.values
    v, u = (n // 2 for n in views.shape[:2])
    size = min(block, *views.shape[2:])
    window = np.hanning(size + 2)[1:-1]
    found = []
    for y in _starts(views.shape[2], size):
        for x in _starts(views.shape[3], size):
            part = views[v - 1 : v + 2, u - 1 : u + 2, y : y + size, x : x + size].astype(np.float64)
            if part[1, 1].std() > 0.01:
                part = (part - part.mean(axis=(2, 3), keepdims=True)) * window[:, None] * window
                found.append((_shift(part[0, 1], part[2, 1])[0] / 2, _shift(part[1, 0], part[1, 2])[1] / 2))
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _starts(length: int, size: int) -> list[int]:
    count = min(_BLOCKS, length // size)
    return sorted({round(start) for start in np.linspace(0, length - size, count)})


def _shift(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far (y, x) one must move ``after`` to bring it onto ``before``, in px to a twentieth."""
    from skimage.registration import phase_cross_correlation

    return np.asarray(phase_cross_correlation(before, after, upsample_factor=20)[0])


def agreement(shifts: NDArray[np.float64]) -> float | None:
    """Correlation about zero of the two columns of `view_shifts`: 1 where they are equal, -1 where one axis runs the
    other way, None where nothing is shifted."""
    power = float(np.sqrt(np.prod((shifts**2).sum(axis=0))))
    return float((shifts[:, 0] * shifts[:, 1]).sum()) / power if power else None


def shift_facts(light_field: xarray.DataArray) -> dict[str, Any]:
    """Median and range of the disparity along each axis, and whether the axes agree; {} where nothing is shifted."""
    shifts = view_shifts(light_field)
    agree = agreement(shifts)
    if agree is None:
        return {}
    low, high = np.percentile(shifts, [5, 95])
    facts: dict[str, Any] = {
        "median_rows": float(np.median(shifts[:, 0])),
        "median_columns": float(np.median(shifts[:, 1])),
        "low": float(low),
        "high": float(high),
        "agreement": agree,
    }
    if agree < -0.5:
        facts["note"] = (
            "rows and columns run in opposite senses: read it with {-row} or {-column} in pattern= (--pattern)"
        )
    return facts
