"""Camera and projector: their lenses, where they are, and metric depth by triangulation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.attributes import NamedJson, read_json
from tmca.data import write_json
from tmca.errors import DataError
from tmca.lab.ground_truth.fringes import Across

Array = NDArray[np.float64]
_ROUNDS = 20
_MOST_PIXELS = 2**26


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

    def about(self) -> dict[str, Any]:
        """For JSON."""
        return {"size": list(self.size), "matrix": self.matrix, "distortion": self.distortion}


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
        about = {"camera": self.camera.about(), "projector": self.projector.about()}
        places = {"rotation": self.rotation, "translation_m": self.translation}
        return write_json(about | places, path, overwrite=overwrite)


def load_calibration(path: str | Path) -> ProjectorCalibration:
    """Read ``camera`` and ``projector`` (``size``, ``matrix``, ``distortion``), ``rotation``, ``translation_m`` from
    JSON.

    The numbers are those of OpenCV's ``stereoCalibrate`` with the camera as the first and the projector as the second,
    translation in metres.

    Raises:
        DataError: missing or unreadable file, a missing or impossible entry.
    """
    file = Path(path)
    about = read_json(file, NamedJson, "a calibration", "see docs/ground-truth.md")
    rotation, translation = _numbers(about, "rotation", (3, 3), file), _numbers(about, "translation_m", (3,), file)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
        raise DataError(file, "a rotation that is no rotation", "an orthonormal matrix of determinant 1")
    distance = float(np.linalg.norm(translation))
    if not 1e-3 <= distance <= 10:
        raise DataError(file, f"a projector {distance:g} m from the camera", "1 mm to 10 m", "give metres")
    return ProjectorCalibration(_lens(about, "camera", file), _lens(about, "projector", file), rotation, translation)


def _lens(about: dict[str, Any], name: str, file: Path) -> Lens:
    part = about.get(name)
    if not isinstance(part, dict):
        raise DataError(file, f"no {name}", f"{name} with size, matrix, distortion")
    size = _numbers(part, "size", (2,), file, name)
    if (size != np.round(size)).any():
        raise DataError(file, f"{name}.size of {size[0]:g}×{size[1]:g} pixels", "whole pixels, [height, width]")
    height, width = (int(n) for n in size)
    if height * width > _MOST_PIXELS:
        raise DataError(file, f"a {name} of {height}×{width} pixels", f"at most {_MOST_PIXELS}", "correct its size")
    matrix = _numbers(part, "matrix", (3, 3), file, name)
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and height > 0 and width > 0):
        raise DataError(file, f"a {name} with a focal length or size that is not positive", "pixels above 0")
    return Lens((height, width), matrix, _distortion(part.get("distortion", []), file, name))


def _distortion(given: Any, file: Path, name: str) -> Array:
    """The five numbers of Brown's model; those that are not given are zero."""
    expected, bent = "finite numbers k1, k2, p1, p2, k3", np.zeros(5)
    try:
        values = np.ravel(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError):
        raise DataError(file, f"distortion {given!r} of the {name}", expected) from None
    if values.size > 5 or not np.isfinite(values).all():
        raise DataError(file, f"{values.size} numbers of distortion of the {name}", expected)
    bent[: values.size] = values
    return bent


def _numbers(about: dict[str, Any], name: str, shape: tuple[int, ...], file: Path, of: str = "") -> Array:
    where = f"{of}.{name}" if of else name
    try:
        values = np.asarray(about[name], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(file, f"no numbers for {where}", f"an array of shape {shape}") from error
    values = values.reshape(shape) if values.size == np.prod(shape) else values
    if values.shape != shape or not np.isfinite(values).all():
        raise DataError(file, f"{where} of shape {values.shape}", f"finite numbers of shape {shape}")
    return values


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
