"""The light-field table as JSON rows and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import isnan
from typing import Any

import numpy as np

from tmca.experiments.cells import Measured
from tmca.experiments.light_field.pages import left_out, pictures, thesis_table
from tmca.experiments.light_field.rows import DECODER_NAMES, LEARNED, NOISES, STATIC_CODES
from tmca.experiments.results import markdown_table, mean_over_scenes, repository_commit

FROM_FILES = "from files"
COLUMNS = (
    ("psnr", "PSNR (dB)", ".2f"),
    ("ssim", "SSIM", ".3f"),
    ("disparity_mae", "disparity MAE (px)", ".3f"),
    ("disparity_badpix", "BadPix 0.07", ".1%"),
    ("agreement_mae", "from that of the true views (px)", ".3f"),
)


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
        "budget": {**sizes, "training": trainings,
                   "decoding_seconds": float(sum(cell["seconds"] for cell in cells))},
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
        row = {
            name: float(np.mean([c[name] for c in own])) for name in ("psnr", "random_psnr", "throughput", "seconds")
        }
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
        "method": f"{code} + {DECODER_NAMES[decoder]}", "exposure": "equal",
        "code": code, "noise": noise, "decoder": decoder, "scenes": scenes, **_mean(scenes), "views": _views(cells),
        "seed_psnr": np.reshape(levels, (len(seeds), -1)).mean(1).tolist(),
        "throughput": float(np.mean([cell["throughput"] for cell in cells])),
        "seconds": {name: float(np.mean([c["seconds"] for c in cells if c["scene"] == name])) for name in scenes},
        "training_cpu_minutes": float(np.mean(spent)) / 60 if spent else 0.0,
    }  # fmt: skip


def _views(cells: Sequence[Measured]) -> dict[str, dict[str, list[list[float]]]]:
    """PSNR and SSIM of every view (V, U), scene by scene, means over seeds."""
    found: dict[str, dict[str, list[list[float]]]] = {}
    for cell, name in product(cells, ("psnr", "ssim")):
        if f"{name}_per_view" in cell:
            own = [c[f"{name}_per_view"] for c in cells if c["scene"] == cell["scene"]]
            found.setdefault(cell["scene"], {})[name] = np.mean(own, 0).tolist()
    return found


def _mean(scenes: dict[str, dict[str, float]]) -> dict[str, float]:
    """Mean of every metric over the scenes that have it."""
    names = dict.fromkeys(name for own in scenes.values() for name in own)
    return {name: float(np.mean([own[name] for own in scenes.values() if name in own])) for name in names}


def margins(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Time-multiplexed against static codes, noise by noise and decoder by decoder, on scenes from files and on
    rendered ones: the optimised ones of each, and the best ones of each in hindsight."""
    said = []
    for (decoder, noise), (part, scenes) in product(_groups(found["rows"]), _parts(found).items()):
        rows = [r for r in found["rows"] if (r["decoder"], r["noise"]) == (decoder, noise)]
        static, own = ([r for r in rows if (r["code"] in STATIC_CODES) == kind] for kind in (True, False))
        if not (static and own and scenes):
            continue
        base, best = (max(group, key=lambda row: _level(row, scenes)) for group in (static, own))
        row = {"decoder": DECODER_NAMES[decoder], "noise": noise, "part": part, "static": base["code"]}
        row |= {"best": best["code"], "gain": _level(best, scenes) - _level(base, scenes)}
        row |= {"designed": _designed(rows, scenes)}
        row |= {"each": ", ".join(f"{n} {_level(best, [n]) - _level(base, [n]):+.2f}" for n in scenes)}
        for name in ("disparity_mae", "disparity_badpix", "agreement_mae"):
            row |= {name: _least(own, scenes, name), f"static_{name}": _least(static, scenes, name)}
        said.append(row)
    return said


def _parts(found: dict[str, Any]) -> dict[str, list[str]]:
    """Scenes from files and rendered ones."""
    real, names = found["split"]["real"], found["split"]["test"]
    return {FROM_FILES: list(real), "rendered": [name for name in names if name not in real]}


def _level(row: dict[str, Any], scenes: Sequence[str], name: str = "psnr") -> float:
    """Mean of a metric over the scenes that have it."""
    known = [row["scenes"][scene][name] for scene in scenes if name in row["scenes"].get(scene, ())]
    return float(np.mean(known)) if known else float("nan")


def _least(rows: Sequence[dict[str, Any]], scenes: Sequence[str], name: str) -> float | None:
    levels = [level for level in (_level(row, scenes, name) for row in rows) if not isnan(level)]
    return min(levels, default=None)


def _designed(rows: Sequence[dict[str, Any]], scenes: Sequence[str]) -> float | None:
    """Optimised time-multiplexed over optimised static codes, of the noise at hand where there are any."""
    known = {row["code"]: _level(row, scenes) for row in rows}
    for ending in (" for this noise", ""):
        static, own = (f"{name}{ending}" for name in ("CLFP optimised", "TMCA optimised K = 8"))
        if static in known and own in known:
            return known[own] - known[static]
    return None


