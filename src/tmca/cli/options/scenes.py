"""Options of reading scenes, and what was taken for granted of their files."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import size
from tmca.cli.options.output import warned
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.applications import Application

_SCENE = Group("Reading the scene", sort_key=0)
_LENS = "ROWSxCOLUMNS of the views under a lens, such as 14x14"


@Parameter(name="*")
@dataclass(frozen=True)
class SceneOptions:
    """How a scene's file is read."""

    wavelengths: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Of the file's bands where it does not say, in nm: FIRST:LAST:COUNT or one per band."
    variable: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Which one, where the file holds several."
    scale: Annotated[float | None, Parameter(group=_SCENE)] = None
    "Stored value that is relative irradiance 1; an integer type's maximum, or that of floats above 1, without it."
    negative: Annotated[Literal["error", "clip", "keep"], Parameter(group=_SCENE)] = "error"
    "What is done with negative pixels: refused, set to 0, or kept."

    def reading(self) -> dict[str, Any]:
        """Arguments of ``load_scene``."""
        from tmca.cli.options.wavelengths import metres

        given = None if self.wavelengths is None else metres(self.wavelengths)
        return {"wavelengths": given, "variable": self.variable, "scale": self.scale, "negative": self.negative}


@Parameter(name="*")
@dataclass(frozen=True)
class ViewFilesOptions:
    """How the views of a light field lie in its files."""

    pattern: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Of light fields: file names of a folder of views that are not recognised, such as view_{row}_{column}.png."
    lens: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Of light fields: ROWSxCOLUMNS of the views under a lens of a lenslet picture. [default: 14x14]"

    def files(self) -> dict[str, Any]:
        """``pattern`` and ``lens`` as ``load_light_field`` takes them."""
        lens = size(self.lens, "--lens", _LENS)
        if lens is not None and min(lens) < 1:
            raise SettingError("--lens", repr(self.lens), _LENS)
        return {"pattern": self.pattern, "lens": lens}


@Parameter(name="*")
@dataclass(frozen=True)
class TruthOptions(ViewFilesOptions, SceneOptions):
    """How a truth is read, which is a cube or a light field."""

    scale: Annotated[float | None, Parameter(group=_SCENE)] = None
    """Of a cube: stored value that is relative irradiance 1; an integer type's maximum, or that of floats above 1,
    without it. Of a light field: whole number of pixels per axis that are averaged into one; what the snapshot's scene
    was read with, without it."""

    def of(self, application: Application) -> dict[str, Any]:
        """What is given of the arguments of `Application.truth`.

        Raises:
            SettingError: options that scenes of this camera do not have.
        """
        given = {name: value for name, value in vars(self).items() if value not in (None, "error")}
        for name, value in given.items():
            if name not in application.truth_options:
                known = ", ".join(f"--{one}" for one in sorted(application.truth_options)) or "none"
                raise SettingError(name, str(value), f"{known} for a {application.kind} camera's scene", "leave it out")
        if "pattern" in application.truth_options and "scale" in given:
            given["scale"] = self._whole_scale()
        texts = {**SceneOptions.reading(self), **self.files()}
        return {name: texts[name] if name in texts and name != "scale" else given[name] for name in given}

    def _whole_scale(self) -> int:
        scale = float(self.scale or 1)
        if not scale.is_integer():
            raise SettingError("scale", f"{scale:g}", "a whole number of pixels that are averaged into one")
        return int(scale)


def assumed(cube: xr.DataArray | xr.Dataset) -> None:
    """Say on standard error what was taken for granted about a file."""
    origin, file = str(cube.attrs.get("wavelengths_from", "")), cube.attrs.get("source")
    if origin.startswith("known set"):
        print(f"tmca: {file}: no wavelengths in it, taken from the {origin} (--wavelengths)", file=sys.stderr)
    if cube.attrs.get("scale_from") == "maximum":
        print(f"tmca: {file}: divided by its maximum, {cube.attrs['scale']:g} (--scale)", file=sys.stderr)


def centre_assumed(light_field: xr.DataArray) -> None:
    """Say on standard error which views were taken of a square grid that has no centre view."""
    from tmca.data.light_field_scenes import taken_views

    rows, columns = light_field.attrs.get("grid", (1, 1))
    if rows == columns and rows % 2 == 0:
        where = f"{light_field.attrs.get('source')}: {rows}×{columns} views have no centre one"
        warned(f"{where}; taken are {taken_views(light_field)}")
