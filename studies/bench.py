"""Rendered benches, calibration, import of captures: the one file that knows where they are in ``tmca``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from zlib import crc32

import numpy as np
import xarray as xr

from tmca.data import atomic_path, write_dataset
from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.bench_physics import REFERENCE, spectral_light
from tmca.lab.calibration.dispersion import MeasuredDispersion
from tmca.lab.calibration.file import Calibration, find_calibration, load_calibration
from tmca.lab.calibration.fits import StepSettings
from tmca.lab.calibration.measured_sensor import measured_sensor
from tmca.lab.calibration.psf import wavefront_rms
from tmca.lab.calibration.rendered_bench import (
    DEPTH,
    NAME,
    WAVES,
    nominal_spectral,
    raw_snapshot,
    spectral_truth,
    write_bench,
)
from tmca.lab.calibration.steps import measure_all
from tmca.lab.importing import import_capture, without_pixels
from tmca.lab.prototype import PixelShutter, SingleDisperser, load_prototype
from tmca.lab.registering import (
    block_shifts,
    explained,
    fine_part,
    flattened,
    register_mask,
    registered,
)
from tmca.training.snapshot_camera import scene_at, training_of

__all__ = [
    "DEPTH", "REFERENCE", "WAVES", "Calibration", "MeasuredDispersion", "PixelShutter",
    "SingleDisperser", "block_shifts", "calibrate_bench", "calibrated_snapshot", "capture_scenes",
    "explained", "find_calibration", "fine_part", "flattened", "import_capture", "load_calibration",
    "load_prototype", "measured_sensor", "nominal_spectral",
    "register_mask", "registered", "scene_at", "training_of", "wavefront_rms",
    "without_pixels", "write_bench",
]  # fmt: skip


def calibrate_bench(folder: Path) -> Calibration:
    """Every step of a rendered bench, as ``tmca calibrate all`` measures them."""
    told = StepSettings(wavelength=REFERENCE, camera=folder / "snapshot.nc")
    *_, (_, found) = measure_all(folder, Calibration.empty(NAME), told)
    return found


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
