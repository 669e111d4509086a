"""An estimate beside the scene that it is of, brought to its bands and size, with figures of merit."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from tmca.applications.imaging import evaluation_of
from tmca.metrics import MERITS
from tmca.viewer.cubes import merit_facts
from tmca.viewer.items import Item
from tmca.viewer.opening import in_memory_items, open_items


def beside_truth(estimate: Any, truth: Any, stack: ExitStack, *, with_truth: bool = True) -> list[Item]:
    """The items of an estimate, and those of its truth.

    Args:
        estimate: a file's path, or an Estimate.
        truth: a scene, its file, or its name.
        stack: closes the file.
        with_truth: whether the truth is among them.

    Raises:
        DataError, ShapeError, SettingError: see `tmca.evaluate`.
    """
    evaluation = evaluation_of(estimate, truth)
    opened = open_items(estimate, stack)
    measured = merit_facts(evaluation.metrics)
    better = {name.replace("_", " ").upper(): _direction(name) for name in evaluation.metrics}
    merit = {name: f"{said}{better.get(name, '')}" for name, said in measured.items()}
    items = [
        replace(item, facts={**merit, **{name: said for name, said in item.facts.items() if name not in merit}})
        for item in opened
    ]
    return items + (in_memory_items(evaluation.truth, "truth", "truth") if with_truth else [])


def _direction(metric: str) -> str:
    better = MERITS[metric].direction if metric in MERITS else ""
    return f" ({better})" if better else ""
