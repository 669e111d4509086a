"""Specs: what cameras, sensors and readings are described by, declared once, without torch.

Options of the command line, YAML, ``--set`` and the axes of sweeps come from the fields of these models: names, types,
defaults, bounds and help. `tmca.cameras.camera_of` and `tmca.data` make of them what they describe.
"""

from tmca.specs.base import Spec, spec_of
from tmca.specs.cameras import CAMERA_SPECS, CameraSpec, CodedSpec, LightFieldSpec, SpectralDepthSpec, SpectralSpec
from tmca.specs.optics import MaskPlaceSpec, PhaseBenchSpec
from tmca.specs.reading import (
    CubeReading,
    DepthReading,
    LightFieldReading,
    LightFieldsReading,
    MeasuredReading,
    TruthReading,
    ViewsReading,
)
from tmca.specs.sensor import SensorSpec, SheetSpec

__all__ = [
    "CAMERA_SPECS",
    "CameraSpec",
    "CodedSpec",
    "CubeReading",
    "DepthReading",
    "LightFieldReading",
    "LightFieldSpec",
    "LightFieldsReading",
    "MaskPlaceSpec",
    "MeasuredReading",
    "PhaseBenchSpec",
    "SensorSpec",
    "SheetSpec",
    "Spec",
    "SpectralDepthSpec",
    "SpectralSpec",
    "TruthReading",
    "ViewsReading",
    "spec_of",
]
