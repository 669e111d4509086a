"""A rendered table: all files that the optical one of figure 31 would give, with the truth beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from studies.bench import FringePlan, Lens, ProjectorCalibration, camera_rays, write_frames, write_fringes
from studies.ray_physics import Array
from tmca.data import atomic_path, label, label_depth, label_spectral_depth, metres_to_nm, rendered_scene, write_dataset
from tmca.errors import SettingError, ShapeError

_BLACK, _BRIGHT = 0.02, 0.8


@dataclass(frozen=True)
class RenderedScan:
    """Digital numbers: ``scene`` and ``white`` ``(L, H, W)``, ``dark`` ``(n, H, W)``."""

    scene: NDArray[np.uint16]
    white: NDArray[np.uint16]
    dark: NDArray[np.uint16]


def render_scan(
    reflectance: Array,
    *,
    source: Array | None = None,
    read_noise: float = 4.0,
    gain: float = 0.0,
    darks: int = 8,
    bits: int = 12,
    seed: int = 0,
) -> RenderedScan:
    """Frames of a scene under each wavelength of a source whose power falls towards the blue and the picture's edge.

    Args:
        reflectance: ``(L, H, W)``.
        source: ``(L,)`` power per band relative to the brightest; that of a lamp behind a monochromator without it.
        read_noise: standard deviation, digital numbers.
        gain: digital numbers per electron, for shot noise.
        darks: dark frames.
        bits: of the digital numbers.
        seed: of the noise.

    Raises:
        ShapeError: no cube.
    """
    if reflectance.ndim != 3:
        raise ShapeError("reflectance", f"shape {reflectance.shape}", "(L, H, W)")
    bands, height, width = reflectance.shape
    power = 0.35 + 0.65 * np.sin(np.linspace(0.25, 2.2, bands)) if source is None else np.asarray(source)
    y, x = np.linspace(-1, 1, height)[:, None], np.linspace(-1, 1, width)
    light = _BRIGHT * power[:, None, None] * (1 - 0.15 * (y**2 + x**2))
    top, rng = 2**bits - 1, np.random.default_rng(seed)

    def recorded(clean: Array) -> NDArray[np.uint16]:
        spread = np.sqrt(read_noise**2 + gain * clean * top)
        noisy = (clean + _BLACK) * top + spread * rng.standard_normal(clean.shape)
        return np.clip(np.round(noisy), 0, top).astype(np.uint16)

    dark = recorded(np.zeros((darks, height, width)))
    return RenderedScan(recorded(reflectance * light), recorded(light), dark)


_AMBIENT, _FULL_LIGHT = 0.05, 0.85
_MARCH = 96
_THICK = 0.003
"""Metres by which a point has to lie behind a surface to be in its shadow: below it, slanted surfaces shade
themselves."""


def bench(
    camera: tuple[int, int] = (120, 160), projector: tuple[int, int] = (800, 1280), baseline: float = 0.2
) -> ProjectorCalibration:
    """A camera and, ``baseline`` metres to its right, a projector turned to look at the same place 1 m away."""
    lens, other = Lens(camera, _pinhole(camera, 1.3)), Lens(projector, _pinhole(projector, 1.1))
    turn = np.arctan2(baseline, 1.0)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    return ProjectorCalibration(lens, other, rotation, -rotation @ [baseline, 0.0, 0.0])


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
    calibration: ProjectorCalibration,
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
        light = np.interp(places, np.arange(plan.extent), profile) * lit * _FULL_LIGHT + _AMBIENT
        frame[:] = (light * albedo).reshape(height, by, width, by).mean(axis=(1, 3))
    return RenderedFringes(_recorded(frames * exposure, snr_db, bits, seed), lit[by // 2 :: by, by // 2 :: by])


def _finer(calibration: ProjectorCalibration, by: int) -> ProjectorCalibration:
    """The same camera with ``by`` rays along each side of a pixel."""
    camera = calibration.camera
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= by
    matrix[:2, 2] = (matrix[:2, 2] + 0.5) * by - 0.5
    lens = Lens((camera.size[0] * by, camera.size[1] * by), matrix, camera.distortion)
    return ProjectorCalibration(lens, calibration.projector, calibration.rotation, calibration.translation)


def _seen_places(calibration: ProjectorCalibration, depth: Array, plan: FringePlan) -> tuple[Array, NDArray[np.bool_]]:
    """Projector pixel along the plan's axis that lights each point, and whether it reaches it."""
    points = depth * camera_rays(calibration)
    x, y, z = calibration.in_projector(points)
    column, row = calibration.projector.pixels(x / z, y / z)
    height, width = calibration.projector.size
    inside = (z > 0) & (column >= -0.5) & (column < width - 0.5) & (row >= -0.5) & (row < height - 0.5)
    return (column if plan.across == "x" else row), inside & ~_shaded(calibration, points, depth)


