"""The page of `tmca compare spectral-depth`: depth and spectrum, margins, what is predicted before a test scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tmca.applications.spectral_depth import DEPTH_METRICS
from tmca.cameras import SpectralDepthCamera
from tmca.data import read_dataset, split_rendered
from tmca.data.fitting import middle_of
from tmca.data.scene_names import short_names
from tmca.evaluation.grid import Measured
from tmca.evaluation.pages.depth_margins import labels, learning, margins, order
from tmca.evaluation.pages.depth_margins import study as shipped
from tmca.evaluation.spectral_depth import CONSTANT, SpectralDepthEvaluation
from tmca.evaluation.study import Study
from tmca.evaluation.tables import (
    Row,
    Split,
    grouped,
    markdown_table,
    mean,
    mean_over_scenes,
    repository_commit,
    rows_of,
    training_rows,
)
from tmca.plots.depth import Pair, predicted_depth_figure, rows_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = (
    *DEPTH_METRICS,
    ("psnr", "PSNR (dB)", ".2f"),
    ("sam", "SAM (°)", ".2f"),
    ("uiqi", "UIQI", ".3f"),
)
_THESIS = """Thesis, table 7 (other scenes, bench and training): diffractive element only 37.14 dB, SAM 8.75, UIQI .976,
depth MAE .377 m, RMSE .517 m; TMCA 37.92 dB, 8.15, .988, .258 m, .403 m."""


def results(study: Study, measured: Sequence[Measured], split: Split, command: Sequence[str]) -> Row:
    """What the JSON file holds: rows, searches, and what is predicted of codes (``foretold``)."""
    searches = [
        {name: cell[name] for name in ("code", "noise", "seed", "confusion", "seconds", "foretold")}
        for cell in measured if "confusion" in cell
    ]  # fmt: skip
    trainings = [
        {**{name: one[name] for name in ("code", "decoder", "seed", "cpu_seconds")}, "validation": one["best"]}
        for one in training_rows(study, measured)
    ]  # fmt: skip
    spent = _search_minutes(study, searches)
    rows = [
        {**{name: value for name, value in row.items() if value is not None},
         "search_cpu_minutes": spent.get(row["code"], 0.0)}
        for row in (*_guesses(measured), *_rows(study, measured))
    ]  # fmt: skip
    reading, search = study.reading, study.search
    sizes = {**{name: reading[name] for name in ("preset", "side", "crop")},
             "window": study.options["likelihood"]["window"], "patch": study.train.settings["data"]["patch"],
             "searched": search["searched"], "effort": search["effort"], "steps": study.train.steps}  # fmt: skip
    return {
        "command": " ".join(command), "commit": repository_commit(), "split": _split(study, split),
        "budget": {**sizes, "training": trainings}, "searches": searches, "rows": rows,
        "foretold": _predicted(measured, rows),
    }  # fmt: skip


def _split(study: Study, split: Split) -> Row:
    """Names of the scenes and how they were read; which networks have beside, and which is withheld from them."""
    names, how = short_names(split["train"]), ("side", "placed", "from_rgb")
    found: Row = {"train": [*names.values()], "test": [*split["names"].values()]}
    found |= {name: study.reading[name] for name in how}
    if not {*study.decoders} & {*study.networks}:
        return found
    own = study.evaluation.training_scenes(
        study.reading, split["train"], split["validation"], split["test"], study.train
    )
    rendered = {*split_rendered()["train"]} if study.train.rendered else set()
    found["rendered"] = {part: [name for name in own[part] if name in rendered] for part in ("train", "validation")}
    withheld = [name for name in own["validation"] if name in names]
    return found | ({"withheld": names[withheld[0]]} if withheld else {})


def _guesses(measured: Sequence[Measured]) -> list[Row]:
    """The row of the constant guess."""
    return [
        {"method": CONSTANT, "exposure": "equal", "code": CONSTANT, "noise": "", "decoder": CONSTANT,
         "scenes": cell["guess"], **mean_over_scenes(cell["guess"]),
         "seed_depth_mae": [mean([own["depth_mae"] for own in cell["guess"].values()])], "training_cpu_minutes": 0.0}
        for cell in measured if "guess" in cell
    ]  # fmt: skip


def _rows(study: Study, measured: Sequence[Measured]) -> list[Row]:
    """Rows with the light that arrives within the windows of point spread functions."""
    groups = grouped([cell for cell in measured if "metrics" in cell], "code", "noise", "decoder")
    return [
        {**row, "arrived": mean([cell["arrived"] for cell in groups[row["code"], row["noise"], row["decoder"]]])}
        for row in rows_of(study, measured, metric="depth_mae")
    ]


def _search_minutes(study: Study, searches: Sequence[Row]) -> dict[str, float]:
    """CPU minutes of the search for a code's masks, or for those that it started from, means over seeds."""
    known = {code: mean([one["seconds"] for one in own]) / 60 for (code,), own in grouped(searches, "code").items()}
    starts = {name: code.learn.start for name, code in study.codes.items() if code.learn}
    return known | {code: known[start] for code, start in starts.items() if start in known}


