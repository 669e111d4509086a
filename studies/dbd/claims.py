"""What the page of results has to show, each line with what was measured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from pydantic import BaseModel, ConfigDict

from studies.dbd.draws import Row, Value
from studies.tables import Column, table

Found = Mapping[str, Sequence[Row]]
_COLUMNS = (Column("part", "instances"), Column("what"), Column("asked"), Column("measured"), Column("holds"))


class Claim(BaseModel):
    """A bound on one number of one row.

    Args:
        part: of the page; or several, each of which has to hold it.
        what: is bounded.
        number: of a `Row`.
        least: bound from below; or
        most: from above.
        where: settings that tell the row from others.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    part: str | tuple[str, ...]
    what: str
    number: str
    least: float | None = None
    most: float | None = None
    where: Mapping[str, Value] = {}

    def of_parts(self) -> list[tuple[str, Claim]]:
        """Every part and its bound."""
        return [(part, self) for part in ((self.part,) if isinstance(self.part, str) else self.part)]

    def measured(self, rows: Sequence[Row]) -> float | None:
        """The number, or None where there is none."""
        found = [row for row in rows if all(row.settings[name] == value for name, value in self.where.items())]
        number: float | None = getattr(found[0], self.number)
        return number

    def line(self, title: str, rows: Sequence[Row]) -> dict[str, str]:
        """The line of the table."""
        value = self.measured(rows)
        bound = f"≥ {self.least:g}" if self.least is not None else f"≤ {self.most:g}"
        least, most = (-float("inf") if self.least is None else self.least), self.most
        holds = value is not None and least <= value and (most is None or value <= most)
        return _line(title, self.what, bound, "–" if value is None else f"{value:.3g}", holds)


def shared_gram(rows: Sequence[Row]) -> tuple[float, float]:
    """By how much the truth is less often its optimum, and the most its value exceeds the separate one's."""
    by_gram = {row.settings["gram"]: row for row in rows}
    separate, shared = by_gram["separate"], by_gram["shared"]
    excess = max(b - a for a, b in zip(separate.values or (), shared.values or (), strict=True))
    return (separate.optimum or 0.0) - (shared.optimum or 0.0), excess


def claims_table(claims: Iterable[Claim], found: Found, titles: Mapping[str, str]) -> str:
    """Every bound, what was measured, and whether it holds, as Markdown."""
    asked = [pair for claim in claims for pair in claim.of_parts()]
    lines = [claim.line(titles[part], found[part]) for part, claim in asked]
    for part in ("stressed_paths_dual", "stressed_subspace_dual"):
        fewer, excess = shared_gram(found[part])
        text = "share where the truth is the optimum with separate, not with shared Gram matrices"
        lines.append(_line(titles[part], text, "> 0", f"{fewer:.3g}", fewer > 0))
        text = "most by which its value exceeds the separate one, any draw"
        lines.append(_line(titles[part], text, "≤ 0.002", f"{excess:.2g}", excess <= 2e-3))
    return table(lines, _COLUMNS)


def _line(title: str, text: str, asked: str, measured: str, holds: bool) -> dict[str, str]:
    return {"part": title, "what": text, "asked": asked, "measured": measured, "holds": "yes" if holds else "**no**"}
