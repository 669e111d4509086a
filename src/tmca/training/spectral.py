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


PRESETS: dict[str, dict[str, Any]] = {
    # thesis 4.2: 12 bands, 256×256, K = 8, U-Net from Φᵀy, 500 epochs, L2, 160/20/20 scenes. Assumed, as the thesis
    # does not say: batches of 4, Adam at 1e-3 with cosine decay, code rate 0.03, whole frames flipped and turned,
    # slope 4 → 40, no noise, codes started at random with half of the pixels open, no target for the light.
    "thesis": {
        "camera": {"size": [256, 256], "slots": 8, "learn": "both"},
        "decoder": {"kind": "unet", "start": "adjoint", "codes": False, "noise_aware": False},
        "data": {
            "patch": 256,
            "batch": 4,
            "patches_per_scene": 1,
            "brightness": 0.0,
            "tint": 0.0,
            "shares": [0.8, 0.1, 0.1],
        },
        "optimiser": {"epochs": 500, "loss": "l2"},
        "codes": {"frozen": 0.0},
        "precision": "32-true",
    },
    # minutes on two cores: patches of 64, an unrolled network from the patch LMMSE, a tile of codes seen in every step
    "quick": {
        "camera": {"size": [256, 256], "slots": 8, "period": 32, "learn": "both"},
        "decoder": {"kind": "unrolled", "start": "lmmse"},
        "noise": [{"read_noise": 0.01}],
        "data": {"patch": 64, "batch": 16},
        "optimiser": {"steps": 300, "loss": "log"},
    },
}


class SpectralTraining(MaskTraining):
    """Scenes are cubes (wavelength, y, x)."""

    kind, settings, presets = "spectral", SpectralTrainSettings, PRESETS

    def reader(self, settings: SpectralTrainSettings) -> Load:
        """See `CameraTraining`."""
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
        """See `CameraTraining`."""
        from tmca.data import nearest_bands
        from tmca.data.scenes import load_scene

        return nearest_bands(load_scene(path, bands=None, negative="keep"), camera.wavelengths)

    def figure(
        self, batches: Mapping[str, NDArray[np.float32]], truth: NDArray[np.float32], camera: SpectralCamera
    ) -> Figure:
        """See `CameraTraining`."""
        from tmca.plots.cube import reconstruction_figure

        cubes = {name: batch[0] for name, batch in batches.items()}
        return reconstruction_figure(cubes, list(camera.wavelengths), truth[0])
