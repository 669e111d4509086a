"""Codes, optics, operator and sensor joined into cameras."""

from tmca.cameras.motion import moving_scene
from tmca.cameras.presets import PRESETS
from tmca.cameras.snapshots import Snapshot
from tmca.cameras.spectral import SpectralCamera

__all__ = ["PRESETS", "Snapshot", "SpectralCamera", "moving_scene"]
