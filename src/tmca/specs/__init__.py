"""Specs: what cameras, sensors and readings are described by, declared once, without torch.

Options of the command line, YAML, ``--set`` and the axes of sweeps come from the fields of these models: names, types,
defaults, bounds and help. `tmca.cameras.camera_of` and `tmca.data` make of them what they describe.
"""

from tmca.specs.base import Spec, first_error, spec_of
from tmca.specs.cameras import CAMERA_SPECS, CameraSpec, CodedSpec, LightFieldSpec, SpectralDepthSpec, SpectralSpec
from tmca.specs.design import CodeSearchSpec, MaskCameraSpec, MaskSearchSpec
from tmca.specs.hardware import LIMITS, PAIRS, PARTS, Hardware
from tmca.specs.optics import MaskPlaceSpec, PhaseBenchSpec
from tmca.specs.reading import (
    BandsReading,
    CubeReading,
    DepthReading,
    LightFieldReading,
    LightFieldsReading,
    MeasuredReading,
    TruthReading,
    ViewsReading,
)
from tmca.specs.sensor import SensorFileSpec, SensorSpec, SheetSpec, read_sensor, sensor_of
from tmca.yaml_files import read_yaml

__all__ = [
    "CAMERA_SPECS",
    "LIMITS",
    "PAIRS",
    "PARTS",
    "BandsReading",
    "CameraSpec",
    "CodeSearchSpec",
    "CodedSpec",
    "CubeReading",
    "DepthReading",
    "Hardware",
    "LightFieldReading",
    "LightFieldSpec",
    "LightFieldsReading",
    "MaskCameraSpec",
    "MaskPlaceSpec",
    "MaskSearchSpec",
    "MeasuredReading",
    "PhaseBenchSpec",
    "SensorFileSpec",
    "SensorSpec",
    "SheetSpec",
    "Spec",
    "SpectralDepthSpec",
    "SpectralSpec",
    "TruthReading",
    "ViewsReading",
    "first_error",
    "read_sensor",
    "read_yaml",
    "sensor_of",
    "spec_of",
]


def __dir__() -> list[str]:
    return sorted(__all__)
