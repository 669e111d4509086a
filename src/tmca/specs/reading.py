"""Specs of reading: how cubes, light fields and scenes with depth are read from files."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from tmca.errors import SettingError
from tmca.specs.base import Metres, Sides, Span, Spec, Whole


class CubeReading(Spec):
    """How a cube is read, arguments of `tmca.data.load_scene`."""

    wavelengths: Metres | None = None
    "Of the file's bands where it does not say, in nm: FIRST:LAST:COUNT or one per band."
    variable: str | None = None
    "Which one, where the file holds several."
    scale: float | None = None
    "Stored value that is relative irradiance 1; an integer type's maximum, or that of floats above 1, without it."
    negative: Literal["error", "clip", "keep"] = "error"
    "What is done with negative pixels: refused, set to 0, or kept."


class BandsReading(CubeReading):
    """How a cube is read of which some bands are taken."""

    range: Span | None = None
    "FIRST:LAST in nm that bands are taken from, such as 400:1000. [default: 400:700]"


class ViewsReading(Spec):
    """How the views of a light field lie in its files."""

    pattern: str | None = None
    "Of light fields: file names of a folder of views that are not recognised, such as view_{row}_{column}.png."
    lens: Sides | None = None
    "Of light fields: ROWSxCOLUMNS of the views under a lens of a lenslet picture. [default: 14x14]"


class LightFieldsReading(ViewsReading):
    """How light fields are read, one or several."""

    views: Annotated[int, Field(le=255)] = 5
    "n for the centre n×n views, odd."
    scale: Whole | None = None
    "Of light fields from files: whole number of pixels per axis that are averaged into one."

    def files(self) -> dict[str, Any]:
        """Arguments of `tmca.data.light_field_scenes.Reading`."""
        return {"scale": self.scale, "pattern": self.pattern, "lens": self.lens}


class MeasuredReading(LightFieldsReading):
    """How light fields are read that are learned from, and others that are measured."""

    scale: Whole | None = None
    "Of the light fields of --train: whole number of pixels per axis that are averaged into one."
    test_scale: Whole | None = None
    "The same of those that are measured."


class LightFieldReading(LightFieldsReading):
    """How a light field is read for a snapshot, arguments of `tmca.data.load_light_field`."""

    colour: bool = False
    "Red, green and blue, a snapshot of each, instead of their luminance."


class TruthReading(ViewsReading, CubeReading):
    """How a truth is read, which is a cube or a light field."""

    scale: float | None = None
    """Of a cube: stored value that is relative irradiance 1; an integer type's maximum, or that of floats above 1,
    without it. Of a light field: whole number of pixels per axis that are averaged into one; what the snapshot's scene
    was read with, without it."""

    def of(self, kind: str) -> dict[str, Any]:
        """What was given, for a scene of a kind of camera.

        Raises:
            SettingError: what scenes of this kind do not have.
        """
        kinds: dict[str, type[Spec]] = {"spectral": CubeReading, "light-field": LightFieldsReading}
        model = kinds.get(kind)
        given = self.given()
        for name, value in given.items():
            if model is None or name not in model.model_fields:
                raise SettingError(name, str(value), f"none for a {kind} scene", "leave it out")
        return given if model is None else model.model_validate(given).given()


class DepthReading(Spec):
    """How a scene with depth is read, arguments of `tmca.data.load_spectral_depth`."""

    reduce: Whole = 1
    "Whole number of pixels per axis that are averaged into one."
    placed: str | None = None
    "Put a cube without depth at drawn depths: plane, slanted, staged, smooth, pieces or random."
    from_rgb: bool = False
    "Make up spectra of measured reflectances for an RGB-D scene."
    materials: Literal["train", "test"] = "train"
    "Half of the measured reflectances that spectra are made up of; test for scenes that are held out."
    metric_depth: bool = False
    "Keep depth in metres, instead of mapping inverse depth onto the camera's range; what is outside is masked."
    scene_seed: Annotated[int, Field(ge=0)] = 0
    "Of what is drawn for the scene: made-up spectra, depths."

    def arguments(self) -> dict[str, Any]:
        """Arguments of `load_spectral_depth`.

        Raises:
            SettingError: two that no kind of scene uses together.
        """
        if self.materials != "train" and not self.from_rgb:
            wanted = "beside --from-rgb alone, which makes spectra up of them"
            raise SettingError("materials", self.materials, wanted, "leave it out, or add --from-rgb")
        for name, value in (("from_rgb", self.from_rgb), ("metric_depth", self.metric_depth)):
            if value and self.placed is not None:
                wanted = "one of them: --placed is for cubes, which have spectra and no depth"
                raise SettingError(name, f"--placed {self.placed} beside it", wanted, "leave one of the two out")
        reading = {name: getattr(self, name) for name in ("reduce", "placed", "from_rgb", "materials")}
        return {**reading, "fitted": not self.metric_depth, "seed": self.scene_seed}
