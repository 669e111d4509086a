"""Tables of results: rows from measured cells, JSON and CSV for programs, Markdown for people."""

from __future__ import annotations

import subprocess  # nosec B404
from collections.abc import Collection, Iterable, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from tmca.errors import OutputError, SettingError
from tmca.evaluation.grid import Measured

if TYPE_CHECKING:
    from tmca.evaluation.study import Study

Row = dict[str, Any]


class Split(TypedDict):
    """Sources that a study learned from, measured and validated on; ``names`` are short ones of what was measured."""

    train: list[str]
    test: list[str]
    names: dict[str, str]
    validation: list[str]


def decoder_labels(kind: str, shown: Mapping[str, str] | None = None) -> dict[str, str]:
    """Name → label of the decoders of a kind of camera, those of plug-ins included.

    Args:
        kind: of the camera.
        shown: labels that differ from the decoder's own, and those of networks that are trained row by row; first.
    """
    from tmca.decoders import decoders_for

    known = {name: cls.label for name, cls in decoders_for(kind).items()}
    return {**(shown or {}), **{name: label for name, label in known.items() if name not in (shown or {})}}


def check_new(files: Iterable[Path], overwrite: bool) -> None:
    """Refuse to start where earlier results would be replaced.

    Raises:
        OutputError: a file exists and ``overwrite`` is False.
    """
    for file in files:
        if file.exists() and not overwrite:
            raise OutputError(file, "a file of earlier results", "none", "pass --overwrite or another --out")


def check_counts(**counts: int) -> None:
    """Raises SettingError for the first of these options that is below 1."""
    for name, value in counts.items():
        if value < 1:
            raise SettingError(f"--{name}", str(value), "at least 1")


def check_decoders(decoders: Sequence[str], known: Collection[str]) -> None:
    """Raises SettingError unless there are decoders, all of them known."""
    unknown = [name for name in decoders if name not in known]
    if unknown or not decoders:
        raise SettingError("--decoders", ", ".join(unknown) or "none", f"some of {', '.join(known)}")


def check_weights(decoder: str, settings: Mapping[str, Any], where: str) -> None:
    """Raises SettingError for the decoder ``network`` without weights; networks of a study bring what it trained."""
    if decoder == "network" and not settings.get("weights"):
        raise SettingError(where, "none for the decoder network", "a run or file of `tmca train`")


def write_table(results: Row, text: str, files: Sequence[Path], overwrite: bool) -> None:
    """Results for programs into the first file, and for people into the second.

    Raises:
        OutputError: a file exists and ``overwrite`` is False, or cannot be written.
    """
    from tmca.data import write_json, write_text

    write_json(results, files[0], overwrite=overwrite)
    write_text(text, files[1], overwrite=overwrite)


def by_scene(cells: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Means over seeds of every metric, scene by scene."""
    groups = grouped(cells, "scene").items()
    return {
        scene: mean_over_scenes({str(i): cell["metrics"] for i, cell in enumerate(own)}) for (scene,), own in groups
    }


def mean_over_scenes(scenes: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Mean of every metric over the scenes that have it."""
    names = dict.fromkeys(name for scene in scenes.values() for name in scene)
    known = {name: [scene[name] for scene in scenes.values() if name in scene] for name in names}
    return {name: sum(values) / len(values) for name, values in known.items()}


def grouped(cells: Sequence[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    """Cells that agree in some settings, in the order in which these first occur."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for cell in cells:
        groups.setdefault(tuple(cell[name] for name in names), []).append(cell)
    return groups


def training_rows(study: Study, measured: Sequence[Measured]) -> list[Row]:
    """What every training took, and its validation figures."""
    return [
        {"code": cell["code"], "decoder": cell["decoder"], "seed": cell["seed"],
         "steps": cell["training"]["optimiser"]["steps"], "cpu_seconds": cell["seconds"], "best": cell["best"]}
        for cell in measured if "best" in cell
    ]  # fmt: skip


def rows_of(study: Study, measured: Sequence[Measured], *, metric: str = "psnr") -> list[Row]:
    """A row for every code, noise and decoder: means over scenes of the means over seeds.

    Args:
        study: what was compared.
        measured: its cells.
        metric: that is given seed by seed too, as ``seed_METRIC``.
    """
    cells = [cell for cell in measured if "metrics" in cell]
    trainings = training_rows(study, measured)
    return [row_of(study, own, trainings, metric) for own in grouped(cells, "code", "noise", "decoder").values()]


def row_of(study: Study, cells: Sequence[Measured], trainings: Sequence[Row], metric: str) -> Row:
    """One of them."""
    first, scenes = cells[0], by_scene(cells)
    code, noise, decoder = first["code"], first["noise"], first["decoder"]
    seeds = [
        [cell["metrics"][metric] for cell in cells if cell["seed"] == seed]
        for seed in sorted({cell["seed"] for cell in cells})
    ]
    return {
        "method": f"{code} + {study.decoder_labels[decoder]}", "exposure": "equal",
        "code": code, "noise": noise, "decoder": decoder, "scenes": scenes, **mean_over_scenes(scenes),
        f"seed_{metric}": [mean(values) for values in seeds],
        "throughput": mean([cell["throughput"] for cell in cells]),
        "seconds": mean([cell["seconds"] for cell in cells]),
        "training_cpu_minutes": training_minutes(study, code, decoder, trainings),
    }  # fmt: skip


def training_minutes(study: Study, code: str, decoder: str, trainings: Sequence[Row]) -> float:
    """CPU minutes of learning, means over seeds: of the row's network, and of that which its codes learned with."""
    learn = study.codes[code].learn
    learners = [name for name, others in learn.networks.items() if decoder in others] if learn else []
    spent = 0.0
    for name in (decoder, *learners):
        own = [one["cpu_seconds"] for one in trainings if (one["code"], one["decoder"]) == (code, name)]
        spent += mean(own) / 60 if own else 0.0
    return spent


def mean(values: Sequence[Any]) -> float:
    """Of numbers."""
    return float(sum(values) / len(values))


def csv_text(rows: Sequence[Row], columns: Sequence[str]) -> str:
    """Rows as CSV, full precision."""
    import pandas as pd

    return pd.DataFrame(rows, columns=list(columns)).to_csv(index=False, float_format=lambda value: repr(float(value)))


def markdown_table(rows: Sequence[Row], columns: Sequence[tuple[str, str, str]]) -> str:
    """Rows as a Markdown table.

    Args:
        rows: dictionaries.
        columns: (key, heading, format) of each column; a missing value, None or NaN, is left empty.
    """
    lines = ["| " + " | ".join(heading for _, heading, _ in columns) + " |", "|" + " --- |" * len(columns)]
    for row in rows:
        values = [(row.get(key), spec) for key, _, spec in columns]
        lines.append("| " + " | ".join("" if _missing(value) else format(value, spec) for value, spec in values) + " |")
    return "\n".join(lines) + "\n"


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and isnan(value))


def repository_commit() -> str | None:
    """Commit of the checkout that the package runs from (``-dirty`` with uncommitted changes), None outside of one."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603 # nosec B603
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None
