"""``tmca inspect``: what a file holds."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter


def inspect(
    file: Path,
    /,
    *,
    figure: Path | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Say what FILE holds: variables, size, wavelengths, range of values, and for a snapshot its camera.

    Args:
        file: a cube, capture, snapshot, prior or any array file.
        figure: write a picture of it (PNG).
        overwrite: replace the picture if it exists.
        json: print JSON instead of text.
    """
    from tmca.data import describe

    found = describe(file)
    if figure is not None:
        from tmca.experiments.pictures import picture_of

        picture_of(file, figure, overwrite=overwrite)
        found["figure"] = str(figure)
    if json:
        print(json_module.dumps(found, indent=1))
        return
    for line in _lines(found):
        print(line)


def _lines(found: dict[str, Any], indent: str = "") -> list[str]:
    lines = []
    for key, value in found.items():
        label = f"{indent}{key.replace('_', ' ')}"
        if isinstance(value, dict):
            lines += [f"{label}:", *_lines(value, indent + "  ")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [f"{label}:"]
            for entry in value:
                lines += [f"{indent}  - {', '.join(f'{k} {v}' for k, v in entry.items())}"]
        else:
            lines.append(f"{label}: {_short(value)}")
    return lines


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return " × ".join(map(str, value)) if len(value) <= 4 else ", ".join(_short(v) for v in value)
    return str(value)
