"""Rendered captures of fringes: a camera and a projector in front of a known depth map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, ShapeError
from tmca.lab.structured_light.calibration import Array, Calibration, Lens
from tmca.lab.structured_light.fringes import FringePlan
from tmca.lab.structured_light.triangulation import camera_rays

_AMBIENT, _BRIGHT = 0.05, 0.85
_MARCH = 96
_THICK = 0.003
"""Metres by which a point has to lie behind a surface to be in its shadow: below it, slanted surfaces shade
themselves."""


def bench(
    camera: tuple[int, int] = (120, 160), projector: tuple[int, int] = (800, 1280), baseline: float = 0.2
) -> Calibration:
    """A camera and, ``baseline`` metres to its right, a projector turned to look at the same place 1 m away."""
    lens = Lens(camera, _pinhole(camera, 1.3))
    turn = np.arctan2(baseline, 1.0)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    return Calibration(lens, Lens(projector, _pinhole(projector, 1.1)), rotation, -rotation @ [baseline, 0.0, 0.0])


def _pinhole(size: tuple[int, int], focal_in_widths: float) -> Array:
    height, width = size
    focal = focal_in_widths * width
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def scene_depth(kind: str, size: tuple[int, int], near: float = 0.4, far: float = 1.6) -> Array:
    """A known depth map ``(H, W)`` in metres: ``"plane"`` (slanted), ``"smooth"`` (hills) or ``"steps"`` (boxes,
    cliffs).

    Raises:
        SettingError: another kind.
    """
    rows, columns = ((np.arange(n) + 0.5) / n for n in size)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    if kind == "plane":
        share = 0.15 + 0.5 * x + 0.3 * y
    elif kind == "smooth":
        share = 0.5 + 0.33 * np.sin(4.1 * x + 0.8) * np.cos(3.3 * y) + 0.12 * np.sin(9 * x * y)
    elif kind == "steps":
        share = np.where(x > 0.5, 0.75, 0.95) + 0.04 * y
        share[(np.abs(y - 0.35) < 0.2) & (np.abs(x - 0.3) < 0.14)] = 0.35
        share[np.hypot(y - 0.68, x - 0.7) < 0.2] = 0.5
        share[(y > 0.8) & (x < 0.55)] = 0.15
    else:
        raise SettingError("scene", repr(kind), "'plane', 'smooth' or 'steps'")
    return near + (far - near) * share


@dataclass(frozen=True)
class RenderedFringes:
    """``frames`` ``(F·N, H, W)`` in the plan's order, digital numbers; ``lit`` ``(H, W)``: the middle of the pixel
    is."""

    frames: NDArray[np.uint16]
    lit: NDArray[np.bool_]


def render_fringes(
    plan: FringePlan,
    calibration: Calibration,
    depth: Array,
    albedo: Array,
    *,
    snr_db: float | None = 30.0,
    bits: int = 12,
    exposure: float = 1.0,
    seed: int = 0,
) -> RenderedFringes:
    """What the camera sees of a scene under each frame of the plan, light linear in the projector's levels.

    Points that the projector does not see, because a surface stands between (which is solid behind), or that lie
    outside its picture, get ambient light alone. A camera pixel averages s×s rays where depth and albedo are s times
    finer than it, so pixels on edges mix two depths.

    Args:
        plan: what is projected.
        calibration: of both.
        depth: ``(sH, sW)`` metres along the camera's axis, s odd for a ray in the middle of a pixel.
        albedo: ``(sH, sW)`` in [0, 1].
        snr_db: root mean square of the frames over the noise; None for none.
        bits: of the digital numbers.
        exposure: times full scale at which a white surface under full light is recorded, relative to 0.9.
        seed: of the noise.

    Raises:
        ShapeError: a depth map that is not a whole multiple of the camera's size.
        SettingError: a noise that is no number of dB.
    """
    if snr_db is not None and not snr_db > -np.inf:
        raise SettingError("snr", f"{snr_db:g}", "dB, such as 30; inf for no noise")
    height, width = calibration.camera.size
    by = depth.shape[0] // height
    if depth.shape != (by * height, by * width) or albedo.shape != depth.shape or by < 1:
        raise ShapeError("depth", f"shapes {depth.shape}, {albedo.shape}", f"multiples of {height, width}")
    fine = _finer(calibration, by)
    places, lit = _seen_places(fine, depth, plan)
    profiles = plan.profiles().reshape(-1, plan.extent)
    frames = np.empty((len(profiles), height, width))
    for frame, profile in zip(frames, profiles, strict=True):
        light = np.interp(places, np.arange(plan.extent), profile) * lit * _BRIGHT + _AMBIENT
        frame[:] = (light * albedo).reshape(height, by, width, by).mean(axis=(1, 3))
    return RenderedFringes(_recorded(frames * exposure, snr_db, bits, seed), lit[by // 2 :: by, by // 2 :: by])


def _finer(calibration: Calibration, by: int) -> Calibration:
    """The same camera with ``by`` rays along each side of a pixel."""
    camera = calibration.camera
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= by
    matrix[:2, 2] = (matrix[:2, 2] + 0.5) * by - 0.5
    lens = Lens((camera.size[0] * by, camera.size[1] * by), matrix, camera.distortion)
    return Calibration(lens, calibration.projector, calibration.rotation, calibration.translation)


def _seen_places(calibration: Calibration, depth: Array, plan: FringePlan) -> tuple[Array, NDArray[np.bool_]]:
    """Projector pixel along the plan's axis that lights each point, and whether it reaches it."""
    points = depth * camera_rays(calibration)
    x, y, z = calibration.in_projector(points)
    column, row = calibration.projector.pixels(x / z, y / z)
    height, width = calibration.projector.size
    inside = (z > 0) & (column >= -0.5) & (column < width - 0.5) & (row >= -0.5) & (row < height - 0.5)
    return (column if plan.across == "x" else row), inside & ~_shaded(calibration, points, depth)


def _shaded(calibration: Calibration, points: Array, depth: Array) -> NDArray[np.bool_]:
    """Whether the way to the projector runs behind a surface that the camera sees."""
    lamp = -calibration.rotation.T @ calibration.translation
    shaded = np.zeros(depth.shape, dtype=bool)
    height, width = depth.shape
    for share in (np.arange(_MARCH) + 0.5) / _MARCH:
        x, y, z = points + share * (lamp[:, None, None] - points)
        ahead = z > 0
        z = np.where(ahead, z, 1.0)
        column, row = (np.round(c) for c in calibration.camera.pixels(x / z, y / z))
        ahead &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
        there = depth[np.clip(row, 0, height - 1).astype(int), np.clip(column, 0, width - 1).astype(int)]
        shaded |= ahead & (z > there + _THICK)
    return shaded


def _recorded(frames: Array, snr_db: float | None, bits: int, seed: int) -> NDArray[np.uint16]:
    top = 2**bits - 1
    if snr_db is not None:
        noise = np.sqrt((frames**2).mean()) / 10 ** (snr_db / 20)
        frames = frames + noise * np.random.default_rng(seed).standard_normal(frames.shape)
    return np.clip(np.round(frames * top), 0, top).astype(np.uint16)
