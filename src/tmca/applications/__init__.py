"""What each camera is to the rest of the package: how its scenes are read, imaged, measured and drawn."""

from tmca.applications.base import APPLICATIONS, Application, application_of
from tmca.applications.evaluating import evaluate
from tmca.applications.imaging import simulate
from tmca.applications.light_field import LightFieldApplication
from tmca.applications.spectral import SpectralApplication
from tmca.applications.spectral_depth import SpectralDepthApplication
from tmca.decoders import decode as reconstruct

__all__ = [
    "APPLICATIONS",
    "Application",
    "LightFieldApplication",
    "SpectralApplication",
    "SpectralDepthApplication",
    "application_of",
    "evaluate",
    "reconstruct",
    "simulate",
]


def __dir__() -> list[str]:
    return sorted(__all__)
