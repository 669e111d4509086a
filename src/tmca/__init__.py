"""Time-multiplexed coded aperture cameras: spectral, light field, spectral-depth; and dual blind deconvolution.

>>> import tmca
>>> scene = tmca.read("coffee", size=(48, 64))
>>> sensor = tmca.Sensor(full_well=10_000, read_noise_electrons=3)
>>> camera = tmca.SpectralCamera(slots=2, shutter="one-hot", sensor=sensor)
>>> snapshot = tmca.simulate(scene, camera)
>>> estimate = tmca.reconstruct(snapshot, "admm-tv")
>>> tmca.evaluate(estimate, scene)["psnr"] > 20
True

``import tmca`` loads no third-party package: everything loads on first use.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False
"""As that of `typing`, which takes longer to import than all that is here."""
if TYPE_CHECKING:
    from typing import Any

    from tmca.applications import evaluate, simulate
    from tmca.applications.point_clouds import point_cloud
    from tmca.applications.refocusing import refocus
    from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
    from tmca.data import read_scene as read
    from tmca.decoders import Decoder, Estimate
    from tmca.decoders import decode as reconstruct
    from tmca.registration import register
    from tmca.reports import design_codes
    from tmca.sensor import Sensor
    from tmca.training.face import train
    from tmca.viewer import view

__version__ = "0.1.0"

_FACE = {
    "read": "data:read_scene",
    "simulate": "applications:simulate",
    "reconstruct": "decoders:decode",
    "evaluate": "applications:evaluate",
    "design_codes": "reports:design_codes",
    "point_cloud": "applications.point_clouds:point_cloud",
    "refocus": "applications.refocusing:refocus",
    "register": "registration:register",
    "train": "training.face:train",
    "view": "viewer:view",
    "SpectralCamera": "cameras:SpectralCamera",
    "LightFieldCamera": "cameras:LightFieldCamera",
    "SpectralDepthCamera": "cameras:SpectralDepthCamera",
    "Sensor": "sensor:Sensor",
    "Snapshot": "cameras:Snapshot",
    "Decoder": "decoders:Decoder",
    "Estimate": "decoders:Estimate",
}
"""Names of the package's face and where they live."""
_ROOMS = (
    "adapters",
    "applications",
    "cameras",
    "codes",
    "data",
    "dbd",
    "decoders",
    "design",
    "errors",
    "evaluation",
    "lab",
    "metrics",
    "operators",
    "optics",
    "plots",
    "priors",
    "registration",
    "reports",
    "sensor",
    "specs",
    "testing",
    "training",
    "tuning",
    "viewer",
)

__all__ = [
    "Decoder",
    "Estimate",
    "LightFieldCamera",
    "Sensor",
    "Snapshot",
    "SpectralCamera",
    "SpectralDepthCamera",
    "__version__",
    "design_codes",
    "evaluate",
    "point_cloud",
    "read",
    "reconstruct",
    "refocus",
    "register",
    "simulate",
    "train",
    "view",
]


def __getattr__(name: str) -> Any:
    if name in _FACE:
        room, _, part = _FACE[name].partition(":")
        return getattr(import_module(f"tmca.{room}"), part)
    if name in _ROOMS:
        return import_module(f"tmca.{name}")
    raise AttributeError(f"module 'tmca' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*__all__, *_ROOMS})
