"""Codes, optics, operator and sensor joined into cameras."""

from tmca.cameras.camera import CAMERAS, Camera
from tmca.cameras.coded import BandCamera, CodedCamera
from tmca.cameras.described import CodesWarning, camera_of, seen_by
from tmca.cameras.faulty import SomeCamera, defective, imperfect
from tmca.cameras.frames import in_finer_time
from tmca.cameras.light_field import LightFieldCamera
from tmca.cameras.motion import moving_object, moving_scene, moving_scenes
from tmca.cameras.snapshot import Snapshot, holds_snapshot, load_cameras
from tmca.cameras.spectral import SpectralCamera
from tmca.cameras.spectral_depth import PhaseCodes, SpectralDepthCamera
from tmca.specs.hardware import LIMITS, PAIRS, PARTS, Hardware

__all__ = [
    "CAMERAS",
    "LIMITS",
    "PAIRS",
    "PARTS",
    "BandCamera",
    "Camera",
    "CodedCamera",
    "CodesWarning",
    "Hardware",
    "LightFieldCamera",
    "PhaseCodes",
    "Snapshot",
    "SomeCamera",
    "SpectralCamera",
    "SpectralDepthCamera",
    "camera_of",
    "defective",
    "holds_snapshot",
    "imperfect",
    "in_finer_time",
    "load_cameras",
    "moving_object",
    "moving_scene",
    "moving_scenes",
    "seen_by",
]


def __dir__() -> list[str]:
    return sorted(__all__)
