"""The study of codes as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NotRequired, TypedDict

import numpy as np

from studies.codes.records import AblationRow, Figures, GridRow, LightRow, NetworkRow, Results, TestRow
from studies.tables import Column, table

STATIC = "static, designed"
_FOR_LIGHT = " for the light"
_PLAIN, _DIMMED = "as learned", "dimmed"
"""Priors that test scenes are decoded by."""
_GAIN = "+z.2f"
_NOISE, _CODES, _LIGHT = Column("noise"), Column("codes"), Column("throughput", "light", ".1%")
_EXPECTED, _LMMSE = Column("expected", "expected (dB)", ".2f"), Column("lmmse", "LMMSE (dB)", ".2f")
_UNROLLED, _PRIOR = Column("unrolled", "unrolled (dB)", ".2f"), Column("prior", "decoder's prior")
_GRID = (
    _NOISE,
    Column("kind", "codes"),
    Column("slots", "K", "d"),
    Column("random_psnr", "random (dB)", ".2f"),
    Column("psnr", "designed (dB)", ".2f"),
    Column("gain", "over static (dB)", _GAIN),
    Column("held_out", "over static, prior of the others (dB)", _GAIN),
    Column("spread", "±", ".2f"),
    _LIGHT,
    Column("seconds", "CPU s", ".0f"),
)
_PER_SLOT = (*_GRID[:6], Column("ahead", "over static in one slot's time (dB)", _GAIN), *_GRID[6:])
_TEST = (
    _NOISE,
    _CODES,
    _PRIOR,
    Column("psnr", "PSNR (dB)", ".2f"),
    Column("gain", "measured gain over static (dB)", _GAIN),
    Column("expected", "expected gain (dB)", _GAIN),
    Column("predicted", "foretold gain (dB)", _GAIN),
    Column("there", "foretold, dimmed to each scene (dB)", _GAIN),
    _LIGHT,
)
_SCENE = (
    _NOISE,
    _CODES,
    _PRIOR,
    Column("scene"),
    Column("predicted", "foretold (dB)", _GAIN),
    Column("there", "foretold, dimmed to the scene (dB)", _GAIN),
    Column("gain", "measured (dB)", _GAIN),
    Column("miss", "measured - foretold in the light (dB)", _GAIN),
    Column("seeds", "measured, seed by seed (dB)"),
)
_NETWORK = (
    _NOISE,
    _CODES,
    _EXPECTED,
    _LMMSE,
    _UNROLLED,
    Column("gain", "unrolled over static designed (dB)", _GAIN),
    Column("seeds", "seed by seed (dB)"),
    Column("scenes", "scene by scene (dB)"),
)
_RANK = (
    _NOISE,
    Column("decoder"),
    Column("codes", "", "d"),
    Column("rank_correlation", "rank correlation", ".2f"),
    Column("rank_correlation_there", "expected, examples dimmed", ".2f"),
    Column("mixture_rank_correlation", "by the mixture's expected error", ".2f"),
)
_RANKED = (
    _NOISE,
    _CODES,
    _LIGHT,
    _EXPECTED,
    Column("expected_there", "expected, examples dimmed (dB)", ".2f"),
    Column("expected_mixture", "expected, mixture (dB)", ".2f"),
    _LMMSE,
    _UNROLLED,
)


class GridLine(GridRow):
    """A line of the grid's table: its gain under the prior of the other scenes, and over static codes in one slot."""

    held_out: float
    spread: float
    ahead: float


class TestLine(TypedDict):
    """Means over scenes and seeds, dB: measured, expected and predicted gains over the designed static codes."""

    noise: str
    codes: str
    prior: str
    psnr: float
    gain: float
    expected: float
    predicted: float
    throughput: float
    seeds: str
    there: float
    scene: NotRequired[str]
    miss: NotRequired[float]


class NetworkLine(TypedDict):
    """Means over scenes and seeds, dB; the gain is the network's over that of the designed static codes."""

    noise: str
    codes: str
    expected: float
    lmmse: float
    unrolled: float
    gain: float
    seeds: str
    scenes: str


