"""Options of what is written, refusals before the work is done, and what is said of scenes on standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import On
from tmca.cli.options.tables import print_text
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr


Overwrite = Annotated[bool, Parameter(help="Replace what exists.")]
Json = Annotated[bool, Parameter(help="Print JSON instead of text.")]
_AS_MARKDOWN = "Print tables as Markdown in a terminal too, as they are printed into files and pipes."
Markdown = Annotated[bool, Parameter(help=_AS_MARKDOWN)]
Figure = Annotated[Path | None, Parameter(help="Write a picture (PNG).")]
"""Options of many commands."""


@Parameter(name="*", group=Group("Output", sort_key=6))
@dataclass(frozen=True)
class OutputOptions:
    """Where results go."""

    out: Path | None = None
    "File to write; a name made from the input's, in the current folder, without it."
    overwrite: bool = False
    "Replace files that exist."
    figures: On = True
    "Write pictures beside the file."
    json: bool = False
    "Print JSON instead of text."


def say(report: Any, json: bool, *lines: str, markdown: bool = False) -> None:
    """Print a result as JSON, or in lines for people; their tables are drawn in a terminal, unless as Markdown."""
    if json:
        print(dumps(report, indent=1))
    else:
        print_text("\n".join(lines), markdown)


def meaning(metric: str) -> str:
    """Unit of a metric and which way is better, in brackets; nothing of a camera's own."""
    from tmca.metrics import meaning as in_words

    known = in_words(metric)
    return f"({known})" if known else ""


def warned(line: str) -> None:
    """Say on standard error what the reader should know."""
    print(f"tmca: {line}", file=sys.stderr)


def check_figure(figure: Path | None, overwrite: bool, source: str | Path = "") -> None:
    """Refuse a picture that could not be written, before the work is done."""
    if figure is not None:
        from tmca.plots.style import check_picture

        check_picture(figure)
        check_targets([figure], overwrite, source)


def check_targets(files: Iterable[Path], overwrite: bool, source: str | Path = "") -> None:
    """Refuse outputs that exist, have no folder, or are the input, before the work is done."""
    from tmca.data import check_target

    for file in files:
        if source and file.resolve() == Path(source).resolve():
            raise SettingError("--out", f"{file}, which is the input", "another file")
        check_target(file, overwrite)


def assumed(scene: xr.DataArray | xr.Dataset) -> None:
    """Say what was taken for granted about a file."""
    origin, file = str(scene.attrs.get("wavelengths_from", "")), scene.attrs.get("source")
    if origin.startswith("known set"):
        warned(f"{file}: no wavelengths in it, taken from the {origin} (--wavelengths)")
    if scene.attrs.get("scale_from") == "maximum":
        warned(f"{file}: divided by its maximum, {scene.attrs['scale']:g} (--scale)")


def centre_assumed(light_field: xr.DataArray) -> None:
    """Say which views were taken of a square grid that has no centre view."""
    from tmca.data.light_field_scenes import taken_views

    rows, columns = light_field.attrs.get("grid", (1, 1))
    if rows == columns and rows % 2 == 0:
        where = f"{light_field.attrs.get('source')}: {rows}×{columns} views have no centre one"
        warned(f"{where}; taken are {taken_views(light_field)}")
