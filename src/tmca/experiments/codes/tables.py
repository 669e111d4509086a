"""The study of codes as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tmca.experiments.results import markdown_table

STATIC = "static, designed"
_FOR_LIGHT = " for the light"
_PLAIN, _DIMMED = "as learned", "dimmed"
"""Priors that test scenes are decoded by."""
_GAIN = "+z.2f"
_GRID = (
    ("noise", "noise", ""),
    ("kind", "codes", ""),
    ("slots", "K", "d"),
    ("random_psnr", "random (dB)", ".2f"),
    ("psnr", "designed (dB)", ".2f"),
    ("gain", "over static (dB)", _GAIN),
    ("held_out", "over static, prior of the others (dB)", _GAIN),
    ("spread", "±", ".2f"),
    ("throughput", "light", ".1%"),
    ("seconds", "CPU s", ".0f"),
)
_PER_SLOT = (*_GRID[:6], ("ahead", "over static in one slot's time (dB)", _GAIN), *_GRID[6:])
_TEST = (
    ("noise", "noise", ""),
    ("codes", "codes", ""),
    ("prior", "decoder's prior", ""),
    ("psnr", "PSNR (dB)", ".2f"),
    ("gain", "measured gain over static (dB)", _GAIN),
    ("expected", "expected gain (dB)", _GAIN),
    ("predicted", "foretold gain (dB)", _GAIN),
    ("there", "foretold, dimmed to each scene (dB)", _GAIN),
    ("throughput", "light", ".1%"),
)
_SCENE = (
    ("noise", "noise", ""),
    ("codes", "codes", ""),
    ("prior", "decoder's prior", ""),
    ("scene", "scene", ""),
    ("predicted", "foretold (dB)", _GAIN),
    ("there", "foretold, dimmed to the scene (dB)", _GAIN),
    ("gain", "measured (dB)", _GAIN),
    ("miss", "measured - foretold in the light (dB)", _GAIN),
    ("seeds", "measured, seed by seed (dB)", ""),
)
_NETWORK = (
    ("noise", "noise", ""),
    ("codes", "codes", ""),
    ("expected", "expected (dB)", ".2f"),
    ("lmmse", "LMMSE (dB)", ".2f"),
    ("unrolled", "unrolled (dB)", ".2f"),
    ("gain", "unrolled over static designed (dB)", _GAIN),
    ("seeds", "seed by seed (dB)", ""),
    ("scenes", "scene by scene (dB)", ""),
)
_ABLATION = (("ingredient", "codes", ""),)
_RANK = (
    ("noise", "noise", ""),
    ("decoder", "decoder", ""),
    ("codes", "codes", "d"),
    ("rank_correlation", "rank correlation", ".2f"),
    ("rank_correlation_there", "expected, examples dimmed", ".2f"),
    ("mixture_rank_correlation", "by the mixture's expected error", ".2f"),
)
_CODES = (
    ("noise", "noise", ""),
    ("codes", "codes", ""),
    ("throughput", "light", ".1%"),
    ("expected", "expected (dB)", ".2f"),
    ("expected_there", "expected, examples dimmed (dB)", ".2f"),
    ("expected_mixture", "expected, mixture (dB)", ".2f"),
    ("lmmse", "LMMSE (dB)", ".2f"),
    ("unrolled", "unrolled (dB)", ".2f"),
)


def study_markdown(found: dict[str, Any]) -> str:
    """The study for people."""
    lines = [*_opening(found), "## At equal exposure time", "", markdown_table(grid_rows(found, 1), _GRID)]
    lines += ["## Per slot", "", "Every slot has the whole exposure time, K times the electrons before one "
              "readout; the static code is given the time of all K slots as well, and in one column that of one "
              "slot.", ""]  # fmt: skip
    for times in sorted({row["exposures"] for row in found["grid"]} - {1}):
        lines += [markdown_table(grid_rows(found, times), _PER_SLOT)]
    if found["test"]:
        lines += _on_test_scenes(found)
    if found["network"]:
        lines += ["## In trained networks", "", f"An unrolled network for each code, noise and seed, {found['steps']} "
                  "steps each; means over the middle of the test scenes.", ""]  # fmt: skip
        lines += [markdown_table(network_rows(found["network"]), _NETWORK)]
    lines += ["## What each ingredient contributes", "", f"Gain over the static design, K = {found['slots']} where not "
              "static: expected, and in brackets under the prior of the other scenes, dB.", ""]  # fmt: skip
    lines += [markdown_table(*_ablation(found["ablation"]))]
    if found["ranking"]:
        lines += ["## The order of codes", "", "Spearman's rank correlation of the expected PSNR with the mean PSNR on "
                  "the middle of the test scenes, and the codes themselves. Dimmed: the examples, to the mean "
                  "irradiance of the test scenes. The order is what is compared, not the level.", ""]  # fmt: skip
        lines += [markdown_table(found["rank_correlation"], _RANK), markdown_table(_ranked(found), _CODES)]
    return "\n".join(lines)


def _on_test_scenes(found: dict[str, Any]) -> list[str]:
    """What was foretold and what came, over all test scenes and scene by scene."""
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
    lines += [markdown_table(test_rows(found["test"], found["light"]), _TEST), "Scene by scene, means over seeds:", ""]
    return [*lines, markdown_table(scene_rows(found["test"], found["light"]), _SCENE)]


def _opening(found: dict[str, Any]) -> list[str]:
    split = found["split"]
    effort = ", ".join(f"{name} {value}" for name, value in found["effort"].items())
    note = f" {found['note']}" if "note" in found else ""  # of numbers that were measured later
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


def grid_rows(found: dict[str, Any], exposures: int) -> list[dict[str, Any]]:
    """Rows of the grid at one number of exposures, with the gain under the prior of the other scenes."""
    rows, single = [], {}
    for row in found["grid"]:
        if row["kind"] == "static" and row["exposures"] == 1:
            single[row["noise"]] = row["psnr"]
    for row in found["grid"]:
        if row["exposures"] == exposures:
            gains = list(row["held_out_gains"].values())
            own = {"held_out": float(np.mean(gains)), "spread": float(np.std(gains, ddof=1))}
            rows.append({**row, **own, "ahead": row["psnr"] - single[row["noise"]]})
    return rows


def test_rows(cells: Sequence[dict[str, Any]], lit: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over scenes and seeds of every kind of codes, with the gain over the designed static ones.

    Args:
        cells: of the test scenes.
        lit: what dimming the examples to them changes.
    """
    rows = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        own, there = ([cell for cell in part if cell["noise"] == noise] for part in (cells, lit))
        parts = [(own, STATIC, _PLAIN)]
        parts += [(part, STATIC + _FOR_LIGHT, prior) for part, prior in ((_plain(there), _PLAIN), (there, _DIMMED))]
        for part, static, prior in parts:
            for codes in part[0]["metrics"]:
                row = {"noise": noise, "codes": codes, "prior": prior, **_test_row(part, codes, static)}
                rows.append({**row, "there": float(np.mean([cell["there"][codes] for cell in there]))})
    return rows


