"""Codes, optics, operator and sensor joined into cameras."""

from tmca.cameras.camera import Camera, sharing
from tmca.cameras.coded import CodedCamera
from tmca.cameras.light_field import LightFieldCamera
from tmca.cameras.motion import moving_scene, moving_scenes
from tmca.cameras.presets import LIGHT_FIELD_PRESETS, PRESETS, SPECTRAL_DEPTH_PRESETS
from tmca.cameras.snapshots import Snapshot
from tmca.cameras.spectral import SpectralCamera
from tmca.cameras.spectral_depth import SpectralDepthCamera

__all__ = [
    "LIGHT_FIELD_PRESETS",
    "PRESETS",
    "SPECTRAL_DEPTH_PRESETS",
    "Camera",
    "CodedCamera",
    "LightFieldCamera",
    "Snapshot",
    "SpectralCamera",
    "SpectralDepthCamera",
    "moving_scene",
    "moving_scenes",
    "sharing",
]