def _predicted(measured: Sequence[Measured], rows: Sequence[Row]) -> list[Row]:
    """What is known of every code and noise before a test scene, means over seeds, beside what decoders made of it."""
    made: dict[tuple[str, str], Row] = {}
    for row in rows:
        own = {name: row[name] for name in ("depth_mae", "psnr") if name in row}
        made.setdefault((row["code"], row["noise"]), {})[row["decoder"]] = own
    groups = grouped([cell for cell in measured if "figures" in cell], "code", "noise")
    return [
        {"code": code, "noise": noise, **mean_over_scenes({str(i): cell["figures"] for i, cell in enumerate(own)}),
         "measured": made[code, noise]}
        for (code, noise), own in groups.items() if (code, noise) in made
    ]  # fmt: skip


def markdown(found: Row, study: Study | None = None) -> str:
    """The page of the results."""
    split, budget = found["split"], found["budget"]
    crop = "×".join(map(str, budget["crop"]))
    more_starts = max(code.search.starts for code in shipped().codes.values() if code.search)
    lines = [
        "# The spectral-depth camera, measured\n",
        f"Command: `{found['command']}` at commit `{found['commit']}`.\n",
        f"Learned from {', '.join(split['train'])}; measured on the middle {crop} pixels of "
        f"{', '.join(split['test'])}, averaged down to a shorter side of {split['side']} pixels or more. Inverse depth "
        "of scenes from files is mapped affinely onto the range of the design; cubes without depth are put at drawn "
        "depths, RGB-D scenes get made-up spectra of measured reflectances, test scenes of others than training "
        "scenes.\n",
        _known(found),
        f"Optimised masks: {budget['effort']['starts']} descents of {budget['effort']['steps']} steps on the predicted "
        f"confusion of depths under {_noises(found)[0]}, best of them and of random masks on training scenes at drawn "
        "depths; "
        f"static masks have {more_starts} times the descents, which takes as long as a search for four slots. "
        "Noise is in units of one band of a white scene; all "
        "exposures last equally long. Images are those of the linear model (thesis eqs 30–36), point spread functions "
        "have unit energy within their window; the share of a point's light that really arrives there is told.\n",
        *_training(found),
    ]
    for noise in _noises(found):
        lines += [f"## {noise}\n", _table(found, noise)]
    lines += _margins(found)
    lines += _order(found) if found["foretold"] else []
    return "\n".join([*lines, _THESIS, ""])


def _noises(found: Row) -> list[str]:
    """Of the rows, but for the constant guess."""
    return [*dict.fromkeys(row["noise"] for row in found["rows"] if row["noise"])]


def _training(found: Row) -> list[str]:
    """What networks learned from, and for how long."""
    rendered, budget = found["split"].get("rendered"), found["budget"]
    if rendered is None:
        return []
    withheld = found["split"].get("withheld")
    more_steps = max(code.learn.steps for code in shipped().codes.values() if code.learn)
    kept = "" if withheld is None else f" and {withheld}, which no network learned from,"
    return [
        f"Networks learned from these scenes and rendered ones ({', '.join(rendered['train'])}), {budget['steps']} "
        f"steps each; {', '.join(rendered['validation'])} (rendered){kept} chose the best step. A step costs more "
        "where there are more slots and filters: CPU minutes of search and training are told. Masks alone learn for "
        f"{more_steps} times the steps, which takes as long as four masks. Learned codes start from "
        "the searched ones of their kind and stay in their family; they learn from the two-headed network's loss and "
        "from the error of inverse depth that the patch likelihood is to expect. Other networks are trained behind "
        "codes that were so learned.\n"
    ]


