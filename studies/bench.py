"""Calibration, ground truth, captures, certainty of estimates: the one file that knows where they are in ``tmca``."""

from __future__ import annotations

from tmca.applications.spectral_depth import reading_range
from tmca.data.depth_scenes import load_any_depth_scene
from tmca.data.fitting import middle_of, select_bands
from tmca.decoders.certainty import FILE, Features, calibrated, calibrations
from tmca.lab.calibration.apply import calibrated_snapshot, measured_sensor
from tmca.lab.calibration.captured import StepSettings
from tmca.lab.calibration.captures import calibration_patterns
from tmca.lab.calibration.displacement import MeasuredDispersion
from tmca.lab.calibration.file import Calibration, find_calibration, load_calibration
from tmca.lab.calibration.pattern_image import moved
from tmca.lab.calibration.psf import MODES, wavefront_rms
from tmca.lab.calibration.registration import nominal_matrix
from tmca.lab.calibration.steps import measure_all
from tmca.lab.frames import write_frames
from tmca.lab.ground_truth.fringes import FringePlan, write_fringes
from tmca.lab.ground_truth.geometry import Lens, ProjectorCalibration, camera_rays
from tmca.lab.importing import import_capture, without_pixels
from tmca.lab.notes import CODES_DATE, now
from tmca.lab.prototype import PixelShutter, SingleDisperser, load_prototype
from tmca.lab.registering import (
    block_shifts,
    explained,
    fine_part,
    flattened,
    register_mask,
    registered,
)
from tmca.optics.zernike import zernike_modes
from tmca.training.snapshot_camera import scene_at, training_of

__all__ = [
    "CODES_DATE",
    "FILE",
    "MODES",
    "Calibration",
    "Features",
    "FringePlan",
    "Lens",
    "MeasuredDispersion",
    "PixelShutter",
    "ProjectorCalibration",
    "SingleDisperser",
    "StepSettings",
    "block_shifts",
    "calibrated",
    "calibrated_snapshot",
    "calibration_patterns",
    "calibrations",
    "camera_rays",
    "explained",
    "find_calibration",
    "fine_part",
    "flattened",
    "import_capture",
    "load_any_depth_scene",
    "load_calibration",
    "load_prototype",
    "measure_all",
    "measured_sensor",
    "middle_of",
    "moved",
    "nominal_matrix",
    "now",
    "reading_range",
    "register_mask",
    "registered",
    "scene_at",
    "select_bands",
    "training_of",
    "wavefront_rms",
    "without_pixels",
    "write_frames",
    "write_fringes",
    "zernike_modes",
]  # fmt: skip
