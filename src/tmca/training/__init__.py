"""Codes and decoders that learn together: exact resume, several processes, weights as files."""

from tmca.training.light_field import (
    LIGHT_FIELD_PRESETS,
    LightFieldTrainSettings,
    light_field_settings,
    train_light_field,
)
from tmca.training.losses import LOSSES
from tmca.training.run import Trained
from tmca.training.settings import PRESETS, TrainSettings, settings_from
from tmca.training.spectral import train_spectral
from tmca.training.spectral_depth.run import train_spectral_depth
from tmca.training.spectral_depth.settings import (
    SPECTRAL_DEPTH_TRAININGS,
    SpectralDepthTrainSettings,
    spectral_depth_settings,
)

__all__ = [
    "LIGHT_FIELD_PRESETS",
    "LOSSES",
    "PRESETS",
    "SPECTRAL_DEPTH_TRAININGS",
    "LightFieldTrainSettings",
    "SpectralDepthTrainSettings",
    "TrainSettings",
    "Trained",
    "light_field_settings",
    "settings_from",
    "spectral_depth_settings",
    "train_light_field",
    "train_spectral",
    "train_spectral_depth",
]
