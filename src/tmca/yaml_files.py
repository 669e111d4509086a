"""YAML files that people write: names with values, of a bounded size; everything else is told in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.errors import DataError
from tmca.text_files import read_text

LARGEST = 2**20
"""Bytes of a file; ours are below 20 kB."""


def read_yaml(file: str | Path, expected: str) -> dict[str, Any]:
    """Names and values of a YAML file; see `tmca.yaml_loader` for the dialect.

    Args:
        file: UTF-8, with a byte-order mark or without, of at most 1 MB.
        expected: what it should hold, for the message.

    Raises:
        DataError: no such file, no YAML, a name twice, too many values or levels, NaN, or no names with values.
    """
    import yaml

    file = Path(file)
    try:
        values = parsed_yaml(read_text(file, expected, longest=LARGEST))
    except yaml.YAMLError as error:
        raise DataError(file, f"no readable YAML ({_where(error)})", expected) from None
    if not isinstance(values, dict):
        found = "nothing" if values is None else f"a {type(values).__name__}"
        raise DataError(file, found, expected)
    return values


def parsed_yaml(text: str) -> Any:
    """What YAML says, a file or the value of an option.

    Raises:
        yaml.YAMLError: no YAML, or what is refused.
    """
    import yaml

    from tmca.yaml_loader import SettingsLoader

    # a safe loader with bounds
    return yaml.load(text, SettingsLoader)  # noqa: S506 # nosec B506


def _where(error: Exception) -> str:
    """The problem of a YAML error, with its line."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    if mark is None or problem is None:
        return " ".join(str(error).split())[:200]
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}"[:200]
