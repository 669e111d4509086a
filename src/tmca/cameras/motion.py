"""Scenes that move within the exposure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import ceil, floor, isfinite

import torch
from torch import Tensor

from tmca.errors import SettingError

_GAUSS = (0.5 - 12**-0.5, 0.5 + 12**-0.5)
"""Places between 0 and 1 whose mean is the integral of every polynomial up to the third degree."""


def moving_scene(scene: Tensor, displacement: tuple[float, float], slots: int) -> Tensor:
    """(L, H, W) → (K, L, H, W): the scene displaced evenly over the exposure, itself in the middle; bilinear, its edge
    continued.

    Every slot sees the mean of what passes during it, not a standing scene: one slot, a static exposure, is smeared
    over the whole displacement.

    Args:
        scene: (L, H, W).
        displacement: rows and columns from the beginning to the end of the exposure, pixels.
        slots: K.

    Raises:
        SettingError: a displacement as large as the scene.
    """
    height, width = scene.shape[1:]
    check_displacement(displacement, (height, width))
    down, across = (ceil(abs(part) / 2) + 1 for part in displacement)
    edged = torch.nn.functional.pad(scene[None], (across, across, down, down), mode="replicate")[0]

    def seen(places: Mapping[tuple[int, int], float]) -> Tensor:
        image = torch.zeros_like(scene)
        for (row, column), share in places.items():
            image = image + share * edged[:, down - row : down - row + height, across - column :][..., :width]
        return image

    return torch.stack([seen(places) for places in places_passed(displacement, slots)])


def moving_object(scene: Tensor, displacement: tuple[float, float], slots: int) -> Tensor:
    """(L, H, W) → (K, L, H, W): the disc in the middle, half as wide as the shorter side, moves as in `moving_scene`
    before the scene, which stands still and is seen where the disc was."""
    height, width = scene.shape[1:]
    y, x = torch.arange(height) - (height - 1) / 2, torch.arange(width) - (width - 1) / 2
    disc = (y[:, None].square() + x.square() <= (min(height, width) / 4) ** 2).to(scene)
    seen = moving_scene(torch.cat([disc[None], disc * scene]), displacement, slots)
    return scene * (1 - seen[:, :1]) + seen[:, 1:]


def check_displacement(displacement: tuple[float, float], size: Sequence[int], where: str = "motion") -> None:
    """Raises SettingError for a displacement (rows, columns) that is as large as a scene of (H, W) pixels."""
    if not (abs(displacement[0]) < size[0] and abs(displacement[1]) < size[1]):
        kind = "" if all(map(isfinite, displacement)) else "finite numbers, "
        expected = f"{kind}less than the scene's {size[0]}×{size[1]}"
        raise SettingError(where, f"{displacement[0]:g},{displacement[1]:g}", expected)


def moving_scenes(scenes: Tensor, displacement: tuple[float, float], slots: int) -> Tensor:
    """(B, …, H, W) → (B, K, …, H, W): see ``moving_scene``, for scenes with any axes of channels or views."""
    moved = [moving_scene(one, displacement, slots) for one in scenes.flatten(1, -3)]
    return torch.stack(moved).unflatten(2, scenes.shape[1:-2])


def places_passed(displacement: tuple[float, float], slots: int) -> list[dict[tuple[int, int], float]]:
    """Displacements by whole pixels (rows, columns) in every slot, and how much of its time each has.

    Args:
        displacement: rows and columns from the beginning to the end of the exposure, pixels.
        slots: K of equal length in the exposure.
    """
    edges = [slot / slots - 0.5 for slot in range(slots + 1)]
    return [_places(displacement, *times) for times in pairwise(edges)]


def _places(displacement: tuple[float, float], start: float, end: float) -> dict[tuple[int, int], float]:
    """The same between two times, shares of the exposure.

    Between whole pixels, bilinear shares are quadratic in time: two points integrate them exactly.
    """
    crossed = {
        pixel / part
        for part in displacement
        if part
        for pixel in range(ceil(min(part * start, part * end)), floor(max(part * start, part * end)) + 1)
    }
    shares: dict[tuple[int, int], float] = defaultdict(float)
    for first, last in pairwise(sorted({start, end, *(time for time in crossed if start < time < end)})):
        for point in _GAUSS:
            y, x = (part * (first + point * (last - first)) for part in displacement)
            for row, down in ((floor(y), 1 - y % 1), (floor(y) + 1, y % 1)):
                for column, across in ((floor(x), 1 - x % 1), (floor(x) + 1, x % 1)):
                    shares[row, column] += down * across * (last - first) / (end - start) / 2
    return {place: share for place, share in shares.items() if share}
