"""Rendered benches: all files that calibration takes, of a camera whose true numbers are hidden."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import torch
import xarray as xr

from studies.bench import (
    CODES_DATE,
    MODES,
    Calibration,
    StepSettings,
    calibration_patterns,
    measure_all,
    moved,
    nominal_matrix,
    now,
    write_frames,
    zernike_modes,
)
from studies.ray_physics import (
    REFERENCE,
    Array,
    BenchTruth,
    glass_shift,
    light_field_light,
    pairs_in_time,
    point_of,
    seen_by_rays,
    shown_by,
    spectral_light,
    white_power,
)
from tmca.cameras import Camera, LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.data import atomic_path, label, write_dataset, write_json
from tmca.errors import SettingError, check_choice, check_range
from tmca.optics import PhaseMaskBench

NAME = "rendered"
WAVES: Array = np.arange(400.0, 701.0, 25.0) * 1e-9
EXPOSURES_MS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 35.0)
POINTS, POINT_WAVES = (0.5, 0.6, 0.75, 0.9), (470e-9, 550e-9, 640e-9)
DEPTH = 0.75
"""Metres to the scene of the spectral-depth camera."""
_SHARE = 0.8
_FULL_MS = 20.0
"""Exposure at which even light reaches the level of white."""
Frames = dict[str, dict[str, np.ndarray]]
Made = tuple[Frames, Snapshot[Any], Any, BenchTruth]
"""Folders of frames, a raw snapshot, its scene, and the truth."""


def nominal_spectral(size: tuple[int, int], slots: int, seed: int) -> SpectralCamera:
    """The camera as it was designed: 12 bands behind a prism of glass that spreads them over 11 pixels."""
    waves = np.linspace(400e-9, 700e-9, 12).tolist()
    return SpectralCamera(waves, size, slots, dispersion=glass_shift(waves, waves[0], 11.0).tolist(), seed=seed)


def place_of_codes(camera: SpectralCamera) -> Array:
    """(2, 3) code pixels to sensor pixels of the nominal camera at ``REFERENCE``."""
    start = np.interp(REFERENCE, camera.wavelengths, camera.dispersion.displacement)
    return np.array([[1.0, 0, 0], [0, 1.0, start - camera.dispersion.origin]])


def spectral_truth(camera: SpectralCamera, seed: int) -> BenchTruth:
    """Its hidden numbers."""
    sensor = (camera.snapshot_shape[1], camera.snapshot_shape[2])
    span = camera.dispersion.displacement[-1] - camera.dispersion.displacement[0]
    return BenchTruth.drawn(camera.size, sensor, place_of_codes(camera), span, camera.slots, seed)


def spectral_bench(size: tuple[int, int], slots: int, snr_db: float, seed: int) -> Made:
    from tmca.data import nearest_bands, rendered_scene

    camera = nominal_spectral(size, slots, seed)
    truth, rng = spectral_truth(camera, seed), np.random.default_rng(seed + 1)
    patterns = calibration_patterns(size, seed=seed)
    frames = _sensor_frames(truth, rng) | _pattern_frames(truth, patterns, truth.matrix, slots, rng, snr_db)
    light, shown = white_power(WAVES) * truth.response(WAVES), shown_by(patterns[3:4], truth.contrast_ratio)
    size_there = _sensor_size(truth)
    seen = [
        _SHARE * share * seen_by_rays(shown, moved(truth.matrix, shift), size_there, blur=truth.blur)[0]
        for share, shift in zip(light / light.max(), truth.shifts(WAVES), strict=True)
    ]
    names = [f"band_{w * 1e9:.0f}nm" for w in WAVES]
    frames["dispersion"] = {
        name: truth.sensor.recorded(one, rng, snr_db) for name, one in zip(names, seen, strict=True)
    }
    whole = rendered_scene("coffee", size=(max(size), max(size)))["reflectance"]
    scene = nearest_bands(whole, camera.wavelengths)[:, : camera.size[0], : camera.size[1]]
    shares = spectral_light(camera, truth, scene.values.astype(np.float64))
    return frames, raw_snapshot(camera, truth, shares[None], rng), scene, truth


def light_field_bench(size: tuple[int, int], slots: int, snr_db: float, seed: int) -> Made:
    from tmca.data import rendered_light_field

    camera = LightFieldCamera(5, size, slots, seed=seed)
    place = nominal_matrix(camera.mask_size, size)
    truth = BenchTruth.drawn(camera.mask_size, size, place, 0.0, slots, seed)
    rng = np.random.default_rng(seed + 1)
    patterns = calibration_patterns(camera.mask_size, seed=seed)
    frames = _sensor_frames(truth, rng) | _pattern_frames(truth, patterns, truth.matrix, slots, rng, snr_db)
    shown = shown_by(patterns[3:4], truth.contrast_ratio)
    views = [(v, u) for v in (-2, 0, 2) for u in (-2, 0, 2)]
    frames["shear"] = {}
    for (v, u), share in zip(views, truth.view_light(np.array(views)), strict=True):
        shift = -truth.step * (v, u)
        seen = seen_by_rays(shown, moved(truth.matrix, shift), size, blur=truth.blur)[0]
        frames["shear"][f"view_{v}_{u}"] = truth.sensor.recorded(_SHARE * share * seen, rng, snr_db)
    field = rendered_light_field("coffee", size=size, views=5)
    shares = light_field_light(camera, truth, field["light_field"].values.astype(np.float64))
    return frames, raw_snapshot(camera, truth, shares[None], rng), field["light_field"], truth


def spectral_depth_bench(size: tuple[int, int], slots: int, snr_db: float, seed: int) -> Made:
    camera = SpectralDepthCamera(8, size, slots, bench=PhaseMaskBench(), seed=seed)
    truth = BenchTruth.drawn(size, size, nominal_matrix(size, size), 0.0, slots, seed)
    rng = np.random.default_rng(seed + 1)
    frames, fine = _sensor_frames(truth, rng), 2 * camera.bench.mask_pixels
    asked = camera.codes()[0].double().numpy()
    modes = zernike_modes(MODES, (fine, fine)).numpy()
    for slot, coefficients in enumerate(truth.coefficients):
        heights = np.kron(asked[slot], np.ones((2, 2))) + np.tensordot(coefficients, modes, 1)
        moves = rng.uniform(-1.5, 1.5, (len(POINTS), 2))
        light = {
            f"point_{z:g}m_{wave * 1e9:.0f}nm": point_of(camera.bench, heights, z, wave, size, move)
            for z, move in zip(POINTS, moves, strict=True)
            for wave in POINT_WAVES
        }
        frames[f"psf{slot}"] = _points(light, truth, rng, snr_db)
    turned = torch.from_numpy(np.tensordot(truth.coefficients, zernike_modes(MODES, camera.bench.mask_size).numpy(), 1))
    true = SpectralDepthCamera(8, size, slots, bench=camera.bench, mask=torch.from_numpy(asked) + turned, seed=seed)
    scene, depth = _blocks(camera.bands, size, seed), torch.full((1, 1, *size), DEPTH)
    with torch.no_grad():
        shares = true.A(scene, depth)[0].double().numpy() / camera.full_scale
    blocks = label(scene[0].numpy(), np.array(camera.wavelengths))
    return frames, raw_snapshot(camera, truth, shares, rng), blocks, truth


def _blocks(bands: int, size: tuple[int, int], seed: int) -> torch.Tensor:
    """(1, L, H, W) patches of 8 pixels, each of one spectrum."""
    rng = np.random.default_rng(seed)
    patches = rng.uniform(0.1, 0.9, (bands, -(-size[0] // 8), -(-size[1] // 8)))
    return torch.from_numpy(np.kron(patches, np.ones((8, 8)))[None, :, : size[0], : size[1]]).float()


def _points(light: Mapping[str, Array], truth: BenchTruth, rng: Any, snr_db: float) -> dict[str, np.ndarray]:
    """Every frame exposed for a peak of 0.8, as one does between wavelengths and depths."""
    return {name: truth.sensor.recorded(_SHARE * one / one.max(), rng, snr_db) for name, one in light.items()}


def _sensor_size(truth: BenchTruth) -> tuple[int, int]:
    return (int(truth.sensor.offset.shape[0]), int(truth.sensor.offset.shape[1]))


def _sensor_frames(truth: BenchTruth, rng: Any) -> Frames:
    """Dark, flat, white and an exposure series, with the sensor's own noise."""
    size, sensor = _sensor_size(truth), truth.sensor
    even = np.ones(size)
    return {
        "dark": {f"dark_{i:02d}": sensor.recorded(0 * even, rng) for i in range(16)},
        "flat": {f"flat_{i:02d}": sensor.recorded(_SHARE * even, rng) for i in range(16)},
        "white": {f"white_{i}": sensor.recorded(even, rng) for i in range(4)},
        "linearity": {
            f"even_{ms:g}ms_{i}": sensor.recorded(ms / _FULL_MS * even, rng) for ms in EXPOSURES_MS for i in range(2)
        },
    }


