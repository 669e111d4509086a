"""The light-field camera in a training run: its settings, presets and scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tmca.cameras import CodedCamera, LightFieldCamera
from tmca.data.light_field_scenes import Reading, check_asked, load_light_field
from tmca.errors import SettingError
from tmca.training.imaging_run import prepare_imaging
from tmca.training.patches import Load
from tmca.training.run import Trained, train
from tmca.training.scenes import named_scenes
from tmca.training.settings import DataSettings, Pixels, Strict, TrainSettings, settings_of
from tmca.training.starting_codes import starting_settings

if TYPE_CHECKING:
    import xarray as xr


class LightFieldCameraSettings(Strict):
    """The light-field camera of a run; names as in ``LightFieldCamera``.

    ``learn`` says which codes are learned. ``period`` tiles them: a tile is seen in every step, a full frame rarely.
    """

    views: int = Field(default=5, ge=1)
    size: tuple[int, int] = (270, 480)
    slots: int = Field(default=8, ge=1)
    aperture: str = "random"
    shutter: str = "random"
    exposure: Literal["equal", "per-slot"] = "equal"
    shear: float | tuple[float, float] = 1.0
    mask_scale: float = 1.0
    transmittance: float = Field(default=0.5, gt=0, lt=1)
    duty: float = Field(default=0.5, gt=0, lt=1)
    period: Pixels | tuple[Pixels, Pixels] | None = None
    seed: int = 0
    learn: Literal["both", "aperture", "shutter", "none"] = "none"


class LightFieldDataSettings(DataSettings):
    """Light fields and patches; ``DataSettings`` says what is not said here.

    Args:
        train: light fields (folders of views, lenslet pictures, files), rendered ones such as ``coffee`` or
            ``coffee:3`` (its seed), or split files (``.txt``) of them.
        scale: whole number of pixels per axis that are averaged into one.
        pattern: of the file names in folders of views that are not recognised, such as ``view_{row}_{column}.png``.
        lens: (rows, columns) of the views under a lens of lenslet pictures; 14×14 without.
        colour: every colour is a light field of its own; else their luminance.
    """

    scale: int = Field(default=1, ge=1)
    pattern: str | None = None
    lens: tuple[Pixels, Pixels] | None = None
    colour: bool = False
    tint: Literal[0] = 0
    motion: Literal[0] = 0
    patch: int = Field(default=48, ge=4)
    batch: int = Field(default=4, ge=1)


class LightFieldTrainSettings(TrainSettings):
    """A whole run of the light-field camera."""

    camera: LightFieldCameraSettings = LightFieldCameraSettings()  # type: ignore[assignment]
    decoder: dict[str, Any] = Field(default={"kind": "spatial-angular"})
    data: LightFieldDataSettings = LightFieldDataSettings()

    @model_validator(mode="after")
    def _has_views(self) -> LightFieldTrainSettings:
        if "views" in self.decoder:
            raise ValueError("decoder.views: camera.views says it")
        return self


LIGHT_FIELD_PRESETS: dict[str, dict[str, Any]] = {
    # thesis 3.2: 5×5 views of 480×270, K = 8, patches of 11×11, 500 epochs, L2, 110/20/25 scenes, the sub-network of
    # Guo 2020. Assumed, as the thesis does not say: batches of 64, Adam at 1e-3 with cosine decay, code rate 0.03,
    # 64 patches of a scene in an epoch, slope 4 → 40, no noise, codes started at random with half of the pixels open
    # and no target for the light, one pixel of the mask per view, a network of five blocks of 32 channels.
    "thesis": {
        "camera": {"size": [270, 480], "slots": 8, "learn": "both"},
        "decoder": {"kind": "spatial-angular", "start": "dagger", "stages": 0, "width": 32, "blocks": 5, "gather": 1},
        "data": {"patch": 11, "batch": 64, "patches_per_scene": 64, "brightness": 0.0, "shares": [110, 20, 25]},
        "optimiser": {"epochs": 500, "loss": "l2"},
        "codes": {"frozen": 0.0},
        "precision": "32-true",
    },
    # minutes on two cores: patches of 48, measurement-consistent stages from the patch LMMSE, a tile of codes
    "quick": {
        "camera": {"size": [96, 96], "slots": 4, "shutter": "one-hot", "period": 16, "learn": "both"},
        "decoder": {"kind": "spatial-angular", "start": "lmmse"},
        "data": {"patch": 48, "batch": 4},
        "optimiser": {"steps": 300, "loss": "log"},
    },
}


class LightFieldApplication:
    """An ``Application`` whose scenes are light fields (view_v, view_u, y, x), or in colour."""

    name = "light-field"

    def camera(self, settings: LightFieldTrainSettings, first: xr.DataArray) -> LightFieldCamera:
        """The camera with the codes that the run starts from."""
        return LightFieldCamera(**starting_settings(settings, lambda: settings.camera.size))

    def array(self, scene: xr.DataArray) -> NDArray[np.float32]:
        """(V·U, H, W); colours side by side."""
        values = np.asarray(scene.values, dtype=np.float32)
        values = np.concatenate(list(values), axis=-1) if values.ndim == 5 else values
        return values.reshape(-1, *values.shape[2:])

    def views(self, camera: CodedCamera) -> tuple[int, int]:
        """Which turn with the pixels."""
        return cast(LightFieldCamera, camera).views


def light_field_settings(
    preset: str | None = None, file: str | Path | None = None, changes: Mapping[str, Any] | None = None
) -> LightFieldTrainSettings:
    """Settings of a preset of ``LIGHT_FIELD_PRESETS``, replaced by a file's, replaced by single changes.

    Raises:
        SettingError: unknown preset or name, impossible value.
        DataError: the file cannot be read.
    """
    return settings_of(LightFieldTrainSettings, LIGHT_FIELD_PRESETS, preset, file, changes)


def train_light_field(settings: LightFieldTrainSettings, folder: Path, load: Load, **how: Any) -> Trained:
    """Train a light-field camera's codes and decoder; ``train`` says what ``load`` and the other arguments are."""
    return train(partial(prepare_imaging, LightFieldApplication()), settings, folder, load, **how)


def training_reading(settings: LightFieldTrainSettings) -> Reading:
    """What the settings of a run ask of its files."""
    return Reading(settings.data.scale, settings.data.pattern, settings.data.lens)


def training_loader(settings: LightFieldTrainSettings) -> Callable[[str], xr.DataArray]:
    """Reads the light fields of a run.

    Raises:
        SettingError: a setting that applies to none of them.
        DataError: a split that cannot be read.
    """
    data, reading = settings.data, training_reading(settings)
    names = named_scenes([*data.train, *data.validation, *data.prior])
    if names:
        check_asked(names, **vars(reading))

    def load(name: str) -> xr.DataArray:
        try:
            return load_light_field(name, views=settings.camera.views, colour=data.colour, **reading.of(name))
        except SettingError as error:
            if error.where != "views":
                raise
            remedy = error.remedy and f"{error.remedy.replace('views=', 'camera.views=')} (--set)"
            raise SettingError("camera.views", error.found, error.expected, remedy) from error

    return load
