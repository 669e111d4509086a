"""The spectral camera in a training run."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.cameras import CodedCamera, SpectralCamera
from tmca.training.imaging_run import prepare_imaging
from tmca.training.patches import Load
from tmca.training.run import Trained, train
from tmca.training.settings import TrainSettings
from tmca.training.starting_codes import starting_settings

if TYPE_CHECKING:
    import xarray as xr


class SpectralApplication:
    """An ``Application`` whose scenes are cubes (wavelength, y, x)."""

    name = "spectral"

    def camera(self, settings: TrainSettings, first: xr.DataArray) -> SpectralCamera:
        """The camera with the codes that the run starts from."""
        return starting_camera(settings, first["wavelength"].values.tolist())

    def array(self, scene: xr.DataArray) -> NDArray[np.float32]:
        """(L, H, W)."""
        return np.asarray(scene.values, dtype=np.float32)

    def views(self, camera: CodedCamera) -> None:
        """Bands do not turn."""


def starting_camera(settings: TrainSettings, wavelengths: list[float]) -> SpectralCamera:
    """The camera with the codes that a run starts from."""

    def shutter_size() -> tuple[int, int]:
        camera = SpectralCamera(bands=wavelengths, **settings.camera.model_dump(exclude={"learn"}))
        return camera.codes.shutter.size

    return SpectralCamera(bands=wavelengths, **starting_settings(settings, shutter_size))


def train_spectral(settings: TrainSettings, folder: Path, load: Load, **how: Any) -> Trained:
    """Train a spectral camera's codes and decoder; ``train`` says what ``load`` and the other arguments are."""
    return train(partial(prepare_imaging, SpectralApplication()), settings, folder, load, **how)
