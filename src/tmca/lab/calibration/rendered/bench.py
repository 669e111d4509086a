"""Rendered benches: all files that calibration takes, of a camera whose true numbers are hidden in ``truth.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from tmca.data import atomic_path, write_dataset, write_json
from tmca.errors import SettingError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.rendered.cameras import WAVES, light_field_bench, spectral_bench, spectral_depth_bench
from tmca.lab.calibration.rendered.captures import write_captures
from tmca.lab.calibration.rendered.light import white_power
from tmca.lab.calibration.rendered.truth import REFERENCE, BenchTruth

_BENCHES = {"spectral": spectral_bench, "light-field": light_field_bench, "spectral-depth": spectral_depth_bench}


def write_bench(
    folder: str | Path,
    *,
    camera: str = "spectral",
    size: tuple[int, int] = (64, 80),
    slots: int = 4,
    snr_db: float = 40.0,
    seed: int = 0,
    scenes: Mapping[str, Any] | None = None,
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
        scenes: by name, at the camera's bands and size, whose captures are wanted too: ``captures/NAME.nc`` beside
            ``captures/NAME_truth.nc``.
        overwrite: replace the folder.

    Returns:
        What ``truth.json`` says.

    Raises:
        SettingError: an unknown camera, a size below 24 pixels, or no finite noise.
        OutputError: see `tmca.data.atomic_path`.
    """
    if camera not in _BENCHES:
        raise SettingError("camera", repr(camera), f"one of {', '.join(_BENCHES)}")
    if min(size) < 24 or slots < 2:
        raise SettingError("size", f"{size[0]}×{size[1]}, {slots} slots", "24 pixels or more, two slots or more")
    if not isfinite(snr_db):
        raise SettingError("--snr", f"{snr_db}", "decibels, a finite number")
    frames, snapshot, scene, truth = _BENCHES[camera](size, slots, snr_db, seed)
    about = {"camera": camera, "seed": seed, "snr_db": snr_db, "reference": REFERENCE, **stated(truth)}
    with atomic_path(folder, overwrite=overwrite) as place:
        place.mkdir()
        for name, pictures in frames.items():
            _pictures(place / name, pictures)
        if camera == "spectral":
            (place / "source.csv").write_text(_power_table(), encoding="utf-8")
        snapshot.save(place / "snapshot.nc")
        write_dataset(scene, place / "scene.nc")
        write_json(about, place / "truth.json")
        write_captures(place / "captures", snapshot.camera, truth, scenes or {}, seed)
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


def _pictures(folder: Path, frames: Mapping[str, np.ndarray]) -> None:
    from PIL import Image

    folder.mkdir()
    for name, frame in frames.items():
        Image.fromarray(frame).save(folder / f"{name}.png")


def _power_table() -> str:
    rows = [f"{w * 1e9:g},{p:.6g}" for w, p in zip(WAVES, white_power(WAVES), strict=True)]
    return "\n".join(["wavelength_nm,power", *rows]) + "\n"
