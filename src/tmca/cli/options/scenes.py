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

    def reading(self) -> dict[str, Any]:
        """Arguments of ``load_scene``.

        Raises:
            SettingError: options that cubes do not have.
        """
        for name in ("pattern", "lens"):
            if getattr(self, name) is not None:
                raise SettingError(f"--{name}", getattr(self, name), "a light field", "leave it out")
        return super().reading()

    def views_reading(self) -> dict[str, Any]:
        """``scale``, ``pattern`` and ``lens`` of ``load_light_field``.

        Raises:
            SettingError: options that light fields do not have.
        """
        for name, usual in (("wavelengths", None), ("variable", None), ("negative", "error")):
            value = getattr(self, name)
            if value != usual:
                wanted = "--scale, --pattern or --lens of a light field"
                raise SettingError(f"--{name}", str(value), wanted, "leave it out")
        if self.scale is not None and not float(self.scale).is_integer():
            found = f"{self.scale:g}"
            raise SettingError("--scale", found, "a whole number of pixels that are averaged into one")
        return {"scale": None if self.scale is None else int(self.scale), **self.files()}


def assumed(cube: xr.DataArray) -> None:
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
