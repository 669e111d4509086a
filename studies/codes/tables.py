"""The study of codes as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from studies.codes.records import AblationRow, Figures, LightRow, RankedRow, Results, TestRow
from studies.codes.searches import mean
from studies.tables import Column, records, table

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
    *(_NOISE, _CODES, _PRIOR),
    Column("psnr", "PSNR (dB)", ".2f"),
    Column("gain", "measured gain over static (dB)", _GAIN),
    Column("expected", "expected gain (dB)", _GAIN),
    Column("predicted", "predicted gain (dB)", _GAIN),
    Column("there", "predicted, dimmed to each scene (dB)", _GAIN),
    _LIGHT,
)
_SCENE = (
    *(_NOISE, _CODES, _PRIOR),
    Column("scene"),
    Column("predicted", "predicted (dB)", _GAIN),
    Column("there", "predicted, dimmed to the scene (dB)", _GAIN),
    Column("gain", "measured (dB)", _GAIN),
    Column("miss", "measured - predicted in the light (dB)", _GAIN),
    Column("seeds", "measured, seed by seed (dB)"),
)
_NETWORK = (
    *(_NOISE, _CODES),
    *(_EXPECTED, _LMMSE, _UNROLLED),
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
    *(_NOISE, _CODES),
    _LIGHT,
    _EXPECTED,
    Column("expected_there", "expected, examples dimmed (dB)", ".2f"),
    Column("expected_mixture", "expected, mixture (dB)", ".2f"),
    _LMMSE,
    _UNROLLED,
)


def study_markdown(found: Results) -> str:
    """The study for people."""
    lines = [*_opening(found), "## At equal exposure time", "", table(records(grid_rows(found, 1)), _GRID)]
    lines += ["## Per slot", "", "Every slot has the whole exposure time, K times the electrons before one "
              "readout; the static code is given the time of all K slots as well, and in one column that of one "
              "slot.", ""]  # fmt: skip
    for times in sorted({row["exposures"] for row in found["grid"]} - {1}):
        lines += [table(records(grid_rows(found, times)), _PER_SLOT)]
    if found["test"]:
        lines += _on_test_scenes(found)
    if found["network"]:
        lines += ["## In trained networks", "", f"An unrolled network for each code, noise and seed, {found['steps']} "
                  "steps each; means over the middle of the test scenes.", ""]  # fmt: skip
        lines += [table(records(network_rows(found["network"])), _NETWORK)]
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
        "designed and decoded alike. The predicted gain is that under the prior of the other examples, as `tmca "
        "design` says it. Dimmed: the examples' light is lowered until their mean irradiance is that of the scene. "
        f"Codes designed for the light were searched on examples dimmed to {found['mean_irradiance']:.3f}, the mean of "
        "the test scenes, as `tmca design --light` searches them, and are predicted there; all other codes know the "
        "examples as they are. A dimmed prior is scaled to that mean too, as the forecast assumes. What is measured is "
        "set against the predicted gain of codes designed for the light, and that dimmed to the scene of others."
    )
    lines = ["## On test scenes", "", said, ""]
    lines += [table(records(test_rows(found["test"], found["light"])), _TEST), "Scene by scene, means over seeds:", ""]
    return [*lines, table(records(scene_rows(found["test"], found["light"])), _SCENE)]


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


def grid_rows(found: Results, exposures: int) -> pd.DataFrame:
    """Rows of the grid at one number of exposures, with the gain under the prior of the other scenes."""
    rows = pd.DataFrame(found["grid"])
    single = rows[(rows.kind == "static") & (rows.exposures == 1)].set_index("noise").psnr
    gains = pd.DataFrame(rows.held_out_gains.tolist())
    rows = rows.assign(held_out=gains.mean(axis=1), spread=gains.std(axis=1), ahead=rows.psnr - rows.noise.map(single))
    return rows[rows.exposures == exposures]


def test_rows(cells: Sequence[TestRow], lit: Sequence[LightRow]) -> pd.DataFrame:
    """Means over scenes and seeds of every kind of codes, with the gain over the designed static ones.

    Args:
        cells: of the test scenes.
        lit: what dimming the examples to them changes.
    """
    return _means(_shown(cells, lit), ["noise", "prior", "codes"])


def scene_rows(cells: Sequence[TestRow], lit: Sequence[LightRow]) -> pd.DataFrame:
    """Predicted and measured gain of designed time-multiplexed codes, a row for each test scene; ``miss`` is from what
    `--light` says of codes that were designed for the light, and from what dimmed examples say of all others."""
    shown = _shown(cells, lit)
    shown = shown[shown.codes.str.contains("designed") & ~shown.codes.str.startswith("static")]
    rows = _means(shown.assign(place=shown.noise.factorize()[0]), ["place", "noise", "codes", "prior", "scene"])
    rows = rows.sort_values(["place", "codes", "prior"], kind="stable")
    return rows.assign(miss=rows.gain - rows.predicted.where(rows.codes.str.endswith(_FOR_LIGHT), rows.there))


def _shown(cells: Sequence[TestRow], lit: Sequence[LightRow]) -> pd.DataFrame:
    """A row for all codes of every cell and prior, a noise after the other."""
    there = {(cell["noise"], cell["scene"], cell["seed"]): cell["there"] for cell in lit}
    rows: list[dict[str, object]] = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        dimmed = [cell for cell in lit if cell["noise"] == noise]
        parts = [(cell, cell["metrics"], STATIC, _PLAIN) for cell in cells if cell["noise"] == noise]
        parts += [(cell, _as_learned(cell), STATIC + _FOR_LIGHT, _PLAIN) for cell in dimmed]
        parts += [(cell, cell["metrics"], STATIC + _FOR_LIGHT, _DIMMED) for cell in dimmed]
        for cell, metrics, static, prior in parts:
            named = {"noise": noise, "scene": cell["scene"], "seed": str(cell["seed"]), "prior": prior}
            gains = there[noise, cell["scene"], cell["seed"]]
            rows += [{**named, "codes": codes, "there": gains[codes], **_gains(figures, metrics[static])}
                     for codes, figures in metrics.items()]  # fmt: skip
    return pd.DataFrame(rows)


def _as_learned(cell: LightRow) -> dict[str, Figures]:
    """Figures of codes by the prior as it was learned; what was predicted of the codes stays."""
    return {name: {**figures, **cell["plain_prior"][name]} for name, figures in cell["metrics"].items()}


def _gains(figures: Figures, static: Figures) -> Figures:
    return {
        "psnr": figures["psnr"], "gain": figures["psnr"] - static["psnr"],
        "expected": figures["expected_psnr"] - static["expected_psnr"], "predicted": figures["predicted_gain"],
        "throughput": figures["throughput"],
    }  # fmt: skip


def network_rows(cells: Sequence[RankedRow]) -> pd.DataFrame:
    """Means over scenes and seeds of every code that networks were trained for, with the gain over static codes."""
    rows = pd.DataFrame([
        {"noise": c["noise"], "codes": c["codes"], "seed": str(c["seed"]), "scene": scene, "expected": c["expected"],
         "lmmse": c["lmmse"][scene], "unrolled": psnr}
        for c in cells for scene, psnr in c["unrolled"].items()
    ])  # fmt: skip
    same = ["noise", "seed", "scene"]
    static = rows[rows.codes == STATIC].set_index(same).unrolled
    return _means(rows.assign(gain=rows.unrolled - rows.set_index(same).index.map(static)), ["noise", "codes"])


def _means(rows: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Means of all numbers over the rows of a group, and the mean gain of every seed and scene as a text."""
    groups = rows.groupby(by, sort=False)
    means = groups.mean(numeric_only=True)
    for name in {"seed", "scene"} - {*by}:
        means[f"{name}s"] = groups[[name, "gain"]].apply(_each, name)
    return means.reset_index()


def _each(rows: pd.DataFrame, name: str) -> str:
    means = rows.groupby(name, sort=False).gain.mean()
    return ", ".join(f"{value} {gain:{_GAIN}}" for value, gain in means.items())


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
    return [
        {**row, **{decoder: mean(row[decoder]) for decoder in ("lmmse", "unrolled") if decoder in row}}
        for row in sorted(found["ranking"], key=lambda row: (row["noise"], -row["expected"]))
    ]
