"""Comparisons and sweeps of every camera: codes, noises, decoders and seeds over test scenes."""

from tmca.evaluation.camera import EVALUATIONS, CameraEvaluation, evaluation_of
from tmca.evaluation.light_field import LightFieldEvaluation
from tmca.evaluation.run import run_study
from tmca.evaluation.spectral import SpectralEvaluation
from tmca.evaluation.spectral_depth import SpectralDepthEvaluation
from tmca.evaluation.study import Study, checked_study, read_study
from tmca.evaluation.sweep import Sweep, run_sweep

__all__ = [
    "EVALUATIONS",
    "CameraEvaluation",
    "LightFieldEvaluation",
    "SpectralDepthEvaluation",
    "SpectralEvaluation",
    "Study",
    "Sweep",
    "checked_study",
    "evaluation_of",
    "read_study",
    "run_study",
    "run_sweep",
]
