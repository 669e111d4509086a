"""Time-multiplexed coded aperture cameras: spectral, light field, spectral-depth; and dual blind deconvolution.

``import tmca`` loads no third-party package: the rooms (``tmca.cameras``, ``tmca.decoders``, …) load on first use.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

__version__ = "0.1.0"

_ROOMS = (
    "cameras",
    "codes",
    "data",
    "dbd",
    "decoders",
    "errors",
    "experiments",
    "metrics",
    "operators",
    "optics",
    "priors",
    "sensor",
    "training",
)

__all__ = ["__version__", *_ROOMS]


def __getattr__(name: str) -> ModuleType:
    if name in _ROOMS:
        return import_module(f"tmca.{name}")
    raise AttributeError(f"module 'tmca' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