def _pattern_frames(truth: BenchTruth, patterns: Array, matrix: Array, slots: int, rng: Any, snr_db: float) -> Frames:
    """Patterns, what is seen of them, and pairs of slots."""
    size, sensor = _sensor_size(truth), truth.sensor
    seen = _SHARE * seen_by_rays(shown_by(patterns, truth.contrast_ratio), matrix, size, blur=truth.blur)
    pairs = pairs_in_time(slots, truth.delay, truth.ratio, truth.contrast_ratio, truth.leakage)
    return {
        "patterns": {f"pattern_{i}": (255 * one).astype(np.uint8) for i, one in enumerate(patterns)},
        "registration": {f"pattern_{i}": one for i, one in enumerate(sensor.recorded(seen, rng, snr_db))},
        "timing": {
            f"aperture_{i}_shutter_{j}": sensor.recorded(_SHARE * pairs[i, j] * seen[0], rng, None)
            for i in range(slots)
            for j in range(slots)
        },
    }


def raw_snapshot(camera: Camera, truth: BenchTruth, shares: Array, rng: Any, scene: str = "coffee") -> Snapshot[Any]:
    """A snapshot in digital numbers with the sensor's own noise, and the nominal camera.

    Args:
        camera: the nominal one.
        truth: of the bench.
        shares: (C, H, W') light, 1 for white with everything open.
        rng: of the noise.
        scene: its name.
    """
    notes = {"values": "digital numbers", "camera_name": NAME, CODES_DATE: now(), "scene": scene}
    recorded = truth.sensor.recorded(shares, rng).astype(np.float32)
    return Snapshot(torch.from_numpy(recorded)[None], camera, notes)


