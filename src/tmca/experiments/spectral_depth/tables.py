"""The spectral-depth table as JSON rows and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tmca.experiments.cells import Measured
from tmca.experiments.results import DEPTH_METRICS, markdown_table, mean_over_scenes, repository_commit
from tmca.experiments.spectral_depth.margin_tables import learning, margins, order
from tmca.experiments.spectral_depth.rows import CONSTANT, DECODER_NAMES, LEARNED, NOISES, STARTS, STEPS

COLUMNS = (
    *DEPTH_METRICS,
    ("psnr", "PSNR (dB)", ".2f"),
    ("sam", "SAM (°)", ".2f"),
    ("uiqi", "UIQI", ".3f"),
)
_THESIS = """Thesis, table 7 (other scenes, bench and training): diffractive element only 37.14 dB, SAM 8.75, UIQI .976,
depth MAE .377 m, RMSE .517 m; TMCA 37.92 dB, 8.15, .988, .258 m, .403 m."""


def results(
    measured: Sequence[Measured], split: dict[str, Any], sizes: dict[str, Any], command: Sequence[str]
) -> dict[str, Any]:
    """Rows of the table from measured cells: means over scenes of the means over seeds.

    Args:
        split: names of the scenes, and how they were read.
        sizes: of scenes, windows and patches; ``effort`` of the searches.
        command: how the run was called.
    """
    groups: dict[tuple[str, str, str], list[Measured]] = {}
    for cell in measured:
        if "metrics" in cell:
            groups.setdefault((cell["code"], cell["noise"], cell["decoder"]), []).append(cell)
    searches = [
        {name: cell[name] for name in ("code", "noise", "seed", "confusion", "seconds", "foretold")}
        for cell in measured if "foretold" in cell
    ]  # fmt: skip
    trainings = [
        {"code": cell["code"], "decoder": cell["decoder"], "seed": cell["seed"], "cpu_seconds": cell["seconds"],
         "validation": cell["best"]}
        for cell in measured if "best" in cell
    ]  # fmt: skip
    spent = _search_minutes(searches)
    rows = [_row(key, cells) | {"search_cpu_minutes": spent.get(key[0], 0.0)} for key, cells in groups.items()]
    return {
        "command": " ".join(command), "commit": repository_commit(), "split": split,
        "budget": {**sizes, "training": trainings}, "searches": searches, "rows": rows,
        "foretold": _foretold(measured, rows),
    }  # fmt: skip


def _search_minutes(searches: Sequence[dict[str, Any]]) -> dict[str, float]:
    """CPU minutes of the search for a code's masks, or for those that it started from, means over seeds."""
    seconds: dict[str, list[float]] = {}
    for search in searches:
        seconds.setdefault(search["code"], []).append(search["seconds"])
    known = {code: float(np.mean(own)) / 60 for code, own in seconds.items()}
    return known | {code: known[start] for code, start in LEARNED.items() if start in known}


