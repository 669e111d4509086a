"""An estimate beside the scene that it is of, brought to its bands and size, with figures of merit."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.applications.evaluating import evaluation_of
from tmca.applications.light_field import usable_disparity
from tmca.metrics import MERITS
from tmca.viewer.cubes import ONE, merit_facts
from tmca.viewer.items import Item, Layer, in_memory
from tmca.viewer.opening import in_memory_items, open_items


def beside_truth(estimate: Any, truth: Any, stack: ExitStack, *, with_truth: bool = True) -> list[Item]:
    """The items of an estimate, and those of its truth; of a light field also its true disparity, where it is known.

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
    scene: Any = evaluation.truth
    real = usable_disparity(scene, scene) if "view_v" in scene.dims else None
    if real is not None:
        items = [_with_error(item, real) for item in items]
        scene = scene.to_dataset(name="light_field").assign(disparity=(("y", "x"), real))
    return items + (in_memory_items(scene, "truth", "truth") if with_truth else [])


def _with_error(item: Item, real: NDArray[Any]) -> Item:
    """The item of an estimate with the error of its disparity."""
    shown = item.layer("disparity")
    if shown is None or shown.size != real.shape:
        return item
    error = in_memory(np.abs(shown.plane(0) - real)[None])
    layer = Layer("error", "error of the disparity", shown.size, ONE, error, shown.unit, "deviation")
    return replace(item, layers=(*item.layers, layer))


def _direction(metric: str) -> str:
    better = MERITS[metric].direction if metric in MERITS else ""
    return f" ({better})" if better else ""
