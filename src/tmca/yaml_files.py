"""YAML files that people write: names with values, of a bounded size; everything else is told in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.errors import DataError

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
        values = parsed_yaml(_text(file, expected))
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

    return yaml.load(text, SettingsLoader)  # noqa: S506 # nosec B506: a safe loader with bounds


def _text(file: Path, expected: str) -> str:
    try:
        if file.exists() and not file.is_file():
            raise DataError(file, "a folder" if file.is_dir() else "no regular file", expected)
        if (size := file.stat().st_size) > LARGEST:
            raise DataError(file, f"{size / 2**20:.0f} MB", f"{expected}, of at most {LARGEST // 2**20} MB")
        data = file.read_bytes()
    except FileNotFoundError:
        raise DataError(file, "no such file", expected, "check the path") from None
    except (OSError, ValueError) as error:
        raise DataError(file, f"a file that cannot be read ({error})", expected) from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data
        encoding = "UTF-16 or binary data" if wide else "bytes that are not UTF-8 (Latin-1 perhaps)"
        raise DataError(file, encoding, f"{expected}, as UTF-8 text", "save it as UTF-8")
    return text


def _where(error: Exception) -> str:
    """The problem of a YAML error, with its line."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    if mark is None or problem is None:
        return " ".join(str(error).split())[:200]
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}"[:200]