def steps_between(found: dict[str, Any]) -> list[dict[str, Any]]:
    """PSNR of decoders one over the other, code by code, on scenes from files, on rendered ones and on the crop."""
    said = []
    for rows, better, worse in (
        ("rows", "consistent", "lmmse"), ("rows", "consistent", "sub-network"), ("rows", "mixture", "lmmse"),
        ("crop_rows", "lmmse", "dictionary"), ("crop_rows", "mixture", "dictionary"),
        ("crop_rows", "consistent", "dictionary"),
    ):  # fmt: skip
        for (part, scenes), noise in product(_parts(found).items(), NOISES):
            known = {(r["decoder"], r["code"]): _level(r, scenes) for r in found[rows] if r["noise"] == noise}
            gains = [known[better, code] - known[worse, code] for name, code in known
                     if name == better and (worse, code) in known]  # fmt: skip
            gains = [gain for gain in gains if not isnan(gain)]
            if gains:
                where = "crop" if rows == "crop_rows" else part
                said.append({"better": DECODER_NAMES[better], "worse": DECODER_NAMES[worse], "noise": noise,
                             "where": where, "least": min(gains), "most": max(gains),
                             "mean": float(np.mean(gains))})  # fmt: skip
    return said


def _groups(rows: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row["decoder"], row["noise"]) for row in rows))


def markdown(found: dict[str, Any]) -> str:
    """The results for people."""
    split, budget = found["split"], found["budget"]
    effort, own = budget["effort"], {name: _times(budget[name]) for name in ("frame", "rendered", "crop")}
    scaled = {"train": split["scale"], "test": split["test_scale"]}
    told = {name: f", {n}×{n} pixels averaged" if n and n > 1 else "" for name, n in scaled.items()}
    lines = [
        "# Light-field camera: static and time-multiplexed codes", "",
        f"Command: `{found['command']}` at commit `{found['commit']}`.", "",
        f"Prior, dictionary, codes and networks learned from {', '.join(split['train'])}{told['train']}"
        f" (networks also from rendered light fields). Measured on {', '.join(split['test'])}{told['test']}: the "
        f"middle {own['frame']} pixels of those from files, rendered ones at {own['rendered']}; "
        f"{budget['views']}×{budget['views']} views, grey, shear 1, codes of period {budget['period']}, equal exposure "
        "time in all rows. Means over scenes of means over seeds.", "",
        "Disparity (px per view step) is what one fixed estimator sees in the reconstructed views; its error counts "
        "where the geometry is known (rendered scenes), and it is compared with what the same estimator sees in the "
        f"true views everywhere. On the true views it errs by {_own_error(found)}.", "",
        f"Optimised codes: searches on the expected error, each of {effort['descents']} descents of {effort['steps']} "
        f"steps and {effort['flips']} flips; for σ = 0.05 and used under all noises, or for the noise of the table. "
        "The time-multiplexed design starts from designs of fewer slots and one-hot designs, seven searches in all "
        "with the static one; the static design has seven times the descents instead. CPU seconds of either, with all "
        "that it starts from, are told below. A network is trained for each code, for all three noises together; "
        f"{_learned(found)}.", "", *left_out(found),
    ]  # fmt: skip
    for noise in dict.fromkeys(row["noise"] for row in found["rows"]):
        lines += [f"## {noise}", "", _table(found["rows"], noise)]
    lines += thesis_table(found, _parts(found)[FROM_FILES])
    lines += ["## Time multiplexing against static codes", "", "Decoder by decoder, on scenes from files and on "
              "rendered ones: optimised codes against each other, and the best codes of either kind, known in "
              "hindsight only.", "",
              markdown_table(margins(found), _MARGINS)]  # fmt: skip
    lines += [f"## On a crop of {own['crop']}", "", "PSNR (dB), with the dictionary.", "", _crop_table(found)]
    lines += ["## Decoder against decoder", "", "PSNR of one over the other, over all codes: mean, least and most.", "",
              markdown_table(steps_between(found), _STEPS)]  # fmt: skip
    lines += ["## What was expected of the codes", "", "Before anything is captured: PSNR under the prior of the "
              "training scenes, and gain over the static design when each of them is estimated under the prior of the "
              "others.", "", markdown_table(found["searches"], _SEARCHES)]  # fmt: skip
    return "\n".join([*lines, *pictures(found)])


def _learned(found: dict[str, Any]) -> str:
    """How codes were learned, where any were."""
    if not any(row["code"] in LEARNED for row in found["rows"]):
        return "codes are not learned with it"
    return "E2E codes start at the optimised ones and learn with it, in no more minutes"


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
    ("decoder", "decoder", ""), ("noise", "noise", ""), ("part", "scenes", ""), ("designed", "optimised (dB)", "+.2f"),
    ("best", "best time-multiplexed", ""), ("static", "best static", ""), ("gain", "best over best (dB)", "+.2f"),
    ("each", "scene by scene", ""),
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
    ("throughput", "light", ".1%"), ("seconds", "search (CPU s)", ".0f"),
)  # fmt: skip
