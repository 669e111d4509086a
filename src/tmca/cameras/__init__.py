"""Codes, optics, operator and sensor joined into cameras."""

from tmca.cameras.snapshots import Snapshot
from tmca.cameras.spectral import PRESETS, SpectralCamera

__all__ = ["PRESETS", "Snapshot", "SpectralCamera"]
