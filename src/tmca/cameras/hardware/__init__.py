"""Cameras on benches with faults: devices, optics and sensor that are not what the decoder takes them for."""

from tmca.cameras.hardware.camera import imperfect
from tmca.cameras.hardware.faults import LIMITS, PARTS, Hardware

__all__ = ["LIMITS", "PARTS", "Hardware", "imperfect"]
