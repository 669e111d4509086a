"""Cameras on benches with faults: devices, optics and sensor that are not what the decoder takes them for."""

from tmca.cameras.hardware.camera import SomeCamera, defective, imperfect
from tmca.cameras.hardware.faults import LIMITS, PAIRS, PARTS, Hardware

__all__ = ["LIMITS", "PAIRS", "PARTS", "Hardware", "SomeCamera", "defective", "imperfect"]
