"""Rendered benches, calibration, import of captures: the one file that knows where they are in ``tmca``."""

from __future__ import annotations

from pathlib import Path

from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.bench_physics import REFERENCE
from tmca.lab.calibration.dispersion import MeasuredDispersion
from tmca.lab.calibration.file import Calibration, find_calibration, load_calibration
from tmca.lab.calibration.fits import StepSettings
from tmca.lab.calibration.measured_sensor import measured_sensor
from tmca.lab.calibration.psf import wavefront_rms
from tmca.lab.calibration.rendered_bench import DEPTH, NAME, WAVES, nominal_spectral, write_bench
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
    "SingleDisperser", "block_shifts", "calibrate_bench", "calibrated_snapshot",
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
