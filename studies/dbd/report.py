"""The results page of dual blind deconvolution: fixed instances, limits, noise, cost; one resumable command."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from studies.dbd.claims import Found, claims_table
from studies.dbd.draws import TOLD, Row, Study, Value, run_studies
from studies.dbd.tables import study_figure, study_table
from studies.grid import Timed, repository_commit
from studies.tables import write_results
from tmca.plots import BLUE, blank_figure, plain_axes, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FULL = {"M": 13, "P": 9, "J": 3, "L": 3, "Q": 3}
_SMALL = {"M": 9, "P": 5, "J": 2, "L": 2, "Q": 2}


@dataclass(frozen=True)
class Part:
    """A section of the page.

    Args:
        name: of its picture.
        title: of the section.
        study: what is drawn.
        text: what it shows.
        picture: whether success is drawn.
    """

    name: str
    title: str
    study: Study
    text: str = ""
    picture: bool = False


def parts() -> list[Part]:
    """The sections in their order."""
    return [*_instances(), *_stressed(), *_block(), *_noise(), *_extensions(), *_transitions(), *_cost()]


def _instances() -> list[Part]:
    text = "Noiseless `shared` messages; a success has the right numbers and torus errors below 1e-6."
    alone = "The same instances without certificates, which take most of the time above and are no part of a recovery."
    found = []
    for name, title, fixed in (
        ("full", "13 x 9, J = 3, L = Q = 3", _FULL),
        ("small", "9 x 5, J = 2, L = Q = 2", _SMALL),
    ):
        certified, plain = (Study({"messages": ["shared"]}, fixed, 50, certify=certify) for certify in (True, False))
        found.append(Part(name, f"Fixed instances: {title}", certified, text))
        found.append(Part(f"{name}_alone", f"Fixed instances, recovery alone: {title}", plain, alone))
    return found


def _stressed() -> list[Part]:
    text = (
        "More paths, or larger subspaces, than the sum of atomic norms always carries. The truth is the optimum of the "
        "dual programme where its value reaches the truth's norm to 2e-5; others come within 1e-3. Every method fits "
        "atoms to the samples afterwards: a success need not be an optimum. The shared Gram matrix is the thesis' (81)."
    )
    found = []
    for name, sizes in (("paths", {"J": 2, "L": 3, "Q": 3}), ("subspace", {"J": 3, "L": 2, "Q": 2})):
        fixed = {"M": 9, "P": 5, **sizes}
        title = f"Stressed: 9 x 5, J = {sizes['J']}, L = Q = {sizes['L']}"
        found.append(Part(f"stressed_{name}", title, Study({"method": ["sfw"]}, fixed, 50, certify=True), text))
        duals = Study(
            {"gram": ["separate", "shared"]}, {**fixed, "method": "sdp", "early": False, "accuracy": 1e-6}, 20
        )
        found.append(Part(f"stressed_{name}_dual", f"{title}, dual programme to the end", duals))
    return found


def _block() -> list[Part]:
    fixed: dict[str, Value] = {"messages": "block", "J": 2}
    plain = Study({"messages": ["block"]}, {"M": 21, "P": 9, "J": 2, "L": 3, "Q": 3}, 20, certify=True)
    weighted = Study({"weights": ["plain", "balanced"]}, {**fixed, "M": 33, "P": 9, "L": 2, "Q": 2}, 20, certify=True)
    text = (
        "Delays, and Dopplers relative to each other: the dual polynomial of such messages does not depend on the "
        "Doppler (`tests/dbd/test_messages.py`). Weights `balanced` are P^(-1/4) for the messages."
    )
    return [
        Part("block", "Block messages: 21 x 9, J = 2, L = Q = 3", plain, text),
        Part("block_weights", "Block messages: 33 x 9, J = 2, L = Q = 2", weighted, text),
    ]


def _noise() -> list[Part]:
    text = (
        "A success has the right numbers and every path within half of the finest resolution cell; errors over "
        "the Cramér–Rao bound at the truth, of all draws with the right numbers, and of the successes."
    )
    alone = "Signals 100 dB below the noise; what the solver is told of the noise's level."
    return [
        Part("noise", "Noise: 13 x 9, J = 3, L = Q = 3", Study({"snr_db": [30, 20, 10, 5, 0]}, _FULL, 100), text, True),
        Part("noise_alone", "Noise alone: 13 x 9, J = 3", Study({"sigma": TOLD}, {**_FULL, "snr_db": -100}, 20), alone),
        Part(
            "unknown_noise", "Unknown noise: 13 x 9, J = 3, L = Q = 3",
            Study({"snr_db": [20, 10]}, {**_FULL, "sigma": "unknown"}, 20), "The solver estimates the noise's level.",
        ),
    ]  # fmt: skip


def _extensions() -> list[Part]:
    fixed: dict[str, Value] = {"M": 13, "P": 9, "J": 2, "L": 2, "Q": 2}
    named: list[tuple[str, dict[str, Value]]] = [
        ("two radars and two transmitters", {"L": "2+2", "Q": "2+2"}),
        ("four antennas", {"M": 9, "P": 5, "antennas": 4}),
        ("known lag", {"lag": 0.137}),
        ("lag beyond the prefix, shared", {"late_samples": 3}),
        ("lag beyond the prefix, block", {"late_samples": 3, "messages": "block", "M": 21, "basis": "gaussian"}),
        ("messages of three intervals", {"symbol_ratio": 3.0}),
        ("messages of half an interval", {"symbol_ratio": 0.5, "M": 29}),
        ("three targets, one path", {"L": 3, "Q": 1}),
        ("radar alone", {"L": 3, "Q": 0}),
        ("half the separation", {"separation": 0.1}),
        ("paths up to 26 dB apart", {"weakest": 0.05}),
        ("Doppler alone", {"M": 1, "P": 21, "J": 2, "L": 0, "Q": 2}),
        ("delay alone", {"M": 21, "P": 1, "J": 2, "L": 2, "Q": 0}),
    ]
    return [
        Part(f"extension_{index}", f"Extension: {title}", Study({"messages": [more.get("messages", "shared")]},
             {**fixed, **{name: value for name, value in more.items() if name != "messages"}}, 20))
        for index, (title, more) in enumerate(named)
    ]  # fmt: skip


def _transitions() -> list[Part]:
    close: dict[str, Value] = {"M": 9, "P": 5, "separation": 0.12, "basis": "gaussian"}
    paths = Study({"L": [1, 2, 3, 4, 5], "J": [1, 2, 3, 4]}, {**close, "Q": 2}, 10)
    block = Study(
        {"Q": [1, 2, 3, 4, 5], "J": [1, 2, 3]},
        {"M": 11, "P": 5, "L": 2, "messages": "block", "separation": 0.08, "basis": "gaussian"},
        10,
    )
    apart = Study({"separation": [0.02, 0.04, 0.06, 0.08, 0.12]}, {**_FULL}, 20)
    text = "Red: more lifted unknowns than samples, where no convex method can succeed (the corrected theorem 2)."
    within = "No setting has more lifted unknowns than samples (the corrected theorem 2)."
    return [
        Part("targets", "Phase transition: targets and subspace, 9 x 5, Q = 2, shared", paths, within, True),
        Part("paths_block", "Phase transition: paths and subspace, 11 x 5, L = 2, block", block, text, True),
        Part("separation", "Separation: 13 x 9, J = 3, L = Q = 3", apart, "Least distance in one coordinate.", True),
    ]


def _cost() -> list[Part]:
    sizes = [(9, 5, 2, 2), (13, 9, 3, 3), (21, 11, 3, 4), (33, 17, 3, 5), (65, 33, 3, 8), (129, 65, 3, 10)]
    return [
        Part(f"cost_{M * P}", f"Cost: {M} x {P}, J = {J}, L = Q = {count}",
             Study({"M": [M]}, {"P": P, "J": J, "L": count, "Q": count}, 5))
        for M, P, J, count in sizes
    ]  # fmt: skip


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
    page = [replace(one, study=_shortened(one.study, draws)) for one in parts()]
    rows = run_studies([one.study for one in page], work, jobs=jobs, progress=progress)
    found = {part.name: part_rows for part, part_rows in zip(page, rows, strict=True)}
    cost = Cost.of([own[0] for name, own in found.items() if name.startswith("cost_")])
    results: Results = {
        "command": shlex.join(command), "commit": repository_commit(), "cost_exponent": cost.exponent,
        "parts": {
            part.name: {"title": part.title, "draws": part.study.draws, "fixed": dict(part.study.fixed),
                        "rows": [row.plain() for row in found[part.name]]}
            for part in page
        },
    }  # fmt: skip
    lines = _head(results, found, {part.name: part.title for part in page})
    for part in page:
        lines += _section(part, found[part.name], out, overwrite)
    picture = out.with_name(f"{out.name}_cost.png")
    save_figure(cost.figure(), picture, overwrite=overwrite)
    lines += [f"Time grows with MP to the power {cost.exponent:.2f} over the last four sizes.", ""]
    lines += [f"![cost]({picture.name})", ""]
    write_results(results, "\n".join(lines), out.with_name(out.name + ".json"), overwrite)


def page_files(out: Path) -> list[Path]:
    """Everything the page is made of."""
    pictures = [f"_{part.name}.png" for part in parts() if part.picture]
    return [out.with_name(out.name + suffix) for suffix in (".md", ".json", "_cost.png", *pictures)]


def _shortened(study: Study, draws: int | None) -> Study:
    return study if draws is None else replace(study, draws=min(draws, study.draws))


def _section(part: Part, rows: list[Row], out: Path, overwrite: bool) -> list[str]:
    """Title, text, table and picture of a part."""
    lines = [f"## {part.title}", "", *([part.text, ""] if part.text else []), study_table(part.study, rows)]
    if part.picture:
        picture = out.with_name(f"{out.name}_{part.name}.png")
        save_figure(study_figure(part.study, rows), picture, overwrite=overwrite)
        lines += [f"![{part.title}]({picture.name})", ""]
    return lines


def _head(results: Results, found: Found, titles: dict[str, str]) -> list[str]:
    """Title, command, and what was asked beside what was measured."""
    return [
        "# Dual blind deconvolution", "", f"Command: `{results['command']}` at commit `{results['commit']}`.", "",
        "Times are of one thread's processor, certificates included where there are any. "
        "Speed against CVXPY, and memory: `python benchmarks/dbd.py`.", "", claims_table(found, titles),
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
