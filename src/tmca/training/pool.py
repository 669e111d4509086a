"""First estimates of a pool of patches: where codes stay as they are, each is computed once and used again."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tmca.data import atomic_path, make_folder

_DRAWS = 5
"""Stream of random numbers: which patches of the pool make a batch."""


@dataclass(frozen=True)
class Pool:
    """Patches that are used again and again, in groups that share a window of the code and a sensor.

    Args:
        groups: in all.
        size: patches of a group.
        seed: of the run.
        first: random numbers of group g are those of step ``first + g``, which the run does not reach.
    """

    groups: int
    size: int
    seed: int
    first: int

    @classmethod
    def of(cls, patches: int, batch: int, sensors: int, seed: int, steps: int) -> Pool:
        """At least ``patches`` patches, in groups of four batches, as many for each sensor."""
        size = 4 * batch
        return cls(max(1, -(-patches // (size * sensors))) * sensors, size, seed, -(-steps // sensors) * sensors)

    def draw(self, step: int, indexes: Sequence[int]) -> tuple[int, list[int]]:
        """The group of a step, as a step of its own, and its patches at these places of the batch."""
        rng = np.random.default_rng((self.seed, _DRAWS, step))
        group, places = int(rng.integers(self.groups)), rng.permutation(self.size)
        return self.first + group, [int(places[index]) for index in indexes]


class CachedStarts:
    """First estimates of whole groups, in half precision, one ``.npy`` each; they may be deleted at any time.

    Args:
        folder: of the files.
        compute: from a group's step to the first estimates (patches, L, h, w) of its patches.
    """

    def __init__(self, folder: Path, compute: Callable[[int], Tensor]) -> None:
        self.folder, self.compute = folder, compute

    def __call__(self, step: int, places: Sequence[int]) -> Tensor:
        """(B, L, h, w) first estimates of some patches of a group."""
        file = make_folder(self.folder) / f"{step:07d}.npy"
        if not file.exists():
            values = self.compute(step).half().numpy(force=True)
            with atomic_path(file, overwrite=True) as temporary, temporary.open("wb") as handle:
                np.save(handle, values)
        return torch.from_numpy(np.load(file, mmap_mode="r")[list(places)].astype(np.float32))

    def delete(self) -> None:
        """Delete the files."""
        shutil.rmtree(self.folder, ignore_errors=True)
