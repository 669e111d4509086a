"""Which scenes a run learns from, which it checks itself on, which it leaves alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tmca.data.scene_names import named_scenes
from tmca.errors import SettingError
from tmca.training.settings import DataSettings

RENDERED = ("rendered",)
"""In the place of a prior's scenes: the prior of the rendered scenes."""


@dataclass(frozen=True)
class SceneLists:
    """Names of scenes that ``load_scene`` understands."""

    train: tuple[str, ...]
    validation: tuple[str, ...]
    test: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()


def scene_lists(data: DataSettings, seed: int) -> SceneLists:
    """The lists that the settings name; without validation scenes, shares of the training scenes drawn at random.

    A scene that is named several times is learned from as often, and drawn once. The prior leaves drawn scenes out.

    Raises:
        SettingError: no training scenes, or a scene of training or prior that is also a validation scene.
        DataError: a split that cannot be read, or a scene of it that is missing or altered.
    """
    train, validation, prior = (named_scenes(part) for part in (data.train, data.validation, data.prior))
    if not train:
        raise SettingError("data.train", "no scenes", "cubes, rendered scenes or a split file", "pass --train")
    _check_apart((*train, *prior), validation)
    different = list({place_of(name): name for name in train})
    if validation or len(different) < 3:
        return SceneLists(train, validation, prior=prior)
    order = np.random.default_rng(seed).permutation(len(different))
    counts = np.array(data.shares) / sum(data.shares) * len(different)
    first = max(1, round(counts[0]))
    second = min(len(different), first + max(1, round(counts[1])))
    learned, checked, test = ({different[i] for i in part} for part in np.split(order, [first, second]))
    checked_names, test_names = (
        tuple(dict.fromkeys(name for name in train if place_of(name) in part)) for part in (checked, test)
    )
    left = tuple(name for name in prior if place_of(name) not in checked | test)
    if prior and not left:
        raise SettingError("data.prior", "only scenes drawn for validation", "others", "pass --validation")
    return SceneLists(tuple(name for name in train if place_of(name) in learned), checked_names, test_names, left)


def _check_apart(learned: Sequence[str], checked: Sequence[str]) -> None:
    both = sorted({place_of(name) for name in learned} & {place_of(name) for name in checked})
    if both:
        raise SettingError("data.validation", f"{both[0]}, a training scene", "other scenes")


def place_of(name: str) -> str:
    """Where a scene lies, however its file is named; the name of a rendered one."""
    return str(Path(name).resolve()) if Path(name).exists() else name
