"""An estimate beside the scene that it is of, brought to its bands and size, with figures of merit."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from tmca.applications.imaging import evaluation_of
from tmca.viewer.items import Item
from tmca.viewer.opening import in_memory_items, open_items

_UNITS = {"psnr": "dB", "sam": "°", "ergas": "%", "depth_mae": "m", "depth_rmse": "m"}


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
    merit = {
        name.replace("_", " ").upper(): f"{value:.4g} {_UNITS.get(name, '')}".rstrip()
        for name, value in evaluation.metrics.items()
    }
    items = [replace(item, facts={**merit, **item.facts}) for item in open_items(estimate, stack)]
    return items + (in_memory_items(evaluation.truth, "truth", "truth") if with_truth else [])