def study_markdown(found: Results) -> str:
    """The study for people."""
    lines = [*_opening(found), "## At equal exposure time", "", table(grid_rows(found, 1), _GRID)]
    lines += ["## Per slot", "", "Every slot has the whole exposure time, K times the electrons before one "
              "readout; the static code is given the time of all K slots as well, and in one column that of one "
              "slot.", ""]  # fmt: skip
    for times in sorted({row["exposures"] for row in found["grid"]} - {1}):
        lines += [table(grid_rows(found, times), _PER_SLOT)]
    if found["test"]:
        lines += _on_test_scenes(found)
    if found["network"]:
        lines += ["## In trained networks", "", f"An unrolled network for each code, noise and seed, {found['steps']} "
                  "steps each; means over the middle of the test scenes.", ""]  # fmt: skip
        lines += [table(network_rows(found["network"]), _NETWORK)]
    lines += ["## What each ingredient contributes", "", f"Gain over the static design, K = {found['slots']} where not "
              "static: expected, and in brackets under the prior of the other scenes, dB.", ""]  # fmt: skip
    lines += [_ablation(found["ablation"])]
    if found["ranking"]:
        lines += ["## The order of codes", "", "Spearman's rank correlation of the expected PSNR with the mean PSNR on "
                  "the middle of the test scenes, and the codes themselves. Dimmed: the examples, to the mean "
                  "irradiance of the test scenes. The order is what is compared, not the level.", ""]  # fmt: skip
        lines += [table(found["rank_correlation"], _RANK), table(_ranked(found), _RANKED)]
    return "\n".join(lines)


def _on_test_scenes(found: Results) -> list[str]:
    """What was predicted and what came, over all test scenes and scene by scene."""
    said = (
        "Whole images by the patch LMMSE, means over scenes and seeds; gains are over the static codes that were "
        "designed and decoded alike. The foretold gain is that under the prior of the other examples, as `tmca design` "
        "says it. Dimmed: the examples' light is lowered until their mean irradiance is that of the scene. Codes "
        f"designed for the light were searched on examples dimmed to {found['mean_irradiance']:.3f}, the mean of the "
        "test scenes, as `tmca design --light` searches them, and are foretold there; all other codes know the "
        "examples as they are. A dimmed prior is scaled to that mean too, as the forecast assumes. What is measured is "
        "set against the foretold gain of codes designed for the light, and against that dimmed to the scene of others."
    )
    lines = ["## On test scenes", "", said, ""]
    lines += [table(test_rows(found["test"], found["light"]), _TEST), "Scene by scene, means over seeds:", ""]
    return [*lines, table(scene_rows(found["test"], found["light"]), _SCENE)]


def _opening(found: Results) -> list[str]:
    split = found["split"]
    effort = ", ".join(f"{name} {value}" for name, value in found["effort"].items())
    note = f" {found['note']}" if "note" in found else ""
    return [
        "# Codes that win: static against time-multiplexed, random against designed", "",
        f"Command: `{found['command']}` at commit `{found['commit']}`.{note}", "",
        f"Designed for {', '.join(split['train'])}; tile of {found['period'][0]}×{found['period'][1]} pixels; three "
        f"searches for every design ({effort}). PSNR is the expected one of the best linear estimate, block by block; "
        "each training scene is estimated under the prior of the others too, by codes that were searched for all. "
        "Free codes start from "
        "random ones, those of half the slots and one-hot ones, and are never below them in what is optimised; static "
        "codes have as many descents as the free ones of eight slots with all that these start from.", "",
    ]  # fmt: skip


def grid_rows(found: Results, exposures: int) -> list[GridLine]:
    """Rows of the grid at one number of exposures, with the gain under the prior of the other scenes."""
    single = {row["noise"]: row["psnr"] for row in found["grid"] if row["kind"] == "static" and row["exposures"] == 1}
    lines: list[GridLine] = []
    for row in found["grid"]:
        if row["exposures"] == exposures:
            gains = list(row["held_out_gains"].values())
            held_out, spread = float(np.mean(gains)), float(np.std(gains, ddof=1))
            lines.append({**row, "held_out": held_out, "spread": spread, "ahead": row["psnr"] - single[row["noise"]]})
    return lines


def test_rows(cells: Sequence[TestRow], lit: Sequence[LightRow]) -> list[TestLine]:
    """Means over scenes and seeds of every kind of codes, with the gain over the designed static ones.

    Args:
        cells: of the test scenes.
        lit: what dimming the examples to them changes.
    """
    lines: list[TestLine] = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        plain, there = [c for c in cells if c["noise"] == noise], [c for c in lit if c["noise"] == noise]
        for codes in plain[0]["metrics"]:
            lines.append(_test_line([c["metrics"] for c in plain], there, codes, STATIC, _PLAIN))
        for values, prior in (([_as_learned(c) for c in there], _PLAIN), ([c["metrics"] for c in there], _DIMMED)):
            lines += [_test_line(values, there, codes, STATIC + _FOR_LIGHT, prior) for codes in values[0]]
    return lines


def _as_learned(cell: LightRow) -> dict[str, Figures]:
    """Figures of codes by the prior as it was learned; what was predicted of the codes stays."""
    return {name: {**figures, **cell["plain_prior"][name]} for name, figures in cell["metrics"].items()}


