"""Training of the spectral camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from tmca.cameras import SpectralCamera
from tmca.training.mask_training import MaskTraining, starting_arguments
from tmca.training.patches import Load
from tmca.training.settings import MaskCameraSettings, MaskTrainSettings

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


class SpectralCameraSettings(MaskCameraSettings):
    """The spectral camera of a run; names as in `SpectralCamera`."""

    dispersion: float | tuple[float, ...] = 1.0
    "Pixels per band, or the displacement of every band."
    disperser: Literal["single", "dual"] = "single"
    "How many prisms there are: behind the aperture alone, or before it too."
    response: tuple[float, ...] | None = None
    "Of the sensor, one value per band; ones without it."


class SpectralTrainSettings(MaskTrainSettings):
    """A whole run of the spectral camera."""

    kind = "spectral"
    camera: SpectralCameraSettings = SpectralCameraSettings()

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if self.data.motion and self.camera.disperser == "dual":
            raise ValueError("motion needs a single disperser")
        return self


class SpectralTraining(MaskTraining):
    """Scenes are cubes (wavelength, y, x)."""

    kind, settings = "spectral", SpectralTrainSettings

    def reader(self, settings: SpectralTrainSettings) -> Load:
        from tmca.data.scenes import load_scene

        return lambda name: load_scene(name, bands=settings.data.bands)

    def camera(self, settings: SpectralTrainSettings, first: Callable[[], Any]) -> SpectralCamera:
        """See `CameraTraining`; its bands are those of the first scene."""
        bands = first()["wavelength"].values.tolist()

        def shutter_size() -> tuple[int, int]:
            plain = SpectralCamera(bands=bands, **settings.camera.model_dump(exclude={"learn"}))
            size: tuple[int, int] = plain.codes.shutter.size
            return size

        return SpectralCamera(bands=bands, **starting_arguments(settings, shutter_size))

    def channels(self, scene: xr.DataArray, camera: Any) -> NDArray[np.float32]:
        """See `CameraTraining`: the bands."""
        return np.asarray(scene.values, dtype=np.float32)

    def truth(self, path: str, camera: SpectralCamera, colours: bool) -> xr.DataArray:
        from tmca.data import nearest_bands
        from tmca.data.scenes import load_scene

        return nearest_bands(load_scene(path, bands=None, negative="keep"), camera.wavelengths)

    def figure(
        self, batches: Mapping[str, NDArray[np.float32]], truth: NDArray[np.float32], camera: SpectralCamera
    ) -> Figure:
        from tmca.plots.cube import reconstruction_figure

        cubes = {name: batch[0] for name, batch in batches.items()}
        return reconstruction_figure(cubes, list(camera.wavelengths), truth[0])
