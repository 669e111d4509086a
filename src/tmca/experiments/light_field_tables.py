"""The light-field table as JSON rows and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

import numpy as np

from tmca.experiments.cells import Measured
from tmca.experiments.light_field_rows import DECODER_NAMES, NOISES, STATIC_CODES
from tmca.experiments.results import markdown_table, mean_over_scenes, repository_commit

COLUMNS = (
    ("psnr", "PSNR (dB)", ".2f"),
    ("ssim", "SSIM", ".3f"),
    ("disparity_mae", "disparity MAE (px)", ".3f"),
    ("disparity_badpix", "BadPix 0.07", ".1%"),
    ("agreement_mae", "from that of the true views (px)", ".3f"),
)
_GEOMETRY = ("disparity_mae", "disparity_badpix")


def results(
    measured: Sequence[Measured], split: dict[str, Any], sizes: dict[str, Any], command: Sequence[str]
) -> dict[str, Any]:
    """Rows of the table from measured cells: means over scenes of the means over seeds.

    Args:
        split: names of the light fields, and how they were read.
        sizes: of views, frames, codes; ``effort`` of the searches.
        command: how the run was called.
    """
    cells = [cell for cell in measured if "metrics" in cell]
    trainings = [_training(cell) for cell in measured if "best" in cell]
    return {
        "command": " ".join(command), "commit": repository_commit(), "split": split,
        **sizes, "training": trainings,
        "searches": _searches([cell for cell in measured if "search" in cell and "gains" in cell]),
        "geometry": {cell["scene"]: cell["error"] for cell in measured if "error" in cell},
        "rows": _rows([cell for cell in cells if not cell["crop"]], trainings),
        "crop_rows": _rows([cell for cell in cells if cell["crop"]], trainings),
    }  # fmt: skip


def _training(cell: Measured) -> dict[str, Any]:
    kept = {name: cell[name] for name in ("code", "decoder", "seed")}
    steps = cell["training"]["optimiser"]["steps"]
    return {**kept, "steps": steps, "cpu_seconds": cell["seconds"], "validation_psnr": cell["best"]["psnr"]}


def _searches(cells: Sequence[Measured]) -> list[dict[str, Any]]:
    """Means over seeds."""
    found = []
    for code, noise in dict.fromkeys((cell["code"], cell["noise"]) for cell in cells):
        own = [cell for cell in cells if (cell["code"], cell["noise"]) == (code, noise)]
        row = {name: float(np.mean([c[name] for c in own])) for name in ("psnr", "random_psnr", "throughput")}
        gains = [float(np.mean(list(c["gains"].values()))) for c in own]
        found.append({"code": code, "noise": noise, **row, "held_out_gain": float(np.mean(gains))})
    return found


def _rows(cells: Sequence[Measured], trainings: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for every code, noise and decoder."""
    groups: dict[tuple[str, str, str], list[Measured]] = {}
    for cell in cells:
        groups.setdefault((cell["code"], cell["noise"], cell["decoder"]), []).append(cell)
    return [_row(key, own, trainings) for key, own in groups.items()]


def _row(key: tuple[str, str, str], cells: Sequence[Measured], trainings: Sequence[dict[str, Any]]) -> dict[str, Any]:
    code, noise, decoder = key
    seeds = sorted({cell["seed"] for cell in cells})
    runs = {
        name: [c["metrics"] for c in cells if c["scene"] == name] for name in dict.fromkeys(c["scene"] for c in cells)
    }
    scenes = {name: mean_over_scenes({str(i): m for i, m in enumerate(own)}) for name, own in runs.items()}
    spent = [t["cpu_seconds"] for t in trainings if (t["code"], t["decoder"]) == (code, decoder)]
    levels = [cell["metrics"]["psnr"] for seed in seeds for cell in cells if cell["seed"] == seed]
    return {
        "code": code, "noise": noise, "decoder": decoder, "scenes": scenes, **_mean(scenes),
        "seed_psnr": np.reshape(levels, (len(seeds), -1)).mean(1).tolist(),
        "throughput": float(np.mean([cell["throughput"] for cell in cells])),
        "seconds": {name: float(np.mean([c["seconds"] for c in cells if c["scene"] == name])) for name in scenes},
        "training_cpu_minutes": float(np.mean(spent)) / 60 if spent else 0.0,
    }  # fmt: skip


