"""Comparisons and sweeps of every camera: codes, noises, decoders and seeds over test scenes."""

from importlib import import_module
from typing import Any

_FACE = {
    "CameraEvaluation": "camera",
    "LightFieldEvaluation": "light_field",
    "SpectralDepthEvaluation": "spectral_depth",
    "SpectralEvaluation": "spectral",
    "Study": "study",
    "StudyResults": "outcome",
    "Sweep": "sweep",
    "checked_study": "study",
    "evaluation_of": "camera",
    "own_study": "own",
    "read_study": "study",
    "run_study": "run",
    "run_sweep": "sweep",
}
"""Names and the files where they live: imported when they are asked for, as tables are needed without the engine."""

__all__ = sorted(_FACE)


def __getattr__(name: str) -> Any:
    if name in _FACE:
        return getattr(import_module(f"{__name__}.{_FACE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
