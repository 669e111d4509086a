"""Training of the light-field camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tmca.cameras import LightFieldCamera
from tmca.data.in_memory import as_tensors
from tmca.data.light_field_scenes import Reading, check_asked, load_light_field
from tmca.data.scene_names import named_scenes
from tmca.errors import DataError, SettingError
from tmca.specs.base import Whole
from tmca.training.mask_training import MaskTraining, starting_arguments
from tmca.training.patches import CubeStore, Load, PatchSource
from tmca.training.settings import DataSettings, MaskCameraSettings, MaskTrainSettings

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


class LightFieldCameraSettings(MaskCameraSettings):
    """The light-field camera of a run; names as in `LightFieldCamera`."""

    size: tuple[int, int] = (270, 480)
    views: Whole = 5
    "n of n×n views."
    shear: float | tuple[float, float] = 1.0
    "Mask pixels per view, along both axes or each."
    mask_scale: float = 1.0
    "Mask pixels per sensor pixel, as the sensor sees them."


class LightFieldDataSettings(DataSettings):
    """Light fields and patches."""

    train: tuple[str, ...] = ()
    """Light fields (folders of views, lenslet pictures, files), rendered ones such as ``coffee`` or ``coffee:3`` (its
    seed), or split files (``.txt``) of them."""
    scale: Whole = 1
    "Whole number of pixels per axis that are averaged into one."
    pattern: str | None = None
    "Of the file names in folders of views that are not recognised, such as ``view_{row}_{column}.png``."
    lens: tuple[Whole, Whole] | None = None
    "(rows, columns) of the views under a lens of lenslet pictures; 14×14 without."
    colour: bool = False
    "Every colour is a light field of its own; else their luminance."
    tint: Literal[0] = 0
    motion: Literal[0] = 0
    patch: int = Field(default=48, ge=4)
    batch: Whole = 4


class LightFieldTrainSettings(MaskTrainSettings):
    """A whole run of the light-field camera."""

    kind = "light-field"
    camera: LightFieldCameraSettings = LightFieldCameraSettings()
    decoder: dict[str, Any] = Field(default={"kind": "spatial-angular"})
    data: LightFieldDataSettings = LightFieldDataSettings()

    @model_validator(mode="after")
    def _has_views(self) -> Self:
        if "views" in self.decoder:
            raise ValueError("decoder.views: camera.views says it")
        return self


class LightFieldTraining(MaskTraining):
    """Scenes are light fields (view_v, view_u, y, x), or in colour."""

    kind, settings = "light-field", LightFieldTrainSettings

    def reader(self, settings: LightFieldTrainSettings) -> Load:
        data = settings.data
        reading = Reading(data.scale, data.pattern, data.lens)
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

    def camera(self, settings: LightFieldTrainSettings, first: Callable[[], Any]) -> LightFieldCamera:
        return LightFieldCamera(**starting_arguments(settings, lambda: settings.camera.size))

    def channels(self, scene: xr.DataArray, camera: Any) -> NDArray[np.float32]:
        """See `CameraTraining`: the views; colours side by side."""
        values = np.asarray(scene.values, dtype=np.float32)
        values = np.concatenate(list(values), axis=-1) if values.ndim == 5 else values
        return values.reshape(-1, *values.shape[2:])

    def source(self, settings: Any, store: CubeStore, camera: Any) -> PatchSource:
        """See `CameraTraining`; views turn with the pixels."""
        return replace(super().source(settings, store, camera), views=camera.views)

    def truth(self, path: str, camera: LightFieldCamera, colours: bool) -> xr.DataArray:
        field = load_light_field(path, views=None, colour=colours)
        views = (field.sizes["view_v"], field.sizes["view_u"])
        if views != camera.views:
            found, wanted = ("×".join(map(str, n)) for n in (views, camera.views))
            raise DataError(path, f"a truth of {found} views", f"{wanted}, those of the camera")
        return field

    def batch(self, scene: xr.DataArray, camera: LightFieldCamera) -> NDArray[np.float32]:
        return as_tensors(scene)[0].flatten(1, 2).numpy()

    def figure(
        self, batches: Mapping[str, NDArray[np.float32]], truth: NDArray[np.float32], camera: LightFieldCamera
    ) -> Figure:
        from tmca.plots.light_field import light_field_figure

        def views(batch: NDArray[np.float32]) -> NDArray[np.float32]:
            grid = batch.reshape(len(batch), *camera.views, *batch.shape[2:])
            return grid if len(grid) > 1 else grid[0]

        return light_field_figure({name: views(batch) for name, batch in batches.items()}, views(truth))