def _foretold(measured: Sequence[Measured], rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """What is known of every code and noise before a test scene, means over seeds, beside what decoders made of it."""
    groups: dict[tuple[str, str], list[dict[str, float]]] = {}
    for cell in measured:
        if "figures" in cell:
            groups.setdefault((cell["code"], cell["noise"]), []).append(cell["figures"])
    made: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        own = {name: row[name] for name in ("depth_mae", "psnr") if name in row}
        made.setdefault((row["code"], row["noise"]), {})[row["decoder"]] = own
    return [
        {"code": key[0], "noise": key[1], **mean_over_scenes({str(i): own for i, own in enumerate(figures)}),
         "measured": made[key]}
        for key, figures in groups.items() if key in made
    ]  # fmt: skip


def _row(key: tuple[str, str, str], cells: Sequence[Measured]) -> dict[str, Any]:
    code, noise, decoder = key
    scenes = {
        name: mean_over_scenes({str(i): cell["metrics"][name] for i, cell in enumerate(cells)})
        for name in cells[0]["metrics"]
    }
    spent = [cell["training_seconds"] for cell in cells if "training_seconds" in cell]
    row = {
        "method": code if code == CONSTANT else f"{code} + {DECODER_NAMES[decoder]}", "exposure": "equal",
        "code": code, "noise": noise, "decoder": decoder, "scenes": scenes, **mean_over_scenes(scenes),
        "seed_depth_mae": [float(np.mean([m["depth_mae"] for m in cell["metrics"].values()])) for cell in cells],
        "training_cpu_minutes": float(np.mean(spent)) / 60 if spent else 0.0,
    }  # fmt: skip
    for name in ("throughput", "arrived", "seconds"):
        known = [cell[name] for cell in cells if name in cell]
        if known:
            levels = [float(np.mean(list(k.values()))) if isinstance(k, dict) else float(k) for k in known]
            row[name] = float(np.mean(levels))
    return row


def markdown(found: dict[str, Any]) -> str:
    """The page of the results."""
    split, budget = found["split"], found["budget"]
    crop = "×".join(map(str, budget["crop"]))
    lines = [
        "# The spectral-depth camera, measured\n",
        f"Command: `{found['command']}` at commit `{found['commit']}`.\n",
        f"Learned from {', '.join(split['train'])}; measured on the middle {crop} pixels of "
        f"{', '.join(split['test'])}, averaged down to a shorter side of {split['side']} pixels or more. Inverse depth "
        "of scenes from files is mapped affinely onto the range of the design; cubes without depth are put at drawn "
        "depths, RGB-D scenes get made-up spectra of measured reflectances, test scenes of others than training "
        "scenes.\n",
        _known(found),
        f"Optimised masks: {budget['effort']['starts']} descents of {budget['effort']['steps']} steps on the foretold "
        f"confusion of depths under {next(iter(NOISES))}, best of them and of random masks on training scenes at drawn "
        "depths; "
        f"static masks have {max(STARTS.values())} times the descents, which takes as long as a search for four slots. "
        "Noise is in units of one band of a white scene; all "
        "exposures last equally long. Images are those of the linear model (thesis eqs 30–36), point spread functions "
        "have unit energy within their window; the share of a point's light that really arrives there is told.\n",
        *_training(found),
    ]
    for noise in NOISES:
        lines += [f"## {noise}\n", _table(found, noise)]
    lines += _margins(found)
    lines += _order(found) if found["foretold"] else []
    return "\n".join([*lines, _THESIS, ""])


def _training(found: dict[str, Any]) -> list[str]:
    """What networks learned from, and for how long."""
    rendered, budget = found["split"].get("rendered"), found["budget"]
    if rendered is None:
        return []
    withheld = found["split"].get("withheld")
    kept = "" if withheld is None else f" and {withheld}, which no network learned from,"
    return [
        f"Networks learned from these scenes and rendered ones ({', '.join(rendered['train'])}), {budget['steps']} "
        f"steps each; {', '.join(rendered['validation'])} (rendered){kept} chose the best step. A step costs more "
        "where there are more slots and filters: CPU minutes of search and training are told. Masks alone learn for "
        f"{max(STEPS.values())} times the steps, which takes as long as four masks. Learned codes start from "
        "the searched ones of their kind and stay in their family; they learn from the two-headed network's loss and "
        "from the error of inverse depth that the patch likelihood is to expect. Other networks are trained behind "
        "codes that were so learned.\n"
    ]


def _order(found: dict[str, Any]) -> list[str]:
    """What was foretold of the codes, and whether in the right order."""
    figures = (
        ("placed", "error on training scenes at drawn depths (bins)", ".2f"),
        ("flat", "on flat ones (bins)", ".2f"),
        ("confusion", "foretold confusion (bins)", ".3f"), ("fisher", "Fisher information (m²)", ".0f"),
        ("kullback_leibler", "nats from the nearest rival", ".1f"), ("psnr", "foretold PSNR (dB)", ".2f"),
    )  # fmt: skip
    told = [("noise", "noise", ""), ("code", "code", ""), *figures]
    told += [("measured_depth_mae", "measured depth MAE (m)", ".3f"), ("measured_psnr", "measured PSNR (dB)", ".2f")]
    ranked = [("noise", "noise", ""), ("decoder", "decoder", ""), ("codes", "codes", "d")]
    ranked += [(name, label, "+.2f") for name, label, _ in figures]
    shown = [
        {**row, **{f"measured_{name}": value for name, value in row["measured"].get("likelihood", {}).items()}}
        for row in found["foretold"]
    ]
    return [
        "## What is foretold without a test scene\n",
        "The patch likelihood's error on some training scenes at drawn depths, with edges, and standing at every plane "
        "in turn; and under the prior "
        f"alone, of windows of {found['budget']['searched']} pixels, means over planes (of Fisher information the "
        "geometric one); beside what the patch likelihood made of the test scenes.\n",
        markdown_table(shown, told),
        "Rank correlation of each with the measured depth MAE, of PSNR with the measured one; 1: the right order.\n",
        markdown_table(order(found), ranked),
    ]


def _table(found: dict[str, Any], noise: str) -> str:
    rows = [row for row in found["rows"] if row["noise"] in (noise, "")]
    shown = [{**row, "decoder": DECODER_NAMES.get(row["decoder"], "")} for row in rows]
    scenes = found["split"]["test"]
    for row in shown:
        row |= {f"depth_{name}": row["scenes"][name]["depth_mae"] for name in scenes}
        row["spread"] = ", ".join(f"{value:.3f}" for value in row["seed_depth_mae"])
        row["minutes"], row["search"] = row["training_cpu_minutes"] or None, row["search_cpu_minutes"] or None
    columns = [("code", "code", ""), ("decoder", "decoder", ""), *COLUMNS]
    columns += [(f"depth_{name}", f"depth MAE {name}", ".3f") for name in scenes]
    columns += [
        ("spread", "depth MAE, seed by seed", ""),
        ("throughput", "light", ".2f"),
        ("arrived", "in the window", ".1%"),
    ]
    columns += [("seconds", "seconds a scene", ".1f"), ("search", "search (CPU min)", ".1f")]
    return markdown_table(shown, [*columns, ("minutes", "training (CPU min)", ".1f")])


def _margins(found: dict[str, Any]) -> list[str]:
    columns = (
        ("decoder", "decoder", ""), ("noise", "noise", ""), ("best", "time-multiplexed", ""), ("static", "static", ""),
        ("ratio", "ratio of depth MAE", ".2f"), ("ratios", "seed by seed", ""),
        ("alone", "depth MAE against the mask alone", "+.0%"),
        ("psnr", "PSNR against it (dB)", "+.2f"), ("sam", "SAM against it (°)", "+.2f"),
        ("ratio_in_hindsight", "ratio in hindsight", ".2f"),
        ("alone_in_hindsight", "against the mask alone in hindsight", "+.0%"),
    )  # fmt: skip
    return [
        "## Time-multiplexed against static\n",
        "Codes of least error without a test scene: on training scenes at drawn depths (patch likelihood), or in "
        "validation (networks). In hindsight: the least depth errors on the test scenes on either side.\n",
        markdown_table(margins(found), columns),
        *_learning(found),
    ]


def _learning(found: dict[str, Any]) -> list[str]:
    columns = (
        ("decoder", "decoder", ""), ("noise", "noise", ""), ("code", "code", ""), ("depth_mae", "depth MAE (m)", ".3f"),
        ("start", "of its start (m)", ".3f"), ("start_psnr", "PSNR above its start (dB)", "+.2f"),
        ("static", "of its static special case, learned (m)", ".3f"), ("static_psnr", "PSNR above it (dB)", "+.2f"),
    )  # fmt: skip
    rows = learning(found)
    return ["## What learning codes adds\n", markdown_table(rows, columns)] if rows else []


def _known(found: dict[str, Any]) -> str:
    """Of which share of the test scenes' pixels the depth is known."""
    (row,) = [row for row in found["rows"] if row["code"] == CONSTANT][:1] or [{"scenes": {}}]
    shares = [f"{name} {own['known_depth']:.0%}" for name, own in row["scenes"].items()]
    return f"Depth is known, and counts, in these shares of the pixels: {', '.join(shares)}.\n"