def _shaded(calibration: ProjectorCalibration, points: Array, depth: Array) -> NDArray[np.bool_]:
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


_BITS, _READ_NOISE, _RAYS = 16, 64.0, 3
POINTS = {"P1": (0.3, 0.3), "P2": (0.5, 0.7), "P3": (0.75, 0.4)}
"""Where the rendered spectrometer looks, in heights and widths of the picture."""
_BOX = 5


def write_bench(
    folder: str | Path,
    *,
    picture: str = "coffee",
    shape: str = "steps",
    size: tuple[int, int] = (96, 128),
    plan: FringePlan | None = None,
    snr_db: float = 30.0,
    seed: int = 0,
    overwrite: bool = False,
) -> dict[str, tuple[int, int]]:
    """Write fringes and their captures, a spectral scan, calibration, references and truth; whole or not at all.

    ``fringes/`` (projected), ``captures/``, ``scene/``, ``white/``, ``dark/`` (16-bit PNG), ``calibration.json``,
    ``references.csv`` (nm, a column per point), ``truth.nc`` (``radiance`` and ``depth``).

    Args:
        folder: to write.
        picture: of `tmca.data.rendered_scene`, for the reflectance.
        shape: of `scene_depth`, 0.4–1.6 m.
        size: (height, width) of the camera; a third of the picture's at most.
        plan: of fringes.
        snr_db: of the captures of fringes.
        seed: of all noise.

    Returns:
        (row, column) of the references' points.

    Raises:
        SettingError: an impossible setting.
        OutputError: see `tmca.data.atomic_path`.
    """
    if min(size) < 16:
        raise SettingError("size", f"{size[0]}×{size[1]}", "16 pixels or more")
    plan, fine = plan or FringePlan(), (size[0] * _RAYS, size[1] * _RAYS)
    scene, depth, table = rendered_scene(picture, size=fine), scene_depth(shape, fine), bench(size, plan.size)
    reflectance = scene["reflectance"].values.astype(np.float64)
    seen = render_fringes(plan, table, depth, reflectance.mean(axis=0), snr_db=snr_db, bits=_BITS, seed=seed)
    cube = reflectance.reshape(-1, size[0], _RAYS, size[1], _RAYS).mean(axis=(2, 4))
    scan, nm = (
        render_scan(cube, read_noise=_READ_NOISE, bits=_BITS, seed=seed),
        metres_to_nm(scene["wavelength"].values),
    )
    places = {name: (int(y * size[0]), int(x * size[1])) for name, (y, x) in POINTS.items()}
    with atomic_path(folder, overwrite=overwrite) as place:
        place.mkdir()
        write_fringes(plan, place / "fringes")
        table.save(place / "calibration.json")
        write_frames(place / "captures", dict(zip(plan.names, seen.frames, strict=True)))
        for name, frames in (("scene", scan.scene), ("white", scan.white)):
            write_frames(place / name, {f"{name}_{w:g}nm": one for w, one in zip(nm, frames, strict=True)})
        write_frames(place / "dark", {f"dark_{i}": one for i, one in enumerate(scan.dark)})
        (place / "references.csv").write_text(_references(cube, nm, places), encoding="utf-8")
        middle = depth[_RAYS // 2 :: _RAYS, _RAYS // 2 :: _RAYS]
        cube_there = label(cube.astype(np.float32), scene["wavelength"].values)
        write_dataset(label_spectral_depth(cube_there, label_depth(middle, folder)), place / "truth.nc")
    return places


def _references(cube: NDArray[np.float64], nm: NDArray[np.float64], places: dict[str, tuple[int, int]]) -> str:
    """What a spectrometer tells of boxes of the scene, every 2 nm."""
    fine, half = np.arange(nm[0], nm[-1] + 1, 2.0), _BOX // 2
    boxes = [cube[:, y - half : y + half + 1, x - half : x + half + 1].mean(axis=(1, 2)) for y, x in places.values()]
    table = np.column_stack([fine, *(np.interp(fine, nm, spectrum) for spectrum in boxes)])
    lines = [",".join(["wavelength_nm", *places]), *(",".join(f"{value:.6g}" for value in row) for row in table)]
    return "\n".join(lines) + "\n"
