"""The page of any study: a table for every noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tmca.evaluation.grid import Measured
from tmca.evaluation.study import Study
from tmca.evaluation.tables import Row, Split, markdown_table, repository_commit, rows_of, training_rows


def results(study: Study, measured: Sequence[Measured], split: Split, command: Sequence[str]) -> Row:
    """What the JSON file holds: the study, its trainings and searches, and a row for every code, noise and decoder."""
    names = split["names"]
    searches = [
        {name: cell[name] for name in ("code", "noise", "seed", "seconds")}
        for cell in measured if cell.get("step") == "search"
    ]  # fmt: skip
    return {
        "command": " ".join(command), "commit": repository_commit(), "study": study.model_dump(mode="json"),
        "split": {"train": split["train"], "test": [*names.values()], "validation": split["validation"]},
        "budget": {"training": training_rows(study, measured), "searches": searches},
        "rows": rows_of(study, measured, metric=metric_of(study)),
    }  # fmt: skip


def markdown(results: Row, study: Study) -> str:
    """The results for people."""
    split, rows = results["split"], results["rows"]
    learned = ", ".join(Path(name).name for name in split["train"]) or "the rendered training scenes"
    lines = [
        f"# {study.title or study.name}",
        "",
        f"Command: `{results['command']}` at commit `{results['commit']}`.",
        "",
    ]
    measured = ", ".join(split["test"])
    lines += [f"What is learned is learned from {learned}; measured on {measured}. Equal exposure time in all rows. "
              "Means over scenes of means over seeds, then scene by scene.", ""]  # fmt: skip
    for noise in dict.fromkeys(row["noise"] for row in rows):
        lines += [f"## {noise}", "", _table([row for row in rows if row["noise"] == noise], study)]
    return "\n".join(lines)


def _table(rows: Sequence[Row], study: Study) -> str:
    metric = metric_of(study)
    heading = "PSNR" if metric == "psnr" else metric
    metrics = [column for column in study.evaluation.application.columns if any(column[0] in row for row in rows)]
    columns = [("code", "code", ""), ("label", "decoder", ""), *metrics]
    columns += [(f"{metric} {scene}", f"{heading} {scene}", ".2f") for scene in rows[0]["scenes"]]
    columns += [("throughput", "light", ".1%"), ("seconds", "seconds a scene", ".1f")]
    columns += [("seeds", f"{heading} seed by seed", ""), ("training_cpu_minutes", "training (CPU min)", ".1f")]
    return markdown_table([shown(row, study) for row in rows], columns)


def metric_of(study: Study) -> str:
    """The metric that is shown scene by scene and seed by seed: PSNR, or the first of the camera's."""
    names = [name for name, *_ in study.evaluation.application.columns]
    return "psnr" if "psnr" in names else names[0]


def shown(row: Row, study: Study) -> Row:
    """A row with its decoder's label, and a metric of every scene and of every seed."""
    metric = metric_of(study)
    return {
        **row, **{f"{metric} {scene}": values[metric] for scene, values in row["scenes"].items()},
        "label": study.decoder_labels.get(row["decoder"], row["decoder"]),
        "seeds": ", ".join(f"{value:.2f}" for value in row[f"seed_{metric}"]),
    }  # fmt: skip


def picture_files(study: Study, scenes: Sequence[str], out: Path) -> list[Path]:
    """None."""
    return []


def pictures(study: Study, measured: Sequence[Measured], out: Path, overwrite: bool) -> list[Path]:
    """None."""
    return []
