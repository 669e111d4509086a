"""Comparisons and sweeps of every camera: codes, noises, decoders and seeds over test scenes."""

from tmca.evaluation.camera import EVALUATIONS, CameraEvaluation, evaluation_of
from tmca.evaluation.light_field import LightFieldEvaluation
from tmca.evaluation.spectral import SpectralEvaluation
from tmca.evaluation.spectral_depth import SpectralDepthEvaluation

__all__ = [
    "EVALUATIONS",
    "CameraEvaluation",
    "LightFieldEvaluation",
    "SpectralDepthEvaluation",
    "SpectralEvaluation",
    "evaluation_of",
]
