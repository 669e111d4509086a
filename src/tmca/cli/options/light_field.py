"""Options of commands that read light fields: one for a snapshot, or several to learn from and to measure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import whole
from tmca.cli.options.scenes import ViewFilesOptions

if TYPE_CHECKING:
    from tmca.data.light_field_scenes import Reading

_SCENE = Group("Reading the scene", sort_key=0)


@Parameter(name="*")
@dataclass(frozen=True)
class LightFieldsOptions(ViewFilesOptions):
    """How light fields are read, one or several."""

    views: Annotated[int, Parameter(group=_SCENE, converter=whole)] = 5
    "n for the centre n×n views, odd."
    scale: Annotated[int | None, Parameter(group=_SCENE, converter=whole)] = None
    "Of light fields from files: whole number of pixels per axis that are averaged into one."

    def asked(self) -> Reading:
        """What is asked of files, of which several light fields take what applies to each."""
        from tmca.data.light_field_scenes import Reading

        return Reading(scale=self.scale, **self.files())


@Parameter(name="*")
@dataclass(frozen=True)
class MeasuredLightFieldsOptions(LightFieldsOptions):
    """How light fields are read that are learned from, and others that are measured."""

    scale: Annotated[int | None, Parameter(group=_SCENE, converter=whole)] = None
    "Of the light fields of --train: whole number of pixels per axis that are averaged into one."
    test_scale: Annotated[int | None, Parameter(group=_SCENE, converter=whole)] = None
    "The same of those that are measured."


@Parameter(name="*")
@dataclass(frozen=True)
class LightFieldSceneOptions(LightFieldsOptions):
    """How a light field is read for a snapshot."""

    colour: Annotated[bool, Parameter(group=_SCENE, negative="")] = False
    "Red, green and blue, a snapshot of each, instead of their luminance."

    def reading(self) -> dict[str, Any]:
        """Arguments of ``load_light_field``."""
        return {**vars(self), **self.files()}
