"""One scene's inverse depth onto the range that a camera is designed for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    import xarray as xr


def fitted_depth(
    depth: xr.DataArray, near: float, far: float, *, percentiles: tuple[float, float] = (0.0, 100.0)
) -> tuple[xr.DataArray, dict[str, Any]]:
    """Map a scene's inverse depth affinely onto a design range: ``1/Z' = scale / Z + shift``.

    A room of metres then fits a camera designed for a table top, with its edges and slopes; what the map was is told
    in attributes, for tables. A scene of one depth keeps its scale and comes to the middle of the range.

    Args:
        depth: ``(y, x)`` metres, NaN where unknown, as from `label_depth`.
        near, far: the range in metres; the nearest known pixel is mapped to ``near``, the farthest to ``far``.
        percentiles: of inverse depth, (farthest, nearest), that are mapped there instead of the extremes. What lies
            beyond stays beyond (nothing is clamped) and is counted; beyond infinity it is unknown.

    Returns:
        The mapped depth, and the attributes that it has too: ``inverse_depth_scale``, ``inverse_depth_shift`` (1/m),
        ``design_near`` and ``design_far`` (m), ``fitted_percentiles``, ``source_near`` and ``source_far`` (m, the
        depths that were mapped there), ``unknown_pixels``, ``outside_pixels`` (known, but outside the range).

    Raises:
        SettingError: an impossible range or percentiles.
        DataError: no known depth.
    """
    check_range(near, far)
    low, high = percentiles
    if not 0 <= low < high <= 100:
        raise SettingError("percentiles", repr(percentiles), "(farthest, nearest) with 0 ≤ farthest < nearest ≤ 100")
    values = depth.values.astype(np.float64)
    known = np.isfinite(values) & (values > 0)
    if not known.any():
        raise DataError(depth.attrs.get("source", "depth"), "no known depth", "some positive, finite metres")
    inverse = 1 / np.where(known, values, 1.0)
    ends = np.percentile(inverse[known], [low, high])
    scale, shift = _affine(ends, near, far)
    mapped = scale * inverse + shift
    usable = known & (mapped > 0)
    fitted = np.where(usable, 1 / np.where(usable, mapped, 1.0), np.nan)
    about = {
        "inverse_depth_scale": scale, "inverse_depth_shift": shift,
        "design_near": float(near), "design_far": float(far), "fitted_percentiles": [float(low), float(high)],
        "source_near": float(1 / ends[1]), "source_far": float(1 / ends[0]),
        "unknown_pixels": int(np.sum(~usable)), "outside_pixels": _outside(mapped[known], near, far),
    }  # fmt: skip
    return depth.copy(data=fitted.astype(np.float32)).assign_attrs(about), about


def _outside(inverse: NDArray[np.float64], near: float, far: float) -> int:
    """How many inverse depths are beyond a range by more than rounding."""
    tolerance = 1e-6 * (1 / near - 1 / far)
    return int(np.sum((inverse < 1 / far - tolerance) | (inverse > 1 / near + tolerance)))


def _affine(ends: NDArray[np.float64], near: float, far: float) -> tuple[float, float]:
    """Scale and shift that bring two inverse depths to the ends of a range; one depth to its middle."""
    if ends[1] - ends[0] <= 1e-9 * ends[1]:
        return 1.0, float((1 / near + 1 / far) / 2 - ends.mean())
    scale = (1 / near - 1 / far) / (ends[1] - ends[0])
    return float(scale), float(1 / far - scale * ends[0])


def check_range(near: float, far: float) -> None:
    """Raises SettingError unless both are finite depths in front of the camera, ``near`` before ``far``."""
    if not (np.isfinite(near) and np.isfinite(far) and 0 < near < far):
        raise SettingError("near, far", f"{near:g} m, {far:g} m", "0 < near < far, both finite")
