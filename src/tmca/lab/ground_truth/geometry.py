"""Camera and projector: their lenses, where they are, and metric depth by triangulation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field

from tmca.attributes import Attributes, read_json
from tmca.data import write_json
from tmca.errors import DataError
from tmca.lab.ground_truth.fringes import Across

Array = NDArray[np.float64]
_ROUNDS = 20
_MOST_PIXELS = 2**26
Pixels = Annotated[int, Field(ge=1, le=2**20)]


@dataclass(frozen=True)
class Lens:
    """A pinhole with radial and tangential distortion (Brown, 1971), in OpenCV's convention.

    Args:
        size: (height, width) in pixels; pixel centres are at whole numbers.
        matrix: ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` in pixels.
        distortion: ``k1, k2, p1, p2, k3``.
    """

    size: tuple[int, int]
    matrix: Array
    distortion: Array = field(default_factory=lambda: np.zeros(5))

    def normalised(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Pixels → ray slopes X/Z, Y/Z; the distortion is undone by fixed-point iteration."""
        (fx, _, cx), (_, fy, cy) = self.matrix[:2]
        ideal = bent = (np.asarray(x) - cx) / fx, (np.asarray(y) - cy) / fy
        for _ in range(_ROUNDS if self.distortion.any() else 0):
            dx, dy = self.displacement(*ideal)
            ideal = bent[0] - dx, bent[1] - dy
        return ideal

    def pixels(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Ray slopes → pixels."""
        (fx, _, cx), (_, fy, cy) = self.matrix[:2]
        dx, dy = self.displacement(np.asarray(x), np.asarray(y))
        return fx * (np.asarray(x) + dx) + cx, fy * (np.asarray(y) + dy) + cy

    def displacement(self, x: Array, y: Array) -> tuple[Array, Array]:
        """What the distortion adds to ray slopes."""
        k1, k2, p1, p2, k3 = self.distortion
        square = x * x + y * y
        radial = square * (k1 + square * (k2 + square * k3))
        return (
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + 2 * p2 * x * y + p1 * (square + 2 * y * y),
        )


@dataclass(frozen=True)
class ProjectorCalibration:
    """Camera and projector: a point X of the camera's frame is ``rotation X + translation`` (metres) in the
    projector's.

    Z grows away from the camera along its axis, x to the right and y down, as its pixels.
    """

    camera: Lens
    projector: Lens
    rotation: Array
    translation: Array

    def in_projector(self, points: Array) -> Array:
        """``(3, …)`` of the camera's frame → the projector's, metres."""
        moved = np.einsum("ij,j...->i...", self.rotation, points)
        return moved + self.translation.reshape(3, *[1] * (points.ndim - 1))

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write it as JSON that `load_calibration` reads.

        Raises:
            OutputError: see `tmca.data.atomic_path`.
        """
        about = {"camera": vars(self.camera), "projector": vars(self.projector)}
        places = {"rotation": self.rotation, "translation_m": self.translation}
        return write_json(about | places, path, overwrite=overwrite)


def _flat(value: Any) -> Any:
    """The numbers of nested lists, in their order."""
    return [one for part in value for one in _flat(part)] if isinstance(value, list) else [value]


Flat = BeforeValidator(_flat)
Nine = Annotated[list[float], Flat, Field(min_length=9, max_length=9)]
Three = Annotated[list[float], Flat, Field(min_length=3, max_length=3)]


class _StatedLens(Attributes):
    """A lens as the file states it."""

    size: tuple[Pixels, Pixels]
    matrix: Nine
    distortion: Annotated[list[float], Flat, Field(max_length=5, default_factory=list)]

    def lens(self, where: str) -> Lens:
        """The lens; numbers of its distortion that are not stated are zero."""
        matrix, (height, width) = np.reshape(self.matrix, (3, 3)), self.size
        if height * width > _MOST_PIXELS:
            raise DataError(where, f"{height}×{width} pixels", f"at most {_MOST_PIXELS}", "correct its size")
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise DataError(where, "a focal length that is not positive", "pixels above 0")
        return Lens(self.size, matrix, np.array([*self.distortion, *np.zeros(5)][:5]))


class _Stated(Attributes):
    """What the file states."""

    camera: _StatedLens
    projector: _StatedLens
    rotation: Nine
    translation_m: Three


def load_calibration(path: str | Path) -> ProjectorCalibration:
    """Read ``camera`` and ``projector`` (``size``, ``matrix``, ``distortion``), ``rotation``, ``translation_m`` from
    JSON.

    The numbers are those of OpenCV's ``stereoCalibrate`` with the camera as the first and the projector as the second,
    translation in metres.

    Raises:
        DataError: missing or unreadable file, a missing or impossible entry.
    """
    stated = read_json(path, _Stated, "a calibration, see docs/ground-truth.md")
    rotation, translation = np.reshape(stated.rotation, (3, 3)), np.array(stated.translation_m)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
        raise DataError(path, "a rotation that is no rotation", "an orthonormal matrix of determinant 1")
    camera, projector = stated.camera.lens(f"{path}: camera"), stated.projector.lens(f"{path}: projector")
    return ProjectorCalibration(camera, projector, rotation, translation)


_BENDS = 8


def triangulate(
    position: ArrayLike, position_std: ArrayLike, calibration: ProjectorCalibration, across: Across = "x"
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
    for _ in range(_BENDS if lens.distortion.any() else 0):
        x, y, z = calibration.in_projector(depth * rays)
        slope = bent - lens.displacement(x / z, y / z)[axis]
        depth, change = _meet(slope, rays, calibration, axis)
    with np.errstate(invalid="ignore"):
        ahead = np.isfinite(depth) & (depth > 0)
        std = np.abs(change) / focal * np.asarray(position_std)
    return np.where(ahead, depth, np.nan), np.where(ahead, std, np.nan)


def camera_rays(calibration: ProjectorCalibration) -> Array:
    """``(3, H, W)`` directions of the camera's pixels, 1 along its axis."""
    rows, columns = np.indices(calibration.camera.size, dtype=np.float64)
    x, y = calibration.camera.normalised(columns, rows)
    return np.stack([x, y, np.ones_like(x)])


def _meet(slope: Array, rays: Array, calibration: ProjectorCalibration, axis: int) -> tuple[Array, Array]:
    """Depth, and its derivative by the slope."""
    across, along = (np.einsum("j,jyx->yx", calibration.rotation[row], rays) for row in (axis, 2))
    shift, ahead = calibration.translation[axis], calibration.translation[2]
    above, below = slope * ahead - shift, across - slope * along
    with np.errstate(divide="ignore", invalid="ignore"):
        return above / below, (ahead * below + above * along) / below**2
