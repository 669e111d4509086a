"""Rows of a study: a code, a noise and a decoder, from the cells of its scenes and seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tmca.evaluation.grid import Measured
from tmca.evaluation.study import Study
from tmca.evaluation.tables import Row, by_scene, grouped, mean_over_scenes


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
        metric: that is told seed by seed, as ``seed_METRIC``.
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
