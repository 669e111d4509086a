"""Tables of the studies as Markdown, and their files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pandas as pd


class Column(NamedTuple):
    """A column of a table.

    Args:
        key: of the rows.
        heading: over the column; the key if empty.
        spec: format of the values.
    """

    key: str
    heading: str = ""
    spec: str = ""


def records(frame: pd.DataFrame) -> list[dict[str, object]]:
    """Rows of a table; None where a value is not known."""
    rows: list[dict[str, object]] = frame.astype(object).where(frame.notna(), None).to_dict("records")
    return rows


def table(rows: Sequence[Mapping[str, object]], columns: Sequence[Column], missing: str = "") -> str:
    """Rows as a Markdown table; ``missing`` stands for values that are None or not there."""
    lines = [
        "| " + " | ".join(column.heading or column.key for column in columns) + " |",
        "|" + " --- |" * len(columns),
    ]
    for row in rows:
        values = [row.get(column.key) for column in columns]
        texts = [missing if v is None else format(v, c.spec) for v, c in zip(values, columns, strict=True)]
        lines.append("| " + " | ".join(texts) + " |")
    return "\n".join(lines) + "\n"


def pooled(rows: Iterable[Mapping[str, Any]], by: Sequence[str], means: Iterable[str]) -> list[dict[str, Any]]:
    """Rows that have the same values ``by`` these names as one each: the first, with means over all."""
    groups, names = dict[tuple[Any, ...], list[Mapping[str, Any]]](), [*means]
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    return [{**some[0], **{name: fmean(row[name] for row in some) for name in names}} for some in groups.values()]


def write_results(results: Mapping[str, object], text: str, json: Path, overwrite: bool) -> None:
    """Results for programs into a JSON file, and for people into the Markdown file beside it.

    Raises:
        OutputError: a file exists and ``overwrite`` is False, or cannot be written.
    """
    from tmca.data import write_json, write_text

    write_json(results, json, overwrite=overwrite)
    write_text(text, json.with_suffix(".md"), overwrite=overwrite)
