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

__all__ = [
    "LIGHT_FIELD_PRESETS",
    "LOSSES",
    "PRESETS",
    "LightFieldTrainSettings",
    "TrainSettings",
    "Trained",
    "light_field_settings",
    "settings_from",
    "train_light_field",
    "train_spectral",
]
