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
from tmca.evaluation.grid import Measured
from tmca.evaluation.study import Study, checked_study
from tmca.evaluation.tables import (
    MEASURED,
    Column,
    Row,
    Split,
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

WHO: tuple[Column, ...] = (("decoder", "decoder", ""), ("noise", "noise", ""))
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


def write_pictures(study: Study, measured: Sequence[Measured], out: Path, overwrite: bool) -> None:
    """Draw the estimates of the first seed, scene by scene, and the study as a whole."""
    from tmca.plots.style import save_figure

    own = [cell for cell in measured if cell.get("seed", study.seed) == study.seed]
    figures = study.evaluation.study_figures(study, own)
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
    learned = ", ".join(split["train"]) or "the rendered training scenes"
    bands = f" {found['bands']}." if found.get("bands") else ""
    words = {name: _words(found[name]) for name in ("study", "split", "budget")}
    about = [*study.about, *([study.about_networks] if found["budget"]["training"] and study.about_networks else [])]
    lines = [
        f"# {page_title(study)}", "", made_by(found), "",
        f"What is learned is learned from {learned}; measured on {', '.join(split['test'])}. Equal exposure time in "
        f"all rows. Means over scenes of means over seeds, then scene by scene.{bands} Light is the share of a white "
        "scene's light that passes mask and shutter.", "",
        *(line for text in about for line in (filled(text, words), "")),
    ]  # fmt: skip
    for section in sections(found, study):
        lines += [
            f"## {section.title}",
            "",
            *(line for text in section.text for line in (filled(text, words), "")),
        ]
        lines += [markdown_table(section.table, section.columns)]
    if found["pictures"]:
        lines += ["## Pictures", "", f"Some rows, {study.shown_noise}, first seed.", ""]
        lines += [line for file, caption in found["pictures"].items() for line in (f"![{caption}]({file})", "")]
    return "\n".join(lines)


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
    for noise in dict.fromkeys(row["noise"] for row in found["rows"]):
        yield _rows(f"{noise}", [row for row in found["rows"] if row["noise"] == noise], study)
    if crops := found.get("crop_rows"):
        size = _words(study.reading["crop"])
        yield _rows(f"On a crop of {size}", crops, study)
    made = (_published, _multiplexed, _pairs, _decoders)
    yield from (section for make in made for section in make(found, study))
    if failed := [{"name": name, "reason": reason} for name, reason in found.get("failed", {}).items()]:
        text = "Rows without these cells are means over the others."
        yield Section("What failed", [text], failed, [("name", "cell", ""), ("reason", "why", "")])
    searches = [
        {"code": code, "noise": noise, **means(_numbers(one) for one in own)}
        for (code, noise), own in grouped(found["searches"], "code", "noise").items()
    ]
    if {name for name, *_ in _there(SEARCHES, searches)} - {"code", "noise", "seconds"}:
        text = "Before anything is captured, means over seeds."
        yield Section("What was expected of searched codes", [text], searches, _there(SEARCHES, searches))
    yield from study.evaluation.sections(found, study)


def _numbers(row: Row) -> dict[str, float]:
    return {name: value for name, value in row.items() if isinstance(value, int | float)}


def _there(columns: Iterable[Column], rows: Sequence[Row]) -> list[Column]:
    """Columns that some row has; seeds and scenes one by one where some row has several."""
    there = [column for column in columns if any(row.get(column[0]) not in (None, "") for row in rows)]
    alone = {name for name in ("seeds", "scenes") if not any(", " in str(row.get(name, "")) for row in rows)}
    return [column for column in there if column[0] not in alone]


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
    return Section(title, said, shown, [*noises, *_there(columns, shown)])


def parts_of(found: Row) -> dict[str, list[str]]:
    """Scenes that the study names, and those of known geometry beside them where there are any."""
    real, names = found["split"]["real"], found["split"]["test"]
    others = [name for name in names if name not in real]
    return {"of the study": list(real), "rendered": others} if others else {"": list(real)}


def level(row: Row, scenes: Iterable[str], name: str) -> float | None:
    """Mean of a metric over those scenes that have it."""
    known = [row["scenes"][scene][name] for scene in scenes if name in row["scenes"].get(scene, ())]
    return mean(known) if known else None


def over(row: Row, base: Row, scenes: Sequence[str], study: Study) -> Row:
    """What a row gains over another on those scenes that both have: differences of metrics; of the metric by which
    codes are chosen the ratio, where it is an error; seed by seed, where both have all, and scene by scene."""
    metric = study.evaluation.metric
    spec = "+.2f" if metric == "psnr" else ".2f"
    scenes = [scene for scene in scenes if scene in row["scenes"] and scene in base["scenes"]]
    whole = MEASURED[0] not in row and MEASURED[0] not in base
    pairs = zip(row.get(f"seed_{metric}", ()), base.get(f"seed_{metric}", ()), strict=False)
    seeds = [_gain(one, other, metric) for one, other in pairs] if whole else []
    each = {scene: _gain(level(row, [scene], metric), level(base, [scene], metric), metric) for scene in scenes}
    names = [name for name, *_ in study.evaluation.columns]
    differences = {name: _difference(level(row, scenes, name), level(base, scenes, name)) for name in names}
    return {
        **differences, "gain": _gain(level(row, scenes, metric), level(base, scenes, metric), metric),
        "seeds": ", ".join(format(gain, spec) for gain in seeds),
        "scenes": ", ".join(f"{scene} {format(gain, spec)}" for scene, gain in each.items() if gain is not None),
    }  # fmt: skip


def _gain(one: float | None, other: float | None, metric: str) -> float | None:
    """dB of PSNR; of an error the ratio."""
    if metric == "psnr" or one is None or other is None:
        return _difference(one, other)
    return one / other


def _difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def _gain_columns(study: Study) -> list[Column]:
    """Columns of what ``over`` tells."""
    columns, metric = study.evaluation.columns, study.evaluation.metric
    heading = next(heading for name, heading, _ in columns if name == metric)
    signed: list[Column] = [(n, h, f"+{spec}") for n, h, spec in columns if n != metric or metric != "psnr"]
    first: Column = ("gain", f"gain, {heading}", "+.2f") if metric == "psnr" else ("gain", f"ratio of {heading}", ".2f")
    return [first, ("seeds", "seed by seed", ""), ("scenes", "scene by scene", ""), *signed]


def _pairs(found: Row, study: Study) -> Iterator[Section]:
    """Codes over others behind the same decoder."""
    known = {(row["code"], row["decoder"], row["noise"]): row for row in found["rows"]}
    rows = [
        {"code": code, "base": base, "noise": noise, "decoder": study.decoder_labels[decoder], "part": part,
         **over(row, known[base, decoder, noise], scenes, study)}
        for code, base in study.pairs for (own, decoder, noise), row in known.items()
        for part, scenes in parts_of(found).items() if own == code and (base, decoder, noise) in known
    ]  # fmt: skip
    columns = [("code", "codes", ""), ("base", "over", ""), *WHO, ("part", "scenes", ""), *_gain_columns(study)]
    if rows:
        yield Section("Codes over others", ["Behind the same decoder."], rows, _there(columns, rows))


def margins(found: Row, study: Study) -> list[Row]:
    """Time-multiplexed codes against those with one slot, and against other bases, decoder by decoder and noise by
    noise: the best of either as they are chosen without a test scene, or in hindsight where nothing is known so.
    Bursts are neither."""
    static = [name for name, code in study.codes.items() if code.one_slot]
    apart = [*static, *(name for name, code in study.codes.items() if code.burst)]
    bases, rows = {"one slot": static, **study.bases}, []
    groups = grouped(found["rows"], "decoder", "noise").items()
    for ((decoder, noise), own), (part, scenes) in product(groups, parts_of(found).items()):
        known = study.evaluation.scores(found, decoder, noise)
        for name, base in bases.items():
            several = [row for row in own if row["code"] not in apart and level(row, scenes, "psnr") is not None]
            single = [row for row in own if row["code"] in base and level(row, scenes, "psnr") is not None]
            if several and single:
                rows.append({"decoder": study.decoder_labels[decoder], "noise": noise, "part": part, "against": name,
                             **_best_over_best(several, single, known, scenes, study)})  # fmt: skip
    return rows


def _best_over_best(
    several: Sequence[Row], single: Sequence[Row], known: Mapping[str, float], scenes: Sequence[str], study: Study
) -> Row:
    """The best of some rows over the best of others."""
    metric, groups = study.evaluation.metric, (several, single)
    sign = -1 if metric == "psnr" else 1

    def measured(row: Row) -> float:
        return sign * (level(row, scenes, metric) or 0.0)

    judged = [[row for row in group if row["code"] in known] for group in groups]
    top, bottom = (min(group, key=measured) for group in groups)
    best, base = (min(group, key=lambda row: known[row["code"]]) for group in judged) if all(judged) else (top, bottom)
    hindsight = over(top, bottom, scenes, study)["gain"]
    return {"best": best["code"], "base": base["code"], **over(best, base, scenes, study),
            **({"hindsight": hindsight} if all(judged) else {})}  # fmt: skip


def _multiplexed(found: Row, study: Study) -> Iterator[Section]:
    columns: list[Column] = [*WHO, ("part", "scenes", ""), ("against", "against", "")]
    gains, rows = _gain_columns(study), margins(found, study)
    columns += [("best", "best time-multiplexed", ""), ("base", "best of the others", ""), gains[0]]
    columns += [("hindsight", "in hindsight", gains[0][2]), *gains[1:]]
    text = "Codes are chosen without a test scene where something is known of them: by a network's validation, or as "
    text += "the table of predictions says; else, and where it says so, in hindsight."
    if study.figure and not any("hindsight" in row for row in rows):
        text = "For each decoder, the best code of several slots over the best of one slot. Both are chosen by what "
        text += "was measured on these scenes. A burst is neither: it multiplexes nothing."
    if rows:
        yield Section("Time-multiplexed over static codes", [text], rows, _there(columns, rows))


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
        yield Section("Decoders over others", ["PSNR, over all codes."], rows, _there(columns, rows))


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
