"""Options that several commands share."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.numbers import whole
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr

_SENSOR = Group("Sensor", sort_key=2)
_OUTPUT = Group("Output", sort_key=3)
_GRID = Group("Computation", sort_key=4)
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
        from tmca.cli.wavelengths import metres

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


@Parameter(name="*")
@dataclass(frozen=True)
class SensorOptions:
    """The sensor."""

    read_noise: Annotated[float, Parameter(group=_SENSOR)] = 0.0
    "Standard deviation in snapshot units (1 = one band or view of a white scene)."
    full_well: Annotated[float | None, Parameter(group=_SENSOR)] = None
    "Electrons at full scale; switches shot noise on."
    read_noise_electrons: Annotated[float, Parameter(group=_SENSOR)] = 0.0
    "Read noise in electrons, standard deviation; needs --full-well."
    bits: Annotated[int | None, Parameter(group=_SENSOR, converter=whole)] = None
    "Bits of the analogue-to-digital converter."


@Parameter(name="*")
@dataclass(frozen=True)
class GridOptions:
    """How a grid of cells is computed."""

    jobs: Annotated[int, Parameter(group=_GRID, converter=whole)] = 1
    "Processes side by side."
    slurm: Annotated[str | None, Parameter(group=_GRID)] = None
    "Parameters of submitit, NAME=VALUE,…, to send the cells to Slurm: timeout_min=60,slurm_partition=gpu."
    overwrite: Annotated[bool, Parameter(group=_GRID, negative="")] = False
    "Replace results that exist."
    json: Annotated[bool, Parameter(group=_GRID, negative="")] = False
    "Print the results as JSON."

    def how(self) -> dict[str, Any]:
        """Arguments of a comparison or a sweep."""
        cluster, command = cluster_parameters(self.slurm), ["tmca", *sys.argv[1:]]
        return {"jobs": self.jobs, "cluster": cluster, "overwrite": self.overwrite, "command": command}


@Parameter(name="*")
@dataclass(frozen=True)
class OutputOptions:
    """Where results go."""

    out: Annotated[Path | None, Parameter(group=_OUTPUT)] = None
    "File to write; a name made from the input's, in the current folder, without it."
    overwrite: Annotated[bool, Parameter(group=_OUTPUT, negative="")] = False
    "Replace files that exist."
    figures: Annotated[bool, Parameter(group=_OUTPUT)] = True
    "Write pictures beside the file."
    json: Annotated[bool, Parameter(group=_OUTPUT, negative="")] = False
    "Print JSON instead of text."


def assumed(cube: xr.DataArray) -> None:
    """Say on standard error what was taken for granted about a file."""
    origin, file = str(cube.attrs.get("wavelengths_from", "")), cube.attrs.get("source")
    if origin.startswith("known set"):
        print(f"tmca: {file}: no wavelengths in it, taken from the {origin} (--wavelengths)", file=sys.stderr)
    if cube.attrs.get("scale_from") == "maximum":
        print(f"tmca: {file}: divided by its maximum, {cube.attrs['scale']:g} (--scale)", file=sys.stderr)


def centre_assumed(light_field: xr.DataArray) -> None:
    """Say on standard error which views were taken of a square grid that has no centre view."""
    from tmca.experiments.light_field.imaging import taken_views

    rows, columns = light_field.attrs.get("grid", (1, 1))
    if rows == columns and rows % 2 == 0:
        where = f"{light_field.attrs.get('source')}: {rows}×{columns} views have no centre one"
        warned(f"{where}; taken are {taken_views(light_field)}")


def warned(line: str) -> None:
    """Say on standard error what the reader should know."""
    print(f"tmca: {line}", file=sys.stderr)


def check_figure(figure: Path | None, overwrite: bool, source: str | Path = "") -> None:
    """Refuse a picture that could not be written, before the work is done."""
    if figure is not None:
        from tmca.experiments.figures import check_picture

        check_picture(figure)
        check_targets([figure], overwrite, source)


def check_targets(files: Iterable[Path], overwrite: bool, source: str | Path = "") -> None:
    """Refuse outputs that exist, have no folder, or are the input, before the work is done."""
    from tmca.data import check_target

    for file in files:
        if source and file.resolve() == Path(source).resolve():
            raise SettingError("--out", f"{file}, which is the input", "another file")
        check_target(file, overwrite)


def cluster_parameters(text: str | None) -> dict[str, Any] | None:
    """``NAME=VALUE,…`` for submitit; None without."""
    if text is None:
        return None
    import yaml

    parts = [part.partition("=") for part in text.split(",") if part]
    if not parts or not all(sign for _, sign, _ in parts):
        raise SettingError("--slurm", repr(text), "NAME=VALUE,…, such as timeout_min=60,slurm_partition=gpu")
    return {name: yaml.safe_load(value) for name, _, value in parts}


def pair(text: str | None, option: str) -> tuple[float, float]:
    """``ROWS,COLUMNS``; zeros if not given."""
    values = (0.0, 0.0) if text is None else numbers(text, option)
    if not isinstance(values, list | tuple) or len(values) != 2:
        raise SettingError(option, repr(text), "ROWS,COLUMNS in pixels, such as 0,2.5")
    return (values[0], values[1])


def numbers(text: str, option: str) -> float | list[float]:
    """One number, or several separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise SettingError(option, repr(text), "a number, or numbers separated by commas") from None
    return values[0] if len(values) == 1 else values


def size(
    text: str | None, option: str = "--size", expected: str = "HEIGHTxWIDTH in pixels, such as 256x256"
) -> tuple[int, int] | None:
    """Two whole numbers, ``HxW`` in pixels unless something else is ``expected``."""
    if text is None:
        return None
    try:
        height, width = (int(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        raise SettingError(option, repr(text), expected) from None
    return height, width
