"""Codes and decoders that learn together: exact resume, several processes, weights as files."""

from tmca.training.losses import LOSSES
from tmca.training.settings import PRESETS, TrainSettings, settings_from
from tmca.training.spectral_run import Trained, train_spectral

__all__ = ["LOSSES", "PRESETS", "TrainSettings", "Trained", "settings_from", "train_spectral"]
