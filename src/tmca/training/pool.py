"""First estimates of a pool of patches: where codes stay as they are, each is computed once and used again."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.data import make_folder
from tmca.training.patches import cached_array

_DRAWS = 5
"""Stream of random numbers: which patches of the pool make a batch."""


@dataclass(frozen=True)
class Pool:
    """Patches that are used again and again, in groups that share a window of the code and a sensor.

    Their first estimates are cached in half precision, one ``.npy`` a group, which may be deleted at any time.

    Args:
        groups: in all.
        size: patches of a group.
        seed: of the run.
        first: random numbers of group g are those of step ``first + g``, which the run does not reach.
        folder: of the files.
        compute: from a group's step and places to the first estimates (patches, L, h, w) of its patches.
    """

    groups: int
    size: int
    seed: int
    first: int
    folder: Path
    compute: Callable[[int, Sequence[int]], Tensor]

    @classmethod
    def of(cls, patches: int, batch: int, sensors: int, steps: int, **parts: Any) -> Pool:
        """At least ``patches`` patches, in groups of four batches, as many for each sensor."""
        size = 4 * batch
        return cls(
            max(1, -(-patches // (size * sensors))) * sensors, size, first=-(-steps // sensors) * sensors, **parts
        )

    def draw(self, step: int, indexes: Sequence[int]) -> tuple[int, list[int]]:
        """The group of a step, as a step of its own, and its patches at these places of the batch."""
        rng = np.random.default_rng((self.seed, _DRAWS, step))
        group, places = int(rng.integers(self.groups)), rng.permutation(self.size)
        return self.first + group, [int(places[index]) for index in indexes]

    def starts(self, step: int, places: Sequence[int]) -> Tensor:
        """(B, L, h, w) first estimates of some patches of a group."""
        file = make_folder(self.folder) / f"{step:07d}.npy"
        whole = cached_array(file, lambda: self.compute(step, range(self.size)).half().numpy(force=True))
        return torch.from_numpy(whole[list(places)].astype(np.float32))

    def delete(self) -> None:
        """Delete the files."""
        shutil.rmtree(self.folder, ignore_errors=True)
