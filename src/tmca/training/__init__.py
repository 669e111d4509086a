"""Codes and decoders that learn together: exact resume, several processes, weights as files."""

from tmca.training.camera_training import TRAININGS, CameraTraining, scene_reader, training_settings
from tmca.training.light_field import LightFieldTrainSettings
from tmca.training.losses import LOSSES
from tmca.training.run import Trained, train
from tmca.training.settings import TrainSettings
from tmca.training.spectral import SpectralTrainSettings
from tmca.training.spectral_depth import SpectralDepthTrainSettings

__all__ = [
    "LOSSES",
    "TRAININGS",
    "CameraTraining",
    "LightFieldTrainSettings",
    "SpectralDepthTrainSettings",
    "SpectralTrainSettings",
    "TrainSettings",
    "Trained",
    "scene_reader",
    "train",
    "training_settings",
]


def __dir__() -> list[str]:
    return sorted(__all__)
