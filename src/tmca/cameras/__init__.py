"""Codes, optics, operator and sensor joined into cameras."""

from tmca.cameras.coded import CodedCamera
from tmca.cameras.light_field import LightFieldCamera
from tmca.cameras.motion import moving_scene
from tmca.cameras.presets import LIGHT_FIELD_PRESETS, PRESETS
from tmca.cameras.snapshots import Snapshot
from tmca.cameras.spectral import SpectralCamera

__all__ = [
    "LIGHT_FIELD_PRESETS",
    "PRESETS",
    "CodedCamera",
    "LightFieldCamera",
    "Snapshot",
    "SpectralCamera",
    "moving_scene",
]