def _order(found: Row) -> list[str]:
    """What was predicted of the codes, and whether in the right order."""
    figures = (
        ("placed", "error on training scenes at drawn depths (bins)", ".2f"),
        ("flat", "on flat ones (bins)", ".2f"),
        ("confusion", "predicted confusion (bins)", ".3f"), ("fisher", "Fisher information (m²)", ".0f"),
        ("kullback_leibler", "nats from the nearest rival", ".1f"), ("psnr", "predicted PSNR (dB)", ".2f"),
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
        "## What is predicted without a test scene\n",
        "The patch likelihood's error on some training scenes at drawn depths, with edges, and standing at every plane "
        "in turn; and under the prior "
        f"alone, of windows of {found['budget']['searched']} pixels, means over planes (of Fisher information the "
        "geometric one); beside what the patch likelihood made of the test scenes.\n",
        markdown_table(shown, told),
        "Rank correlation of each with the measured depth MAE, of PSNR with the measured one; 1: the right order.\n",
        markdown_table(order(found), ranked),
    ]


def _table(found: Row, noise: str) -> str:
    rows = [row for row in found["rows"] if row["noise"] in (noise, "")]
    shown = [{**row, "decoder": labels().get(row["decoder"], "")} for row in rows]
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


def _margins(found: Row) -> list[str]:
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


def _learning(found: Row) -> list[str]:
    columns = (
        ("decoder", "decoder", ""), ("noise", "noise", ""), ("code", "code", ""), ("depth_mae", "depth MAE (m)", ".3f"),
        ("start", "of its start (m)", ".3f"), ("start_psnr", "PSNR above its start (dB)", "+.2f"),
        ("static", "of its static special case, learned (m)", ".3f"), ("static_psnr", "PSNR above it (dB)", "+.2f"),
    )  # fmt: skip
    rows = learning(found)
    return ["## What learning codes adds\n", markdown_table(rows, columns)] if rows else []


def _known(found: Row) -> str:
    """Of which share of the test scenes' pixels the depth is known."""
    (row,) = [row for row in found["rows"] if row["code"] == CONSTANT][:1] or [{"scenes": {}}]
    shares = [f"{name} {own['known_depth']:.0%}" for name, own in row["scenes"].items()]
    return f"Depth is known, and counts, in these shares of the pixels: {', '.join(shares)}.\n"


def picture_files(study: Study, scenes: Sequence[str], out: Path) -> list[Path]:
    """Of what masks predict over depth, and of every scene."""
    return [out / f"{study.name}_{name}.png" for name in ("fisher", *scenes)]


def pictures(study: Study, measured: Sequence[Measured], out: Path, overwrite: bool) -> list[Path]:
    """Write what masks predict over depth, and the depth maps and spectra of every scene's rows."""
    predicted = {cell["code"]: cell["foretold"] for cell in measured if "confusion" in cell}
    camera = SpectralDepthCamera.from_preset(study.reading["preset"], size=tuple(study.reading["crop"]))
    files = []
    if predicted:
        drawn = predicted_depth_figure(predicted, camera.planes.metres.numpy())
        files.append(save_figure(drawn, picture_files(study, [], out)[0], overwrite=overwrite))
    for (scene,), own in grouped([cell for cell in measured if cell.get("estimate")], "scene").items():
        file = picture_files(study, [scene], out)[1]
        files.append(save_figure(_scene_figure(study, own, camera), file, overwrite=overwrite, dpi=80))
    return files


def _scene_figure(study: Study, cells: Sequence[Measured], camera: SpectralDepthCamera) -> Figure:
    """Depth maps and spectra of the rows of one scene."""
    first, labels = cells[0], study.decoder_labels
    scene = SpectralDepthEvaluation().load(first["source"], study.reading, materials="test")
    truth = middle_of(scene, camera.size, first["scene"])
    rows: dict[str, dict[str, Pair]] = {}
    for cell in cells:
        found = read_dataset(cell["estimate"], ("radiance", "depth"))
        rows.setdefault(cell["code"], {})[labels[cell["decoder"]]] = found["radiance"].values, found["depth"].values
    decoders = [*dict.fromkeys(labels[cell["decoder"]] for cell in cells)]
    real = truth["radiance"].values, truth["depth"].values
    return rows_figure(rows, decoders, real, camera.wavelengths, (camera.planes.near, camera.planes.far))