_BENCHES = {"spectral": spectral_bench, "light-field": light_field_bench, "spectral-depth": spectral_depth_bench}


def write_bench(
    folder: str | Path,
    *,
    camera: str = "spectral",
    size: tuple[int, int] = (64, 80),
    slots: int = 4,
    snr_db: float = 40.0,
    seed: int = 0,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Write a bench's captures, a snapshot of it and its truth; whole or not at all.

    Folders of 16-bit PNG: ``patterns`` (shown), ``dark``, ``flat``, ``white``, ``linearity``, ``registration``,
    ``timing``; ``dispersion`` with ``source.csv``, or ``shear``, or ``psf0`` … of a spectral-depth camera. Files:
    ``snapshot.nc`` (raw, with the nominal camera), ``scene.nc``, ``truth.json``.

    Args:
        folder: to write.
        camera: which one.
        size: (H, W) of the scene, pixels.
        slots: K.
        snr_db: of captures of patterns and points, root mean square over noise; other frames and the snapshot have
            the read and shot noise of the sensor.
        seed: of truth, codes and noise.
        overwrite: replace the folder.

    Returns:
        What ``truth.json`` says.

    Raises:
        SettingError: an unknown camera, a size below 24 pixels, or no finite noise.
        OutputError: see `tmca.data.atomic_path`.
    """
    check_choice("camera", camera, _BENCHES)
    if min(size) < 24 or slots < 2:
        raise SettingError("size", f"{size[0]}×{size[1]}, {slots} slots", "24 pixels or more, two slots or more")
    check_range("--snr", snr_db, unit="dB")
    frames, snapshot, scene, truth = _BENCHES[camera](size, slots, snr_db, seed)
    about = {"camera": camera, "seed": seed, "snr_db": snr_db, "reference": REFERENCE, **stated(truth)}
    with atomic_path(folder, overwrite=overwrite) as place:
        place.mkdir()
        for name, pictures in frames.items():
            write_frames(place / name, pictures)
        if camera == "spectral":
            (place / "source.csv").write_text(_power_table(), encoding="utf-8")
        snapshot.save(place / "snapshot.nc")
        write_dataset(scene, place / "scene.nc")
        write_json(about, place / "truth.json")
    return about


def stated(truth: BenchTruth) -> dict[str, Any]:
    """The hidden numbers as JSON holds them, the sensor's maps apart."""
    values = {name: value for name, value in asdict(truth).items() if name != "sensor"}
    sensor = truth.sensor
    values["wavelengths"], values["shifts"] = WAVES, truth.shifts(WAVES)
    values["response"] = truth.response(WAVES)
    fine: Array = np.arange(400.0, 701.0) * 1e-9
    values |= {"fine_wavelengths": fine, "fine_shifts": truth.shifts(fine), "fine_response": truth.response(fine)}
    values["defects"] = np.argwhere(sensor.hot | sensor.dead).tolist()
    return {**values, "gain": sensor.gain, "read_noise": sensor.read_noise, "white_level": sensor.bright}


def _power_table() -> str:
    rows = [f"{w * 1e9:g},{p:.6g}" for w, p in zip(WAVES, white_power(WAVES), strict=True)]
    return "\n".join(["wavelength_nm,power", *rows]) + "\n"


def capture_scenes(
    folder: Path, size: tuple[int, int], slots: int, seed: int, scenes: Mapping[str, xr.DataArray]
) -> None:
    """Write ``NAME.nc``, a raw snapshot of the spectral rendered bench, and ``NAME_truth.nc`` of every scene.

    Args:
        folder: to make.
        size: (H, W) of the bench's scenes.
        slots: of its codes.
        seed: of its truth and codes; with the name, of the noise.
        scenes: cubes (wavelength, y, x) at the camera's bands and size, by name.
    """
    camera = nominal_spectral(size, slots, seed)
    truth = spectral_truth(camera, seed)
    with atomic_path(folder) as place:
        place.mkdir()
        for name, scene in scenes.items():
            light = spectral_light(camera, truth, np.asarray(scene.values, dtype=np.float64))
            rng = np.random.default_rng((seed, crc32(name.encode())))
            raw_snapshot(camera, truth, light[None], rng, name).save(place / f"{name}.nc")
            write_dataset(scene.to_dataset(name="radiance"), place / f"{name}_truth.nc")


def calibrate_bench(folder: Path) -> Calibration:
    """Every step of a rendered bench, as ``tmca calibrate all`` measures them."""
    told = StepSettings(wavelength=REFERENCE, snapshot=folder / "snapshot.nc")
    *_, (_, found) = measure_all(folder, Calibration.empty(NAME), told)
    return found
