"""Metric depth: where a camera's ray meets the plane of light of a projector's column or row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tmca.lab.structured_light.calibration import Array, Calibration
from tmca.lab.structured_light.fringes import Across

_ROUNDS = 8


def triangulate(
    position: ArrayLike, position_std: ArrayLike, calibration: Calibration, across: Across = "x"
) -> tuple[Array, Array]:
    """Depth along the camera's axis and its standard deviation.

    A projector's column at slope p lights the plane ``(r₁ - p r₃)·X + t₁ - p t₃ = 0`` (rows r of the rotation; r₂, t₂
    for rows of pixels), which the ray ``X = Z d`` meets at ``Z = -(t₁ - p t₃) / ((r₁ - p r₃)·d)`` (Hartley and
    Zisserman, ch. 12). The projector's distortion bends the plane; it is undone where the ray meets it, a few times
    over.

    Args:
        position: ``(H, W)`` projector pixel seen by each camera pixel, x or y; NaN where unknown.
        position_std: its standard deviation in projector pixels.
        calibration: of both.
        across: along which axis of the projector.

    Returns:
        Depth and its standard deviation ``(H, W)``, metres; NaN where the position is, and where the ray misses the
        plane or meets it behind the camera.
    """
    axis = 0 if across == "x" else 1
    rays, lens = camera_rays(calibration), calibration.projector
    focal, centre = lens.matrix[axis, axis], lens.matrix[axis, 2]
    bent = (np.asarray(position, dtype=np.float64) - centre) / focal
    slope = bent
    depth, change = _meet(slope, rays, calibration, axis)
    for _ in range(_ROUNDS if lens.distortion.any() else 0):
        x, y, z = calibration.in_projector(depth * rays)
        slope = bent - lens.displacement(x / z, y / z)[axis]
        depth, change = _meet(slope, rays, calibration, axis)
    with np.errstate(invalid="ignore"):
        ahead = np.isfinite(depth) & (depth > 0)
        std = np.abs(change) / focal * np.asarray(position_std)
    return np.where(ahead, depth, np.nan), np.where(ahead, std, np.nan)


def camera_rays(calibration: Calibration) -> Array:
    """``(3, H, W)`` directions of the camera's pixels, 1 along its axis."""
    rows, columns = np.indices(calibration.camera.size, dtype=np.float64)
    x, y = calibration.camera.normalised(columns, rows)
    return np.stack([x, y, np.ones_like(x)])


def _meet(slope: Array, rays: Array, calibration: Calibration, axis: int) -> tuple[Array, Array]:
    """Depth, and its derivative by the slope."""
    own, along = (np.einsum("j,jyx->yx", calibration.rotation[row], rays) for row in (axis, 2))
    shift, ahead = calibration.translation[axis], calibration.translation[2]
    above, below = slope * ahead - shift, own - slope * along
    with np.errstate(divide="ignore", invalid="ignore"):
        return above / below, (ahead * below + above * along) / below**2
