"""Cameras on the optical table: one object for each kind, which displays, benches and calibrations ask."""

from tmca.lab.cameras.base import LAB_CAMERAS, LabCamera, lab_camera
from tmca.lab.cameras.light_field import LightFieldLab
from tmca.lab.cameras.spectral import SpectralLab
from tmca.lab.cameras.spectral_depth import SpectralDepthLab

__all__ = ["LAB_CAMERAS", "LabCamera", "LightFieldLab", "SpectralDepthLab", "SpectralLab", "lab_camera"]
