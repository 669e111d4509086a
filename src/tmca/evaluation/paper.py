"""What a study is shown by: a figure for a paper of every scene, and one page with the tables and these figures."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.applications.report import Section, write_report
from tmca.data import read_dataset, write_text
from tmca.evaluation.grid import Measured
from tmca.evaluation.page import page_title, said_about, sections, slug
from tmca.evaluation.study import Study
from tmca.evaluation.tables import MEASURED, Column, Row, grouped, latex_table, not_meaningful
from tmca.metrics import meaning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PRINTED, _READ, _MORE = 400, 200, 110
"""Dots per inch of pictures for print, of the first one of a page, and of the others."""
_SPECTRA = (
    "Spectra are those of the points that are numbered in the truth, for each code those of its decoder with the "
    "highest PSNR, which the legend names where there are several."
)
_LIGHT = (
    "Light is the share of a white scene's light that passes mask and shutter: a mask that is half open takes half, "
    "also where two buckets keep all that the shutter would lose."
)
_DRAWN = 8
"""Most scenes of a page that are drawn in it."""


def paper_files(study: Study, scenes: Sequence[str]) -> list[str]:
    """Names of the figures of scenes, and of the page; none of a study without."""
    if not study.figure:
        return []
    return [f"{stem}{suffix}" for stem in _stems(study, scenes).values() for suffix in (".pdf", ".png")] + [
        f"{study.name}.html",
        f"{study.name}.tex",
    ]


def _stems(study: Study, scenes: Sequence[str]) -> dict[str, str]:
    """Scene → file of its figure without a suffix: the study's name for the first."""
    return {scene: study.name if not place else f"{study.name}_{slug(scene)}" for place, scene in enumerate(scenes)}


def write_paper(study: Study, found: Row, measured: Sequence[Measured], out: Path, overwrite: bool) -> None:
    """Draw truth and estimates of every scene, and write the page; nothing of a study without a figure."""
    from tmca.plots.style import save_figure

    if not study.figure:
        return
    stems, figures = _stems(study, found["split"]["test"]), {}
    shown = [cell for cell in measured if cell.get("estimate") and not cell["part"]]
    for (scene,), cells in grouped(shown, "scene").items():
        figures[scene] = figure = scene_figure(study, cells, _drawn(study, found))
        for suffix in (".pdf", ".png"):
            save_figure(figure, out / f"{stems[scene]}{suffix}", overwrite=overwrite, dpi=_PRINTED)
    rows, columns = summary(study, found)
    printed = [column for column in columns if column[0] != "seconds"]
    write_text(latex_table(rows, printed), out / f"{study.name}.tex", overwrite=overwrite)
    write_report(out / f"{study.name}.html", page_title(study), _page(study, found, figures), overwrite=overwrite)


def _drawn(study: Study, found: Row) -> list[tuple[str, str]]:
    """Code and decoder of the rows that are drawn."""
    rows = [row for row in found["rows"] if row["noise"] == study.shown_noise]
    shown = [row for row in rows if study.shown is None or (row["code"], row["decoder"]) in study.shown]
    return [(row["code"], study.decoder_labels[row["decoder"]]) for row in shown]


def scene_figure(study: Study, cells: Sequence[Measured], names: Sequence[tuple[str, str]] = ()) -> Figure:
    """Estimates of a scene side by side: a column for every code and a row for every decoder, or turned where there are
    more decoders; of ``names``, codes and labels of decoders, those without an estimate are said to have failed."""
    from tmca.plots.side_by_side import side_by_side

    labels = study.decoder_labels
    estimates = {(cell["code"], labels[cell["decoder"]]): read_dataset(cell["estimate"], ()) for cell in cells}
    return side_by_side(estimates, study.evaluation.truth(study, cells[0]), names)


def summary(study: Study, found: Row) -> tuple[list[Row], list[Column]]:
    """Rows and columns of the table of codes, decoders and noises that people read first."""
    labels = study.decoder_labels
    rows = [{**row, "label": labels.get(row["decoder"], row["decoder"])} for row in found["rows"]]
    columns: list[Column] = [("code", "code", ""), ("label", "decoder", ""), MEASURED]
    columns += [("noise", "noise", "")] if len(study.noises) > 1 else []
    columns += [*study.evaluation.columns, *study.evaluation.beside]
    columns += [("throughput", "light", ".1%"), ("seconds", "seconds", ".1f")]
    return rows, [column for column in columns if any(row.get(column[0]) not in (None, "") for row in rows)]


def _page(study: Study, found: Row, figures: dict[str, Figure]) -> list[Section]:
    """What was compared, the table, the figures, and all the tables."""
    rows, columns = summary(study, found)
    more = [one for one in sections(found, study) if not _repeats(one, rows, columns)]
    paragraphs = [*said_about(found, study), *_about(study, found), *_in_words(columns), *not_meaningful(rows)]
    made = [Section("Results", paragraphs, rows, columns)]
    for place, (scene, figure) in enumerate([*figures.items()][:_DRAWN]):
        figure.set_dpi(_MORE if place else _READ)
        under = f" under {study.shown_noise}" if len(study.noises) > 1 else ""
        said = [f"The first seed{under}. Numbers in the pictures are PSNR over all that is measured of the scene."]
        said += [_SPECTRA] if any("wavelength" in axis.get_xlabel() for axis in figure.axes) else []
        said += [str(figure.get_label())] if figure.get_label() else []
        made.append(Section(f"Side by side: {scene}", said, figures={f"Truth and estimates of {scene}": figure}))
    return [*made, *more, *_how(found)]


def _repeats(section: Section, rows: Sequence[Row], columns: Sequence[Column]) -> bool:
    """Whether a section has no more than the first table."""
    own = [(row.get("code"), row.get("decoder"), row.get("noise")) for row in section.table]
    same = own == [(row["code"], row["decoder"], row["noise"]) for row in rows]
    return same and {name for name, *_ in section.columns} <= {name for name, *_ in columns}


def _about(study: Study, found: Row) -> list[str]:
    """What was measured, on what, in two sentences."""
    learned = ", ".join(found["split"]["train"]) or "the rendered scenes that come with tmca"
    noises = "; ".join(f"{name} ({_said(values)})" for name, values in study.noises.items())
    seeds = f"{study.seeds} seeds" if study.seeds > 1 else "one seed"
    span = study.reading.get("range")
    bands = f" Bands from {span[0] * 1e9:g} to {span[1] * 1e9:g} nm." if span else ""
    bands += f" {found['bands']}." if found.get("bands") else ""
    return [
        f"{_counted(study.codes, 'code')} and {_counted(study.decoders, 'decoder')} of a {study.camera} camera on "
        f"{', '.join(found['split']['test'])}, {seeds} each. All codes expose equally long.{bands}",
        f"Sensor: {noises}. Priors learn from {learned}, never from a measured scene.",
    ]


def _counted(things: Collection[str], name: str) -> str:
    return f"{len(things)} {name}{'s'[: len(things) != 1]}"


def _in_words(columns: Sequence[Column]) -> list[str]:
    """What the figures of merit are."""
    known = [(heading.partition(" (")[0], meaning(name)) for name, heading, _ in columns]
    said = "; ".join(f"{heading}: {words}" for heading, words in known if words)
    return [f"{said}. {_LIGHT}"] if said else []


def _said(sensor: dict[str, Any]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in sensor.items()) or "without noise"


def _how(found: Row) -> list[Section]:
    """How to come by it again."""
    called = f"Command: {found['command']}" if found["command"] else "Called from Python."
    return [Section("How it was made", [called, "The JSON file beside this page holds the study and all numbers."])]
