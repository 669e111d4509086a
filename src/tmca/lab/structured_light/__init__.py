"""Depth by structured light: phase-shifted fringes from a projector, seen by a camera."""

from tmca.lab.structured_light.calibration import Calibration, Lens, load_calibration
from tmca.lab.structured_light.captures import read_capture
from tmca.lab.structured_light.depth import measure_depth
from tmca.lab.structured_light.fringes import FringePlan, load_plan, write_fringes
from tmca.lab.structured_light.phase import Phases, measure_phases, phase_std

__all__ = [
    "Calibration",
    "FringePlan",
    "Lens",
    "Phases",
    "load_calibration",
    "load_plan",
    "measure_depth",
    "measure_phases",
    "phase_std",
    "read_capture",
    "write_fringes",
]
