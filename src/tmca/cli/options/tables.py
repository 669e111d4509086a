"""Markdown tables of a text as tables of a terminal."""

from __future__ import annotations

import re
import sys
from itertools import groupby

_SPLIT = re.compile(r"(?<!\\)\|")


def print_text(text: str, markdown: bool = False) -> None:
    """Print a text: its Markdown tables drawn where a terminal shows them, as they are in a pipe or if asked for."""
    if markdown or not sys.stdout.isatty():
        print(text)
        return
    from rich.console import Console

    console = Console()
    for is_table, lines in groupby(text.splitlines(), lambda line: line.startswith("|")):
        block = list(lines)
        if is_table and len(block) > 1:
            console.print(_table(block))
        else:
            print("\n".join(block))


def _table(lines: list[str]) -> object:
    """A Markdown table, whose second line is a rule; columns of numbers end at the right."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    heads, _, *rows = (_cells(line) for line in lines)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for place, head in enumerate(heads):
        numbers = [row[place] for row in rows if place < len(row) and row[place]]
        right = bool(numbers) and all(cell.strip("*").lstrip("+-−").partition(" ")[0][:1].isdigit() for cell in numbers)
        table.add_column(Text(head), justify="right" if right else "left")
    for row in rows:
        bold = [Text(cell.strip("*"), "bold" if cell.startswith("**") else "") for cell in row]
        table.add_row(*bold[: len(heads)])
    return table


def _cells(line: str) -> list[str]:
    return [cell.strip().replace("\\|", "|") for cell in _SPLIT.split(line.strip().removeprefix("|").removesuffix("|"))]
