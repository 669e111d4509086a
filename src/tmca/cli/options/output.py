"""Options of what is written, and refusals before the work is done."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import On
from tmca.errors import SettingError


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
