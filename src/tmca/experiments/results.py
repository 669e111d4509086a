"""Tables of results: JSON for programs, Markdown for people."""

from __future__ import annotations

import subprocess
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from tmca.applications.spectral import METRICS as METRICS
from tmca.applications.spectral_depth import DEPTH_METRICS as DEPTH_METRICS
from tmca.errors import OutputError, SettingError


def check_new(files: Iterable[Path], overwrite: bool) -> None:
    """Refuse to start where earlier results would be replaced.

    Raises:
        OutputError: a file exists and ``overwrite`` is False.
    """
    for file in files:
        if file.exists() and not overwrite:
            raise OutputError(file, "a file of earlier results", "none", "pass --overwrite or another --out")


def write_table(found: dict[str, Any], text: str, files: Sequence[Path], overwrite: bool) -> None:
    """Results for programs into the first file, and for people into the second.

    Raises:
        OutputError: a file exists and ``overwrite`` is False, or cannot be written.
    """
    from tmca.data import write_json, write_text

    write_json(found, files[0], overwrite=overwrite)
    write_text(text, files[1], overwrite=overwrite)


def check_counts(**counts: int) -> None:
    """Raises SettingError for the first of these options that is below 1."""
    for name, value in counts.items():
        if value < 1:
            raise SettingError(f"--{name}", str(value), "at least 1")


def check_decoders(decoders: Sequence[str], known: Collection[str]) -> None:
    """Raises SettingError unless there are decoders, all of them known."""
    unknown = [name for name in decoders if name not in known]
    if unknown or not decoders:
        raise SettingError("--decoders", ", ".join(unknown) or "none", f"some of {', '.join(known)}")


def mean_over_scenes(scenes: dict[str, dict[str, float]]) -> dict[str, float]:
    """Mean of every metric over scenes."""
    names = next(iter(scenes.values())).keys()
    return {name: sum(scene[name] for scene in scenes.values()) / len(scenes) for name in names}


def markdown_table(rows: Sequence[dict[str, Any]], columns: Sequence[tuple[str, str, str]]) -> str:
    """Rows as a Markdown table.

    Args:
        rows: dictionaries.
        columns: (key, heading, format) of each column; a missing value is left empty.
    """
    lines = ["| " + " | ".join(heading for _, heading, _ in columns) + " |", "|" + " --- |" * len(columns)]
    for row in rows:
        cells = [format(row[key], spec) if row.get(key) is not None else "" for key, _, spec in columns]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def repository_commit() -> str | None:
    """Commit of the checkout that the package runs from (``-dirty`` with uncommitted changes), None outside of one."""
    folder = Path(__file__).parent
    try:
        found = subprocess.run(
            ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12"],
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None