def _mean(scenes: dict[str, dict[str, float]]) -> dict[str, float]:
    """Mean of every metric over the scenes that have it."""
    names = dict.fromkeys(name for own in scenes.values() for name in own)
    return {name: float(np.mean([own[name] for own in scenes.values() if name in own])) for name in names}


def margins(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Per noise and decoder: the best time-multiplexed code against the best static one, in PSNR and geometry."""
    said = []
    for decoder, noise in _groups(found["rows"]):
        rows = [r for r in found["rows"] if (r["decoder"], r["noise"]) == (decoder, noise)]
        static, own = ([r for r in rows if (r["code"] in STATIC_CODES) == kind] for kind in (True, False))
        if not static or not own:
            continue
        base, best = (max(part, key=lambda row: row["psnr"]) for part in (static, own))
        row = {"decoder": DECODER_NAMES[decoder], "noise": noise, "static": base["code"], "best": best["code"]}
        row |= {"gain": best["psnr"] - base["psnr"], "each": _each(best, base)}
        for name in (*_GEOMETRY, "agreement_mae"):
            row |= {name: min(r[name] for r in own), f"static_{name}": min(r[name] for r in static)}
        said.append(row)
    return said


def _each(best: dict[str, Any], base: dict[str, Any]) -> str:
    return ", ".join(f"{n} {best['scenes'][n]['psnr'] - base['scenes'][n]['psnr']:+.2f}" for n in best["scenes"])


def steps_between(found: dict[str, Any]) -> list[dict[str, Any]]:
    """PSNR of decoders one over the other, code by code, on the whole scenes and on the crop; range over codes."""
    said = []
    for part, better, worse in (
        ("rows", "consistent", "lmmse"), ("rows", "consistent", "sub-network"), ("rows", "mixture", "lmmse"),
        ("crop_rows", "lmmse", "dictionary"), ("crop_rows", "mixture", "dictionary"),
        ("crop_rows", "consistent", "dictionary"),
    ):  # fmt: skip
        known = {(r["decoder"], r["noise"], r["code"]): r["psnr"] for r in found[part]}
        for noise in NOISES:
            gains = [known[key] - known[worse, noise, key[2]] for key in known
                     if key[:2] == (better, noise) and (worse, noise, key[2]) in known]  # fmt: skip
            if gains:
                row = {"better": DECODER_NAMES[better], "worse": DECODER_NAMES[worse], "noise": noise}
                where = "crop" if part == "crop_rows" else "whole scenes"
                said.append({**row, "where": where, "least": min(gains), "most": max(gains),
                             "mean": float(np.mean(gains))})  # fmt: skip
    return said


def _groups(rows: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row["decoder"], row["noise"]) for row in rows))


def markdown(found: dict[str, Any]) -> str:
    """The results for people."""
    split, effort, own = found["split"], found["effort"], {k: _times(found[k]) for k in ("frame", "rendered", "crop")}
    scaled = {"train": split["scale"], "test": split["test_scale"]}
    told = {name: f", {n}×{n} pixels averaged" if n and n > 1 else "" for name, n in scaled.items()}
    lines = [
        "# Light-field camera: static and time-multiplexed codes", "",
        f"Command: `{found['command']}` at commit `{found['commit']}`.", "",
        f"Prior, dictionary, codes and networks learned from {', '.join(split['train'])}{told['train']}"
        f" (networks also from rendered light fields). Measured on {', '.join(split['test'])}{told['test']}: the "
        f"middle {own['frame']} pixels of real ones, rendered ones at {own['rendered']}; "
        f"{found['views']}×{found['views']} views, grey, shear 1, codes of period {found['period']}, equal exposure "
        "time in all rows. Means over scenes of means over seeds.", "",
        "Disparity (px per view step) is what one fixed estimator sees in the reconstructed views; its error counts "
        "where the geometry is known (rendered scenes), and it is compared with what the same estimator sees in the "
        f"true views everywhere. On the true views it errs by {_own_error(found)}.", "",
        f"Optimised codes: searches on the expected error with {effort['descents']} descents of {effort['steps']} "
        f"steps and {effort['flips']} flips, static codes with the same effort; for σ = 0.05 and used under all "
        "noises, or for the noise of the table. A network is trained for each code, for all three noises together.", "",
    ]  # fmt: skip
    for noise in dict.fromkeys(row["noise"] for row in found["rows"]):
        lines += [f"## {noise}", "", _table(found["rows"], noise)]
    lines += ["## Time multiplexing against static codes", "", "The best code of each, decoder by decoder.", "",
              markdown_table(margins(found), _MARGINS)]  # fmt: skip
    lines += [f"## On a crop of {own['crop']}", "", "PSNR (dB), with the dictionary.", "", _crop_table(found)]
    lines += ["## Decoder against decoder", "", "PSNR of one over the other, over all codes.", "",
              markdown_table(steps_between(found), _STEPS)]  # fmt: skip
    lines += ["## What was expected of the codes", "", "Before anything is captured: PSNR under the prior of the "
              "training scenes, and gain over the static design when each of them is estimated under the prior of the "
              "others.", "", markdown_table(found["searches"], _SEARCHES)]  # fmt: skip
    return "\n".join(lines)


def _times(size: Sequence[int]) -> str:
    return "×".join(map(str, size))


def _own_error(found: dict[str, Any]) -> str:
    known = {scene: error for scene, error in found["geometry"].items() if error}
    return ", ".join(f"{e['disparity_mae']:.3f} ({scene})" for scene, e in known.items()) or "what is not known"


def _table(rows: Sequence[dict[str, Any]], noise: str) -> str:
    own = [row for row in rows if row["noise"] == noise]
    scenes = list(own[0]["scenes"])
    columns = [("code", "code", ""), ("name", "decoder", ""), *COLUMNS]
    columns += [(f"psnr {scene}", f"PSNR {scene}", ".2f") for scene in scenes]
    columns += [("throughput", "light", ".1%"), ("frame", f"seconds a frame ({scenes[0]})", ".1f")]
    columns += [("seeds", "PSNR seed by seed", ""), ("training_cpu_minutes", "training (CPU min)", ".1f")]
    shown = [
        {**row, "name": DECODER_NAMES[row["decoder"]], "frame": row["seconds"][scenes[0]],
         **{f"psnr {scene}": row["scenes"][scene]["psnr"] for scene in scenes},
         "seeds": ", ".join(f"{level:.2f}" for level in row["seed_psnr"])}
        for row in own
    ]  # fmt: skip
    return markdown_table([{k: _known(v) for k, v in row.items()} for row in shown], columns)


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and isnan(value) else value


def _crop_table(found: dict[str, Any]) -> str:
    """A row for every code and noise, a column for every decoder."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for row in found["crop_rows"]:
        own = rows.setdefault((row["noise"], row["code"]), {"noise": row["noise"], "code": row["code"]})
        own[row["decoder"]] = row["psnr"]
    decoders = dict.fromkeys(row["decoder"] for row in found["crop_rows"])
    columns = [("noise", "noise", ""), ("code", "code", "")]
    columns += [(name, DECODER_NAMES[name], ".2f") for name in DECODER_NAMES if name in decoders]
    order = sorted(rows, key=lambda key: list(NOISES).index(key[0]))
    return markdown_table([rows[key] for key in order], columns)


_MARGINS = (
    ("decoder", "decoder", ""), ("noise", "noise", ""), ("best", "time-multiplexed", ""), ("static", "static", ""),
    ("gain", "gain (dB)", "+.2f"), ("each", "scene by scene", ""),
    ("disparity_mae", "least disparity MAE (px)", ".3f"), ("static_disparity_mae", "static", ".3f"),
    ("disparity_badpix", "least BadPix", ".1%"), ("static_disparity_badpix", "static", ".1%"),
    ("agreement_mae", "least from the true views' (px)", ".3f"), ("static_agreement_mae", "static", ".3f"),
)  # fmt: skip
_STEPS = (
    ("better", "decoder", ""), ("worse", "over", ""), ("noise", "noise", ""), ("where", "on", ""),
    ("mean", "mean (dB)", "+.2f"), ("least", "least", "+.2f"), ("most", "most", "+.2f"),
)  # fmt: skip
_SEARCHES = (
    ("code", "codes", ""), ("noise", "noise", ""), ("psnr", "expected PSNR (dB)", ".2f"),
    ("random_psnr", "random codes (dB)", ".2f"), ("held_out_gain", "gain on scenes left out (dB)", "+.2f"),
    ("throughput", "light", ".1%"),
)  # fmt: skip