def _plain(lit: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The same cells decoded by the prior as it was learned; what was foretold of the codes stays."""
    return [
        {**cell, "metrics": {name: {**own, **cell["plain_prior"][name]} for name, own in cell["metrics"].items()}}
        for cell in lit
    ]


def _test_row(cells: Sequence[dict[str, Any]], codes: str, static: str) -> dict[str, Any]:
    values, base = ([cell["metrics"][name] for cell in cells] for name in (codes, static))
    pairs = list(zip(values, base, strict=True))
    gains, ahead = ([v[key] - b[key] for v, b in pairs] for key in ("psnr", "expected_psnr"))
    return {
        "psnr": _mean(values, "psnr"), "gain": float(np.mean(gains)), "expected": float(np.mean(ahead)),
        "predicted": _mean(values, "predicted_gain"), "throughput": _mean(values, "throughput"),
        "seeds": _by([str(cell["seed"]) for cell in cells], gains),
    }  # fmt: skip


def scene_rows(cells: Sequence[dict[str, Any]], lit: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Foretold and measured gain of designed time-multiplexed codes, a row for each test scene."""
    found = []
    for scene in dict.fromkeys(cell["scene"] for cell in cells):
        own, there = ([cell for cell in part if cell["scene"] == scene] for part in (cells, lit))
        found += [{**row, "scene": scene, "miss": row["gain"] - _foretold(row)} for row in test_rows(own, there)]
    shown = [row for row in found if "designed" in row["codes"] and not row["codes"].startswith("static")]
    places = {noise: place for place, noise in enumerate(dict.fromkeys(cell["noise"] for cell in cells))}
    return sorted(shown, key=lambda row: (places[row["noise"]], row["codes"], row["prior"]))


def _foretold(row: dict[str, Any]) -> float:
    """What `--light` says of codes that were designed for the light; of all others, what dimmed examples say."""
    return float(row["predicted" if row["codes"].endswith(_FOR_LIGHT) else "there"])


def network_rows(cells: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over scenes and seeds of every code that networks were trained for."""
    rows = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        own = [cell for cell in cells if cell["noise"] == noise]
        base = {cell["seed"]: cell["unrolled"] for cell in own if cell["codes"] == STATIC}
        for codes in dict.fromkeys(cell["codes"] for cell in own):
            known = [cell for cell in own if cell["codes"] == codes]
            ahead = [(c["seed"], s, c["unrolled"][s] - base[c["seed"]][s]) for c in known for s in c["unrolled"]]
            gains = [gain for *_, gain in ahead]
            row = {"noise": noise, "codes": codes, "expected": _mean(known, "expected"), "gain": float(np.mean(gains))}
            row |= {d: float(np.mean([list(c[d].values()) for c in known])) for d in ("lmmse", "unrolled")}
            row["seeds"] = _by([str(seed) for seed, *_ in ahead], gains)
            rows.append(row | {"scenes": _by([scene for _, scene, _ in ahead], gains)})
    return rows


def _ablation(cells: Sequence[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[tuple[str, str, str]]]:
    """A row for each ingredient, a column for each noise."""
    rows: dict[str, dict[str, Any]] = {}
    for cell in cells:
        for row in cell["rows"]:
            said = f"{row['gain']:{_GAIN}} ({row['held_out']:{_GAIN}})"
            rows.setdefault(row["ingredient"], {"ingredient": row["ingredient"]})[cell["noise"]] = said
    return list(rows.values()), [*_ABLATION, *((cell["noise"], cell["noise"], "") for cell in cells)]


def _ranked(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Ranked codes with means over the test scenes, best expected first."""
    means = [
        {**row, **{d: float(np.mean(list(row[d].values()))) for d in ("lmmse", "unrolled") if d in row}}
        for row in found["ranking"]
    ]
    return sorted(means, key=lambda row: (row["noise"], -row["expected"]))


def _mean(cells: Sequence[dict[str, Any]], key: str) -> float:
    return float(np.mean([cell[key] for cell in cells]))


def _by(names: Sequence[str], values: Sequence[float]) -> str:
    """Mean of the values of every name."""
    means = {name: np.mean([v for n, v in zip(names, values, strict=True) if n == name]) for name in names}
    return ", ".join(f"{name} {value:{_GAIN}}" for name, value in means.items())
