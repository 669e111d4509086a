"""Outlines of the things that stand before the background: silhouettes from the photograph, and drawn shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tmca.data.rendering.surfaces import Outline

Array = NDArray[np.float64]

_GRID = 65
_BLUR = 1.5
_SMALLEST, _LARGEST = 0.005, 0.25
"""Share of the photograph that a region may cover to serve as a silhouette."""


def silhouettes(labels: NDArray[np.intp]) -> list[NDArray[np.float32]]:
    """Fields of the photograph's own regions, positive inside, smoothed against the steps of its pixels.

    Regions that touch the border are left out: they are cut by the picture and not by an object.
    """
    from scipy.ndimage import find_objects, gaussian_filter

    area = np.bincount(labels.ravel()) / labels.size
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    fields = []
    for number, place in enumerate(find_objects(labels + 1)):
        if place is not None and _SMALLEST < area[number] < _LARGEST and number not in edge:
            mask = np.pad((labels[place] == number).astype(np.float32), 6)
            fields.append(np.asarray(gaussian_filter(mask, _BLUR) - 0.5, dtype=np.float32))
    return fields


def drawn(rng: np.random.Generator) -> NDArray[np.float32]:
    """A field of an ellipse, a card, a bar or a lobed blob within a square, positive inside."""
    y, x = np.mgrid[-1.15 : 1.15 : _GRID * 1j, -1.15 : 1.15 : _GRID * 1j]
    kind = rng.choice(["ellipse", "card", "bar", "blob"])
    narrow = rng.uniform(0.45, 1.0)
    if kind == "ellipse":
        field = 1 - np.hypot(x, y / narrow)
    elif kind == "card":
        field = 1 - np.maximum(abs(x), abs(y) / narrow)
    elif kind == "bar":
        field = 1 - np.maximum(abs(x), abs(y) / (0.2 * narrow))
    else:
        angle = np.arctan2(y, x)
        size, phase = rng.uniform(0.02, 0.12, 3), rng.uniform(0, 6, 3)
        lobes = [size[i] * np.cos(count * angle + phase[i]) for i, count in enumerate((2, 3, 5))]
        field = 0.75 + sum(lobes) - np.hypot(x, y)
    return np.asarray(field, dtype=np.float32)


def placed(
    field: NDArray[np.float32], extent: float, centre: tuple[float, float], rng: np.random.Generator, upright: bool
) -> Outline:
    """A field laid over the centre view at ``centre`` (y, x), ``extent`` px across on its longer side.

    Args:
        field: from `silhouettes` or `drawn`.
        extent: px of the centre view.
        centre: px of the centre view.
        rng: draws the turn and the mirroring.
        upright: turn it by no more than a few degrees.
    """
    turn = similarity(max(field.shape) / extent, rng, 0.3 if upright else np.pi)
    middle = turn @ np.array(centre)
    origin = (float((field.shape[0] - 1) / 2 - middle[0]), float((field.shape[1] - 1) / 2 - middle[1]))
    return Outline(field, turn, origin)


def similarity(scale: float, rng: np.random.Generator, most: float) -> Array:
    """``(2, 2)``: a turn by at most ``most`` radians, perhaps mirrored, times ``scale``."""
    angle, mirrored = rng.uniform(-most, most), rng.random() < 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return scale * turn @ np.diag([1.0, -1.0 if mirrored else 1.0])
