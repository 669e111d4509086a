"""What the page of results has to show, each line with what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from studies.dbd.draws import TOLD, Row, Value
from studies.tables import Column, table

Found = Mapping[str, Sequence[Row]]
_COLUMNS = (Column("part", "instances"), Column("what"), Column("asked"), Column("measured"), Column("holds"))


@dataclass(frozen=True)
class Claim:
    """A bound on one number of one row.

    Args:
        part: of the page.
        text: what is bounded.
        key: of the row.
        least: bound from below; or
        most: from above.
        where: settings that tell the row from others.
    """

    part: str
    text: str
    key: str
    least: float | None = None
    most: float | None = None
    where: Mapping[str, Value] | None = None

    def measured(self, found: Found) -> float | None:
        """The number, or None where there is none."""
        where = self.where or {}
        rows = [row for row in found[self.part] if all(row.settings[name] == v for name, v in where.items())]
        number: float | None = getattr(rows[0], self.key)
        return number

    def holds(self, value: float | None) -> bool:
        """Whether a number keeps the bound."""
        if value is None:
            return False
        return value >= self.least if self.least is not None else value <= (self.most or 0.0)

    def bound(self) -> str:
        """The bound in signs."""
        return f"≥ {self.least:g}" if self.least is not None else f"≤ {self.most:g}"


def claims(extensions: Sequence[str]) -> list[Claim]:
    """The bounds, in the order of the page; ``extensions`` are names of parts that have to succeed."""
    found = [
        Claim("full", "success", "success", least=0.96),
        Claim("full_alone", "median, s", "median_s", most=1.0),
        Claim("full_alone", "90th percentile, s", "p90_s", most=2.0),
        Claim("full", "certified", "certified", least=0.8),
        Claim("small", "success", "success", least=0.96),
    ]
    for part in ("stressed_paths", "stressed_subspace"):
        found.append(Claim(part, "success of `sfw`", "success", least=0.9))
        separate = {"gram": "separate"}
        for key, slack in (("optimum", "2e-5"), ("near", "1e-3")):
            text = f"value with separate Gram matrices within {slack} of the truth's"
            found.append(Claim(f"{part}_dual", text, key, 0.35, where=separate))
    found += [
        Claim("block", "success", "success", least=0.9),
        Claim("block_weights", "certified with balanced weights", "certified", 0.8, where={"weights": "balanced"}),
    ]
    for level, right, error in ((20, 0.85, 1.2), (10, 0.6, 1.3)):
        found.append(Claim("noise", f"right numbers at {level} dB", "right_number", right, where={"snr_db": level}))
        text = f"RMSE over bound at {level} dB, given right numbers"
        found.append(Claim("noise", text, "rmse_over_bound", most=error, where={"snr_db": level}))
    for told in TOLD:
        text = f"reported as exact, noise level {told}"
        found.append(Claim("noise_alone", text, "exact", most=0.0, where={"sigma": told}))
    found += [Claim(name, "success", "success", least=0.95) for name in extensions]
    for part, seconds in (("cost_2145", 5.0), ("cost_8385", 60.0)):
        found += [Claim(part, "success", "success", 1.0), Claim(part, "longest, s", "max_s", most=seconds)]
    return found


def shared_gram(rows: Sequence[Row]) -> tuple[float, float]:
    """By how much the truth is less often its optimum, and the most its value exceeds the separate one's."""
    by_gram = {row.settings["gram"]: row for row in rows}
    separate, shared = by_gram["separate"], by_gram["shared"]
    excess = max(b - a for a, b in zip(separate.values or (), shared.values or (), strict=True))
    return (separate.optimum or 0.0) - (shared.optimum or 0.0), excess


def claims_table(found: Found, titles: Mapping[str, str]) -> str:
    """Every bound, what was measured, and whether it holds, as Markdown."""
    lines = []
    for claim in claims([name for name in found if name.startswith("extension_")]):
        value = claim.measured(found)
        said = "–" if value is None else f"{value:.3g}"
        lines.append(_line(titles[claim.part], claim.text, claim.bound(), said, claim.holds(value)))
    for part in ("stressed_paths_dual", "stressed_subspace_dual"):
        fewer, excess = shared_gram(found[part])
        text = "share where the truth is the optimum with separate, not with shared Gram matrices"
        lines.append(_line(titles[part], text, "> 0", f"{fewer:.3g}", fewer > 0))
        text = "most by which its value exceeds the separate one, any draw"
        lines.append(_line(titles[part], text, "≤ 0.002", f"{excess:.2g}", excess <= 2e-3))
    return table(lines, _COLUMNS)


def _line(title: str, text: str, asked: str, measured: str, holds: bool) -> dict[str, str]:
    return {"part": title, "what": text, "asked": asked, "measured": measured, "holds": "yes" if holds else "**no**"}
