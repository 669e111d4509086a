"""The page of a study: its results, its tables and pictures, and how the rows compare."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from tmca.applications.report import Section
from tmca.data.scene_names import short_names
from tmca.evaluation.camera import Place
from tmca.evaluation.gains import WHO, gain_columns, level, multiplexed, over, parts_of
from tmca.evaluation.grid import Measured
from tmca.evaluation.overview import PICTURE, is_drawn, known_rows, overview, overview_figure
from tmca.evaluation.study import Study, checked_study
from tmca.evaluation.tables import (
    MEASURED,
    Column,
    Row,
    Split,
    columns_there,
    grouped,
    made_by,
    markdown_table,
    mean,
    means,
    not_meaningful,
    repository_commit,
    rows_of,
    training_rows,
)

SEARCHES: tuple[Column, ...] = (
    ("code", "codes", ""), ("noise", "noise", ""), ("psnr", "expected PSNR (dB)", ".2f"),
    ("random_psnr", "random codes (dB)", ".2f"), ("held_out_gain", "gain on scenes left out (dB)", "+.2f"),
    ("confusion", "depth confusion (bins)", ".3f"), ("throughput", "light", ".1%"),
    ("seconds", "search (CPU s)", ".0f"),
)  # fmt: skip


def results(
    study: Study,
    measured: Sequence[Measured],
    split: Split,
    command: Sequence[str],
    places: Sequence[Place] = (),
) -> Row:
    """What the JSON file holds: the study, its trainings and searches, a row for every code, noise and decoder,
    the same of parts of scenes (``crop_rows``), and what the camera's evaluation adds.

    Args:
        study: what was compared.
        measured: cells that could be measured.
        split: of the scenes.
        command: how the run was called.
        places: where is measured: rows that lack some say so.
    """
    cells, trainings = [cell for cell in measured if "metrics" in cell], training_rows(measured)
    whole, parts = (
        rows_of(study, [c for c in cells if c["part"] == part], trainings, [p for p in places if p.part == part])
        for part in (False, True)
    )
    names = split["names"]
    scenes: Row = {"train": [*short_names(split["train"]).values()], "test": [*names.values()],
                   "real": [names[name] for name in split["test"]], "validation": split["validation"]}  # fmt: skip
    return {
        "command": " ".join(command), "commit": repository_commit(), "study": study.model_dump(mode="json"),
        "split": scenes,
        "budget": {"training": trainings, "decoding_seconds": float(sum(cell["seconds"] for cell in cells))},
        "searches": [_search(cell) for cell in measured if cell.get("step") == "search"],
        "rows": whole, **({"crop_rows": parts} if parts else {}),
        **study.evaluation.conclusions(study, measured, whole),
        "pictures": picture_names(study, [*names.values()]) if any(cell.get("estimate") for cell in cells) else {},
    }  # fmt: skip


def _search(cell: Measured) -> Row:
    """What a search tells of its codes."""
    said = ("code", "noise", "seed", "seconds", "psnr", "random_psnr", "throughput", "confusion", "predicted")
    gains = {"held_out_gain": mean([*cell["gains"].values()])} if "gains" in cell else {}
    return {**{name: cell[name] for name in said if name in cell}, **gains}


def picture_names(study: Study, scenes: Iterable[str]) -> dict[str, str]:
    """File → caption of the pictures of scenes."""
    kinds = () if study.figure else study.evaluation.pictures.items()
    return {
        "_".join(filter(None, (study.name, slug(scene), kind))) + ".png": f"{caption} ({scene})"
        for scene in scenes for kind, caption in kinds
    }  # fmt: skip


def slug(scene: str) -> str:
    """A scene's name as part of a file's."""
    return scene.strip("./").replace("/", "-").replace(":", "-")


def write_pictures(study: Study, found: Row, measured: Sequence[Measured], out: Path, overwrite: bool) -> None:
    """Draw the estimates of the first seed, scene by scene, and the study as a whole."""
    from tmca.plots.style import save_figure

    own = [cell for cell in measured if cell.get("seed", study.seed) == study.seed]
    figures = study.evaluation.study_figures(study, own)
    if is_drawn(study) and known_rows(found, study):
        figures = {**figures, PICTURE: overview_figure(found, study)}
    for name, figure in figures.items():
        save_figure(figure, out / f"{study.name}_{name}.png", overwrite=overwrite)
    pictured = [] if study.figure else [cell for cell in own if cell.get("estimate")]
    for (scene,), cells in grouped(pictured, "scene").items():
        drawn = study.evaluation.scene_figures(study, cells)
        for name, kind in zip(picture_names(study, [scene]), study.evaluation.pictures, strict=True):
            save_figure(drawn[kind], out / name, overwrite=overwrite, dpi=80)


def markdown(found: Row) -> str:
    """The results for people."""
    study, split = checked_study(found["study"], "study"), found["split"]
    learned = ", ".join(split["train"]) or "rendered ones"
    bands = f" {found['bands']}." if found.get("bands") else ""
    words = {name: _words(found[name]) for name in ("study", "split", "budget")}
    lines = [
        f"# {page_title(study)}", "", made_by(found), "",
        f"Training scenes: {learned}; test scenes: {', '.join(split['test'])}. Equal exposure time in all "
        f"rows. Means over scenes of means over seeds, then scene by scene.{bands} Light is the share of a white "
        "scene's light that passes mask and shutter.", "",
        *(line for text in said_about(found, study) for line in (text, "")),
    ]  # fmt: skip
    for section in sections(found, study):
        lines += [f"## {section.title}", "", *(line for text in section.text for line in (filled(text, words), ""))]
        lines += [markdown_table(section.table, section.columns)]
    if found["pictures"]:
        lines += ["## Pictures", "", f"Some rows, {study.shown_noise}, first seed.", ""]
        lines += [line for file, caption in found["pictures"].items() for line in (f"![{caption}]({file})", "")]
    return "\n".join(lines)


def said_about(found: Row, study: Study) -> list[str]:
    """Paragraphs of the page: what is doubtful, and what the study says."""
    words = {name: _words(found[name]) for name in ("study", "split", "budget")}
    networks = [study.about_networks] if found["budget"]["training"] and study.about_networks else []
    return [*study.doubts, *(filled(text, words) for text in (*study.about, *networks))]


def page_title(study: Study) -> str:
    """Heading of the page."""
    return study.title or (f"{study.name}: codes and decoders" if study.figure else study.name)


def filled(text: str, words: Mapping[str, Any]) -> str:
    """A text with entries of the results in the places of their names, ``{split[train]}``; other braces stay."""

    def entry(match: re.Match[str]) -> str:
        place: Any = words
        for name in re.findall(r"[^\[\]]+", match[1]):
            place = place.get(name) if isinstance(place, Mapping) else None
        return match[0] if place is None or isinstance(place, Mapping) else str(place)

    return re.sub(r"\{(\w+(?:\[[^\[\]{}]+\])+)\}", entry, text).strip()


def _words(value: Any) -> Any:
    """Entries of results as texts in their places: sizes as 3×4, lists of names with commas."""
    if isinstance(value, Mapping):
        return {name: _words(part) for name, part in value.items()}
    if not isinstance(value, list | tuple):
        return value
    return "×".join(map(str, value)) if all(isinstance(n, int) for n in value) else ", ".join(map(str, value))


def sections(found: Row, study: Study) -> Iterator[Section]:
    """Sections of the page that have rows."""
    yield from overview(found, study)
    for noise in dict.fromkeys(row["noise"] for row in found["rows"]):
        yield _rows(f"{noise}", [row for row in found["rows"] if row["noise"] == noise], study)
    if crops := found.get("crop_rows"):
        size = _words(study.reading["crop"])
        yield _rows(f"On a crop of {size}", crops, study)
    made = (_published, multiplexed, _pairs, _decoders)
    yield from (section for make in made for section in make(found, study))
    if failed := [{"name": name, "reason": reason} for name, reason in found.get("failed", {}).items()]:
        text = "Rows without these cells are means over the others."
        yield Section("What failed", [text], failed, [("name", "cell", ""), ("reason", "why", "")])
    searches = [
        {"code": code, "noise": noise, **means(_numbers(one) for one in own)}
        for (code, noise), own in grouped(found["searches"], "code", "noise").items()
    ]
    if {name for name, *_ in columns_there(SEARCHES, searches)} - {"code", "noise", "seconds"}:
        text = "Before anything is captured, means over seeds."
        yield Section("What was expected of searched codes", [text], searches, columns_there(SEARCHES, searches))
    yield from study.evaluation.sections(found, study)


def _numbers(row: Row) -> dict[str, float]:
    return {name: value for name, value in row.items() if isinstance(value, int | float)}


def _rows(title: str, rows: Sequence[Row], study: Study) -> Section:
    """Rows of a noise, or of parts of scenes."""
    metric, evaluation = study.evaluation.metric, study.evaluation
    heading, spec = next((heading, spec) for name, heading, spec in evaluation.columns if name == metric)
    columns: list[Column] = [("code", "code", ""), ("label", "decoder", ""), MEASURED, *evaluation.columns]
    columns += evaluation.beside
    scenes = dict.fromkeys(scene for row in rows for scene in row["scenes"])
    each = scenes if len(scenes) > 1 else ()
    columns += [(f"{metric} {scene}", f"{heading} {scene}", spec) for scene in each]
    columns += [("throughput", "light", ".1%"), ("arrived", "in the window", ".1%")]
    columns += [("seconds", "seconds a scene", ".1f"), ("seeds", f"{heading} seed by seed", "")]
    if any(row.get("training_cpu_minutes") for row in rows):
        columns += [("training_cpu_minutes", "training (CPU min)", ".1f")]
    noises = [("noise", "noise", "")] if len({row["noise"] for row in rows}) > 1 else []
    shown = [
        {**row, **{f"{metric} {scene}": values[metric] for scene, values in row["scenes"].items()},
         "label": study.decoder_labels.get(row["decoder"], row["decoder"]),
         "seeds": ", ".join(format(value, spec) for value in row[f"seed_{metric}"])}
        for row in rows
    ]  # fmt: skip
    said = [*not_meaningful(rows), *evaluation.warnings(shown)]
    return Section(title, said, shown, [*noises, *columns_there(columns, shown)])


def _pairs(found: Row, study: Study) -> Iterator[Section]:
    """Codes over others behind the same decoder."""
    known = {(row["code"], row["decoder"], row["noise"]): row for row in found["rows"]}
    rows = [
        {"code": code, "base": base, "noise": noise, "decoder": study.decoder_labels[decoder], "part": part,
         **over(row, known[base, decoder, noise], scenes, study)}
        for code, base in study.pairs for (own, decoder, noise), row in known.items()
        for part, scenes in parts_of(found).items() if own == code and (base, decoder, noise) in known
    ]  # fmt: skip
    columns = [("code", "codes", ""), ("base", "over", ""), *WHO, ("part", "scenes", ""), *gain_columns(study)]
    if rows:
        yield Section("Codes over others", ["Behind the same decoder."], rows, columns_there(columns, rows))


def _decoders(found: Row, study: Study) -> Iterator[Section]:
    """Decoders over others, over all codes: those that were measured on whole scenes there, others on parts."""
    labels, rows = study.decoder_labels, list[Row]()
    for better, worse in study.decoder_pairs:
        whole = {better, worse} <= {row["decoder"] for row in found["rows"]}
        places = parts_of(found) if whole else {"crop": found["split"]["real"]}
        own = grouped(found["rows" if whole else "crop_rows"], "noise").items() if whole or "crop_rows" in found else ()
        for ((noise,), cells), (part, scenes) in product(own, places.items()):
            levels = {(row["decoder"], row["code"]): level(row, scenes, "psnr") for row in cells}
            both = [(one, levels.get((worse, code))) for (name, code), one in levels.items() if name == better]
            gains = [one - other for one, other in both if one is not None and other is not None]
            if gains:
                rows.append({"decoder": labels[better], "base": labels[worse], "noise": noise, "part": part,
                             "mean": mean(gains), "least": min(gains), "most": max(gains)})  # fmt: skip
    columns = [WHO[0], ("base", "over", ""), WHO[1], ("part", "scenes", "")]
    columns += [(name, f"{name} (dB)", "+.2f") for name in ("mean", "least", "most")]
    if rows:
        yield Section("Decoders over others", ["PSNR, over all codes."], rows, columns_there(columns, rows))


def _published(found: Row, study: Study) -> Iterator[Section]:
    """The published table, and what stands for its rows here."""
    table, noise = study.published, next(iter(study.noises))
    if table is None:
        return
    rows, metrics = [], list(dict.fromkeys(name for row in table.rows.values() for name in row.values))
    specs = {name: spec for name, _, spec in study.evaluation.columns}
    for name, published in table.rows.items():
        row: Row = {"row": name, **published.values}
        for decoder in published.decoders:
            known = {(one["code"], one["noise"], one["decoder"]): one
                     for one in found.get("crop_rows" if published.part else "rows", ())}  # fmt: skip
            own = known.get((published.code, noise, decoder))
            levels = [level(own, found["split"]["real"], metric) for metric in metrics] if own else []
            texts = [format(value, specs[metric]) for value, metric in zip(levels, metrics, strict=False) if value]
            row[decoder] = " / ".join(texts)
        rows.append(row)
    here = dict.fromkeys(decoder for row in table.rows.values() for decoder in row.decoders)
    columns: list[Column] = [("row", "published", ""), *(c for c in study.evaluation.columns if c[0] in metrics)]
    columns += [(decoder, f"here: {study.decoder_labels[decoder]}", "") for decoder in here]
    yield Section(table.title, [table.about], rows, columns)
