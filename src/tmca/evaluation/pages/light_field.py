"""The page of `tmca compare light-field`: quality and geometry, searches, the thesis' table 1."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data import read_dataset
from tmca.data.light_field_scenes import read_middle
from tmca.data.scene_names import short_names
from tmca.evaluation.grid import Measured
from tmca.evaluation.light_field import asked_of_files
from tmca.evaluation.pages.view_margins import (
    DICTIONARY,
    FROM_FILES,
    is_static,
    labels,
    margins,
    parts,
    shipped,
    steps_between,
    thesis_table,
)
from tmca.evaluation.scenes import read_once
from tmca.evaluation.study import Study
from tmca.evaluation.tables import Row, Split, grouped, markdown_table, mean, repository_commit, rows_of, training_rows
from tmca.plots.light_field import centre_view, disparity_figure, light_field_figure, view_psnr_figure
from tmca.plots.style import save_figure
from tmca.plots.views import brightest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = (
    ("psnr", "PSNR (dB)", ".2f"),
    ("ssim", "SSIM", ".3f"),
    ("disparity_mae", "disparity MAE (px)", ".3f"),
    ("disparity_badpix", "BadPix 0.07", ".1%"),
    ("agreement_mae", "from that of the true views (px)", ".3f"),
)
_CAPTIONS = {
    "views": "Views and epipolar pictures, with errors",
    "psnr": "PSNR of every view",
    "disparity": "Disparity that one estimator sees in the reconstructed views",
}


def results(study: Study, measured: Sequence[Measured], split: Split, command: Sequence[str]) -> Row:
    """What the JSON file holds: rows of whole scenes and of crops, searches, geometry."""
    cells, names, reading = [cell for cell in measured if "metrics" in cell], split["names"], study.reading
    trainings = [
        {**{key: value for key, value in one.items() if key != "best"}, "validation_psnr": one["best"]["psnr"]}
        for one in training_rows(study, measured)
    ]  # fmt: skip
    asked = {name: reading[name] for name in ("scale", "pattern", "lens", "test_scale")}
    sizes = {"views": reading["views"], "period": study.settings["period"][0],
             **{name: reading[name] for name in ("frame", "rendered", "crop")},
             "patch": study.train.settings["data"]["patch"]}  # fmt: skip
    return {
        "command": " ".join(command), "commit": repository_commit(),
        "split": {"train": [*short_names(split["train"]).values()], "test": [*names.values()],
                  "real": [names[name] for name in split["test"]], **asked, "atoms": study.priors[DICTIONARY]["atoms"]},
        "budget": {**sizes, "effort": study.search["effort"], "steps": study.train.steps, "training": trainings,
                   "decoding_seconds": float(sum(cell["seconds"] for cell in cells))},
        "searches": _searches([cell for cell in measured if "gains" in cell]),
        "geometry": {cell["scene"]: cell["error"] for cell in measured if "error" in cell},
        "rows": _rows(study, measured, crop=False), "crop_rows": _rows(study, measured, crop=True),
    }  # fmt: skip


def _searches(cells: Sequence[Measured]) -> list[Row]:
    """Means over seeds."""
    return [
        {"code": code, "noise": noise,
         **{name: mean([cell[name] for cell in own]) for name in ("psnr", "random_psnr", "throughput", "seconds")},
         "held_out_gain": mean([mean([*cell["gains"].values()]) for cell in own])}
        for (code, noise), own in grouped(cells, "code", "noise").items()
    ]  # fmt: skip


def _rows(study: Study, measured: Sequence[Measured], crop: bool) -> list[Row]:
    """Rows of crops or of whole scenes, with the seconds of every scene and the quality of every view."""
    part = [cell for cell in measured if "metrics" not in cell or (cell["reading"]["crop"] is not None) == crop]
    groups = grouped([cell for cell in part if "metrics" in cell], "code", "noise", "decoder")
    found = []
    for row in rows_of(study, part):
        scenes = grouped(groups[row["code"], row["noise"], row["decoder"]], "scene").items()
        seconds = {name: mean([cell["seconds"] for cell in own]) for (name,), own in scenes}
        views = {name: _views(own) for (name,), own in scenes if "psnr_per_view" in own[0]}
        found.append({**row, "seconds": seconds, "views": views})
    return found


def _views(cells: Sequence[Measured]) -> dict[str, list[list[float]]]:
    """PSNR and SSIM of every view (V, U), means over seeds."""
    return {name: np.mean([cell[f"{name}_per_view"] for cell in cells], 0).tolist() for name in ("psnr", "ssim")}


def markdown(found: Row, study: Study | None = None) -> str:
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
    lines += thesis_table(found, parts(found)[FROM_FILES])
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
    return "\n".join([*lines, *pictured(found)])


def _learned(found: Row) -> str:
    """How codes were learned, where any were."""
    if not any(row["code"].endswith("E2E") or " E2E " in row["code"] for row in found["rows"]):
        return "codes are not learned with it"
    return "E2E codes start at the optimised ones and learn with it, in no more minutes"


def _times(size: Sequence[int]) -> str:
    return "×".join(map(str, size))


def _own_error(found: Row) -> str:
    known = {scene: error for scene, error in found["geometry"].items() if error}
    return ", ".join(f"{e['disparity_mae']:.3f} ({scene})" for scene, e in known.items()) or "what is not known"


def _table(rows: Sequence[Row], noise: str) -> str:
    own = [row for row in rows if row["noise"] == noise]
    scenes = list(own[0]["scenes"])
    columns = [("code", "code", ""), ("name", "decoder", ""), *COLUMNS]
    columns += [(f"psnr {scene}", f"PSNR {scene}", ".2f") for scene in scenes]
    columns += [("throughput", "light", ".1%"), ("frame", f"seconds a frame ({scenes[0]})", ".1f")]
    columns += [("seeds", "PSNR seed by seed", ""), ("training_cpu_minutes", "training (CPU min)", ".1f")]
    shown = [
        {**row, "name": labels()[row["decoder"]], "frame": row["seconds"][scenes[0]],
         **{f"psnr {scene}": row["scenes"][scene]["psnr"] for scene in scenes},
         "seeds": ", ".join(f"{level:.2f}" for level in row["seed_psnr"])}
        for row in own
    ]  # fmt: skip
    return markdown_table([{k: _known(v) for k, v in row.items()} for row in shown], columns)


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and isnan(value) else value


def _crop_table(found: Row) -> str:
    """A row for every code and noise, a column for every decoder."""
    rows: dict[tuple[str, str], Row] = {}
    for row in found["crop_rows"]:
        own = rows.setdefault((row["noise"], row["code"]), {"noise": row["noise"], "code": row["code"]})
        own[row["decoder"]] = row["psnr"]
    decoders = dict.fromkeys(row["decoder"] for row in found["crop_rows"])
    columns = [("noise", "noise", ""), ("code", "code", "")]
    columns += [(name, label, ".2f") for name, label in labels().items() if name in decoders]
    noises = list(dict.fromkeys(row["noise"] for row in found["rows"]))
    order = sorted(rows, key=lambda key: noises.index(key[0]))
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


def left_out(found: Row) -> list[str]:
    """A line that names decoders without rows."""
    measured = {row["decoder"] for row in (*found["rows"], *found["crop_rows"])}
    missing = [
        f"{words} (`{name}`)" for name, words in labels().items() if name in shipped().decoders and name not in measured
    ]
    return [f"Left out of this run (`--decoders`): {', '.join(missing)}.", ""] if missing else []


def pictured(found: Row) -> list[str]:
    """The pictures that lie beside the page, scene by scene."""
    study = shipped()
    rows = {(row["code"], row["decoder"]) for row in found["rows"] if row["noise"] == study.shown_noise}
    if rows.isdisjoint(study.shown or ()):
        return []
    lines = ["## Pictures", "", f"Some rows, {study.shown_noise}, first seed.", ""]
    for scene in found["split"]["test"]:
        for caption, file in zip(_CAPTIONS.values(), picture_files(study, [scene], Path()), strict=True):
            lines += [f"{caption} ({scene}):", "", f"![{caption}, {scene}]({file.name})", ""]
    return lines


def slug(scene: str) -> str:
    """A scene's name as part of a file's."""
    return scene.strip("./").replace("/", "-").replace(":", "-")


def picture_files(study: Study, scenes: Sequence[str], out: Path) -> list[Path]:
    """Views, quality per view and disparity of every scene."""
    return [out / f"{study.name}_{slug(scene)}_{kind}.png" for scene in scenes for kind in _CAPTIONS]


def in_pairs(rows: Collection[tuple[str, str]]) -> list[tuple[str, str]]:
    """Codes and decoders that are pictured, static ones before their time-multiplexed partners; one without partner is
    left out, unless all are."""
    shown = shipped().shown or ()
    static = [row for row in shown if is_static(row[0])]
    partners = [row for row in shown if not is_static(row[0])]
    pairs = [pair for pair in zip(static, partners, strict=True) if set(pair) <= set(rows)]
    return [row for pair in pairs for row in pair] or [row for row in shown if row in rows]


def pictures(study: Study, measured: Sequence[Measured], out: Path, overwrite: bool) -> list[Path]:
    """Write the pictures of every scene with estimates of its rows."""
    files = []
    for (scene,), own in grouped([cell for cell in measured if cell.get("estimate")], "scene").items():
        cells = {(cell["code"], cell["decoder"]): cell for cell in own}
        drawn = _figures({f"{code}\n{labels()[decoder]}": cells[code, decoder] for code, decoder in in_pairs(cells)})
        for figure, file in zip(drawn, picture_files(study, [scene], out), strict=True):
            files.append(save_figure(figure, file, overwrite=overwrite, dpi=80))
    return files


def _figures(cells: dict[str, Measured]) -> list[Figure]:
    """Views, quality per view and disparity of the rows of one scene."""
    from tmca.metrics import estimate_disparity

    first = next(iter(cells.values()))
    reading = first["reading"]
    truth = read_once(read_middle, first["source"], reading["views"], asked_of_files(reading), reading["size"]).values
    estimates = {name: read_dataset(cell["estimate"], ("estimate",))["estimate"].values for name, cell in cells.items()}
    known = dict(np.load(first["about"]["disparity"]))
    seen = {name: estimate_disparity(estimate) for name, estimate in estimates.items()}
    view = centre_view(truth, brightest(truth))
    return [
        light_field_figure(estimates, truth),
        view_psnr_figure({name: np.asarray(cell["psnr_per_view"]) for name, cell in cells.items()}),
        disparity_figure({"estimator on true views": known["seen"], **seen}, known.get("truth"), view=view),
    ]
