"""The results page of dual blind deconvolution: fixed instances, limits, noise, cost; one resumable command."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from studies.dbd.claims import Claim, Found, claims_table
from studies.dbd.draws import Row, Study, Value, run_studies
from studies.dbd.tables import study_figure, study_table
from studies.grid import Timed, repository_commit
from studies.tables import write_results
from tmca.plots import BLUE, blank_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Part(BaseModel):
    """A section of the page; ``vary``, ``set``, ``draws`` and ``certify`` are of its `Study`.

    Args:
        name: of its picture.
        title: of the section.
        text: what it shows.
        picture: whether success is drawn.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    title: str
    text: str = ""
    vary: dict[str, list[Value]]
    fixed: dict[str, Value] = Field(alias="set")
    draws: int = 20
    certify: bool = False
    picture: bool = False

    @property
    def study(self) -> Study:
        """What is drawn."""
        return Study(self.vary, self.fixed, self.draws, self.certify)


class Page(BaseModel):
    """``page.yaml``: sections in their order, and what their numbers have to be."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sections: list[Part]
    asked: list[Claim]

    @classmethod
    def read(cls) -> Page:
        """The page of the results."""
        return cls(**yaml.safe_load(Path(__file__).with_name("page.yaml").read_text(encoding="utf-8")))


class PartResults(TypedDict):
    """A part of ``dbd.json``; rows are those of `Row.plain`."""

    title: str
    draws: int
    fixed: dict[str, Value]
    rows: list[dict[str, Any]]


class Results(TypedDict):
    """What ``dbd.json`` holds."""

    command: str
    commit: str | None
    parts: dict[str, PartResults]
    cost_exponent: float


def write_report(
    out: Path, work: Path, command: Sequence[str], *, jobs: int = 1, progress: Timed | None = None,
    overwrite: bool = False, draws: int | None = None,
) -> None:  # fmt: skip
    """Computes what is missing and writes OUT.md, OUT.json and the pictures; ``draws`` for a quick look."""
    page = Page.read()
    if draws is not None:
        shorter = [part.model_copy(update={"draws": min(draws, part.draws)}) for part in page.sections]
        page = page.model_copy(update={"sections": shorter})
    rows = run_studies([part.study for part in page.sections], work, jobs=jobs, progress=progress)
    found = {part.name: part_rows for part, part_rows in zip(page.sections, rows, strict=True)}
    cost = Cost.of([part_rows[0] for name, part_rows in found.items() if name.startswith("cost_")])
    results: Results = {
        "command": shlex.join(command), "commit": repository_commit(), "cost_exponent": cost.exponent,
        "parts": {
            part.name: {"title": part.title, "draws": part.draws, "fixed": part.fixed,
                        "rows": [row.plain() for row in found[part.name]]}
            for part in page.sections
        },
    }  # fmt: skip
    lines = _head(results, page, found)
    for part in page.sections:
        lines += _section(part, found[part.name], out, overwrite)
    picture = out.with_name(f"{out.name}_cost.png")
    save_figure(cost.figure(), picture, overwrite=overwrite)
    lines += [f"Time grows with MP to the power {cost.exponent:.2f} over the last four sizes.", ""]
    lines += [f"![cost]({picture.name})", ""]
    write_results(results, "\n".join(lines), out.with_name(out.name + ".json"), overwrite)


def page_files(out: Path) -> list[Path]:
    """Everything the page is made of."""
    pictures = [f"_{part.name}.png" for part in Page.read().sections if part.picture]
    return [out.with_name(out.name + suffix) for suffix in (".md", ".json", "_cost.png", *pictures)]


def _section(part: Part, rows: list[Row], out: Path, overwrite: bool) -> list[str]:
    """Title, text, table and picture of a part."""
    lines = [f"## {part.title}", "", *([part.text, ""] if part.text else []), study_table(part.study, rows)]
    if part.picture:
        picture = out.with_name(f"{out.name}_{part.name}.png")
        save_figure(study_figure(part.study, rows), picture, overwrite=overwrite)
        lines += [f"![{part.title}]({picture.name})", ""]
    return lines


def _head(results: Results, page: Page, found: Found) -> list[str]:
    """Title, command, and what was asked beside what was measured."""
    titles = {part.name: part.title for part in page.sections}
    return [
        "# Dual blind deconvolution", "", f"Command: `{results['command']}` at commit `{results['commit']}`.", "",
        "Times are of one thread's processor, certificates included where there are any. "
        "Speed against CVXPY, and memory: `python benchmarks/dbd.py`.", "", claims_table(page.asked, found, titles),
    ]  # fmt: skip


@dataclass(frozen=True)
class Cost:
    """Seconds over the number of samples, and the power law of the last four.

    Args:
        sizes: samples MP.
        seconds: medians.
        exponent: of the power law.
        offset: logarithm of its seconds at one sample.
    """

    sizes: Sequence[int]
    seconds: Sequence[float]
    exponent: float
    offset: float

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Cost:
        """The cost that rows of rising size tell."""
        sizes = [int(row.settings["M"]) * int(row.settings["P"]) for row in rows]
        seconds = [row.median_s for row in rows]
        exponent, offset = np.polyfit(np.log(sizes[-4:]), np.log(seconds[-4:]), 1)
        return cls(sizes, seconds, float(exponent), float(offset))

    def figure(self) -> Figure:
        """Times and power law on logarithmic axes."""
        figure = blank_figure(5.2, 3.8)
        axis, last = figure.subplots(), np.array(self.sizes[-4:])
        axis.loglog(self.sizes, self.seconds, "o-", color=BLUE, label="median of 5")
        law = np.exp(self.offset) * last**self.exponent
        axis.loglog(last, law, "--", color="0.5", label=f"power {self.exponent:.2f}")
        plain_axes(axis, "sliding Frank–Wolfe to an exact fit", "samples MP", "seconds")
        axis.set_xticks(self.sizes, [f"{size:g}" for size in self.sizes])
        axis.yaxis.set_major_formatter("{x:g}")
        axis.minorticks_off()
        axis.legend(fontsize=8)
        return figure
