"""The run's figures as a CSV file that any spreadsheet opens."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from tmca.data import write_text
from tmca.data.formats.stored import whole_file
from tmca.errors import DataError
from tmca.text_files import read_text


class TrainingLog:
    """One line per validation: step and figures.

    Args:
        path: CSV file; lines are added to what is there.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def rows(self) -> list[dict[str, str]]:
        """What is written so far."""
        if not self.path.exists():
            return []
        text = read_text(self.path, "a log of a run", "delete it")
        with whole_file(self.path, "log of a run", "delete it"):
            rows = list(csv.DictReader(text.splitlines(), restval="", strict=True))
        for row in rows:
            if None in row or not (row.get("step") or "").isdecimal() or not all(map(_figure, row.values())):
                raise DataError(self.path, f"a line {list(row.values())}"[:80], "a step and its figures", "delete it")
        return rows

    def keep_until(self, step: int) -> None:
        """Forget lines after a step: a resumed run writes them again."""
        rows = self.rows()
        if any(int(row["step"]) > step for row in rows):
            self._write([row for row in rows if int(row["step"]) <= step])

    def add(self, step: int, figures: Mapping[str, float]) -> None:
        """Add a line."""
        self._write([*self.rows(), {"step": str(step), **{name: f"{value:.6g}" for name, value in figures.items()}}])

    def _write(self, rows: list[dict[str, str]]) -> None:
        names = list(dict.fromkeys(name for row in rows for name in row)) or ["step"]
        lines = [",".join(names), *(",".join(row.get(name, "") for name in names) for row in rows)]
        write_text("\n".join(lines) + "\n", self.path, overwrite=True)


def _figure(text: str) -> bool:
    """Whether it is a number, or nothing."""
    try:
        float(text or 0)
    except ValueError:
        return False
    return True
