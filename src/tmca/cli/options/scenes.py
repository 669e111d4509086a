"""What was taken for granted of the files of a scene, said on standard error."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tmca.cli.options.output import warned

if TYPE_CHECKING:
    import xarray as xr


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