def _test_line(
    cells: Sequence[dict[str, Figures]], lit: Sequence[LightRow], codes: str, static: str, prior: str
) -> TestLine:
    """A line of codes, of figures by codes that are in the order of ``lit``."""
    values, base = ([cell[name] for cell in cells] for name in (codes, static))
    pairs = list(zip(values, base, strict=True))
    gains, ahead = ([v[key] - b[key] for v, b in pairs] for key in ("psnr", "expected_psnr"))
    psnr, predicted, throughput = (_mean([v[key] for v in values]) for key in ("psnr", "predicted_gain", "throughput"))
    return {
        "noise": lit[0]["noise"], "codes": codes, "prior": prior, "psnr": psnr, "gain": _mean(gains),
        "expected": _mean(ahead), "predicted": predicted, "throughput": throughput,
        "seeds": _by([str(cell["seed"]) for cell in lit], gains),
        "there": _mean([cell["there"][codes] for cell in lit]),
    }  # fmt: skip


def scene_rows(cells: Sequence[TestRow], lit: Sequence[LightRow]) -> list[TestLine]:
    """Predicted and measured gain of designed time-multiplexed codes, a row for each test scene."""
    found: list[TestLine] = []
    for scene in dict.fromkeys(cell["scene"] for cell in cells):
        lines = test_rows([c for c in cells if c["scene"] == scene], [c for c in lit if c["scene"] == scene])
        found += [{**line, "scene": scene, "miss": line["gain"] - _predicted(line)} for line in lines]
    shown = [line for line in found if "designed" in line["codes"] and not line["codes"].startswith("static")]
    places = {noise: place for place, noise in enumerate(dict.fromkeys(cell["noise"] for cell in cells))}
    return sorted(shown, key=lambda line: (places[line["noise"]], line["codes"], line["prior"]))


def _predicted(line: TestLine) -> float:
    """What `--light` says of codes that were designed for the light; of all others, what dimmed examples say."""
    return line["predicted"] if line["codes"].endswith(_FOR_LIGHT) else line["there"]


def network_rows(cells: Sequence[NetworkRow]) -> list[NetworkLine]:
    """Means over scenes and seeds of every code that networks were trained for."""
    lines: list[NetworkLine] = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        known = [cell for cell in cells if cell["noise"] == noise]
        base = {cell["seed"]: cell["unrolled"] for cell in known if cell["codes"] == STATIC}
        for codes in dict.fromkeys(cell["codes"] for cell in known):
            lines.append(_network_line([cell for cell in known if cell["codes"] == codes], base))
    return lines


def _network_line(cells: Sequence[NetworkRow], base: dict[int, Figures]) -> NetworkLine:
    """The line of one code; ``base`` is the PSNR of the designed static codes by seed and scene."""
    ahead = [(c["seed"], s, c["unrolled"][s] - base[c["seed"]][s]) for c in cells for s in c["unrolled"]]
    gains = [gain for *_, gain in ahead]
    return {
        "noise": cells[0]["noise"], "codes": cells[0]["codes"], "expected": _mean([c["expected"] for c in cells]),
        "lmmse": float(np.mean([list(c["lmmse"].values()) for c in cells])),
        "unrolled": float(np.mean([list(c["unrolled"].values()) for c in cells])), "gain": _mean(gains),
        "seeds": _by([str(seed) for seed, *_ in ahead], gains), "scenes": _by([scene for _, scene, _ in ahead], gains),
    }  # fmt: skip


def _ablation(cells: Sequence[AblationRow]) -> str:
    """A row for each ingredient, a column for each noise."""
    rows: dict[str, dict[str, str]] = {}
    for cell in cells:
        for row in cell["rows"]:
            said = f"{row['gain']:{_GAIN}} ({row['held_out']:{_GAIN}})"
            rows.setdefault(row["ingredient"], {"ingredient": row["ingredient"]})[cell["noise"]] = said
    return table(list(rows.values()), [Column("ingredient", "codes"), *(Column(cell["noise"]) for cell in cells)])


def _ranked(found: Results) -> list[dict[str, object]]:
    """Ranked codes with means over the test scenes, best expected first."""
    ordered = sorted(found["ranking"], key=lambda row: (row["noise"], -row["expected"]))
    means = [(row["lmmse"], row.get("unrolled")) for row in ordered]
    return [
        {**row, "lmmse": _mean(list(lmmse.values())), "unrolled": _mean(list(network.values())) if network else None}
        for row, (lmmse, network) in zip(ordered, means, strict=True)
    ]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _by(names: Sequence[str], values: Sequence[float]) -> str:
    """Mean of the values of every name."""
    means = {name: _mean([v for n, v in zip(names, values, strict=True) if n == name]) for name in names}
    return ", ".join(f"{name} {value:{_GAIN}}" for name, value in means.items())
