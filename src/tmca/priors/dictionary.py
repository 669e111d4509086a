"""An overcomplete dictionary of light-field patches: a patch is its mean and a sum of few atoms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.priors.statistics import scenes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CORESET = 8000


@dataclass(frozen=True)
class PatchDictionary:
    """Patches x of shape (L, h, w) as ``mean + Σ_k c_k atom_k`` with few coefficients c (Marwah et al. 2013).

    It is overcomplete in the leading subspace that atoms are learned in (400 dimensions by default), not in all 3025
    entries of a patch of 11×11×5×5.

    Atoms have mean zero: the mean of a patch is a coefficient of its own, that of a constant atom, and is not
    counted as sparse.

    Args:
        atoms: (K, L, h, w), unit norm, sorted by use, float64.
        scales: (K,) mean absolute coefficient of each atom over example patches, relative irradiance.
        views: (V, U) grid of the L = V·U views.
        residual: variance of an entry that sparse codes leave, relative irradiance squared.
        sources: names of the light fields it was learned from.
        notes: how it was learned, plain JSON types.
    """

    atoms: Tensor
    scales: Tensor
    views: tuple[int, int]
    residual: float = 0.0
    sources: tuple[str, ...] = ()
    notes: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.atoms.ndim != 4 or self.scales.shape != self.atoms.shape[:1]:
            found = f"atoms {tuple(self.atoms.shape)}, scales {tuple(self.scales.shape)}"
            raise ShapeError("dictionary", found, "(K, L, h, w) and (K,)")
        if self.views[0] * self.views[1] != self.atoms.shape[1]:
            raise ShapeError("dictionary", f"{self.views} views", f"a grid of {self.atoms.shape[1]}")

    @property
    def block(self) -> tuple[int, int, int]:
        """(L, h, w)."""
        _, channels, rows, columns = self.atoms.shape
        return channels, rows, columns

    @classmethod
    def learn(
        cls,
        light_fields: Sequence[Tensor],
        patch: tuple[int, int] = (11, 11),
        *,
        atoms: int = 1024,
        coreset: int | None = None,
        rank: int = 400,
        penalty: float = 0.02,
        passes: int = 2,
        batch: int = 256,
        seed: int = 0,
        sources: Sequence[str] = (),
        progress: Callable[[float], None] | None = None,
    ) -> PatchDictionary:
        """The dictionary of the patches of light fields (V, U, H, W), which may differ in size.

        A coreset of patches, chosen by variance, is given to scikit-learn's ``MiniBatchDictionaryLearning``.

        Args:
            patch: (h, w) pixels.
            atoms: number K of atoms.
            coreset: number of patches to learn from; 8000, or as many as there are, without.
            rank: dimensions of the leading subspace in which atoms are learned.
            penalty: of the absolute coefficients while learning, as a share of the typical norm of a patch.
            passes: times that each patch is seen.
            batch: patches per step.
            seed: of the coreset and of the first atoms.
            sources: names to keep.
            progress: told the share that is done.

        Raises:
            ShapeError: no light field, other view grids, or a patch larger than a light field.
            DataError: values that are not finite.
            SettingError: impossible numbers, or more patches than there are places.
        """
        from tmca.priors.dictionary_learning import learn_atoms

        views = _common_views(light_fields)
        cubes = scenes((field.flatten(0, 1) for field in light_fields), patch)
        coreset = min(_CORESET, _places(cubes, patch)) if coreset is None else coreset
        counts = {"atoms": atoms, "coreset": coreset, "rank": rank, "passes": passes, "batch": batch}
        _check(counts, penalty)
        found = learn_atoms(
            cubes,
            patch,
            atoms=atoms,
            patches=coreset,
            rank=rank,
            penalty=penalty,
            passes=passes,
            batch=batch,
            seed=seed,
            progress=progress,
        )
        notes = counts | {"seed": seed, "penalty": found.penalty, "entries": found.entries}
        notes |= {"mean": found.mean[0], "mean_deviation": found.mean[1]}
        shape = (atoms, cubes[0].shape[0], *patch)
        return cls(found.atoms.reshape(shape), found.scales, views, found.residual, tuple(sources), notes)

    def to(self, device: torch.device | str) -> PatchDictionary:
        """The dictionary on a device; itself if it is there."""
        if self.atoms.device == torch.device(device):
            return self
        return replace(self, atoms=self.atoms.to(device), scales=self.scales.to(device))

    def figure(self, atoms: int = 48) -> Figure:
        """The most used atoms as mosaics of their views."""
        from tmca.plots.priors import dictionary_figure

        return dictionary_figure(self.atoms.numpy(), self.scales.numpy(), self.views, atoms)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the dictionary as NetCDF4, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.priors.files import write_dictionary

        return write_dictionary(path, self, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> PatchDictionary:
        """Read a dictionary that ``save`` wrote.

        Raises:
            DataError: no such file, no dictionary in it, or damaged content.
        """
        from tmca.priors.files import read_dictionary

        return read_dictionary(path)


def _check(counts: dict[str, int], penalty: float) -> None:
    for name, value in counts.items():
        if value < 1:
            raise SettingError(name, f"{value}", "at least 1")
    if not penalty > 0:
        raise SettingError("penalty", f"{penalty}", "above 0")


def _common_views(light_fields: Sequence[Tensor]) -> tuple[int, int]:
    """(V, U) of light fields (V, U, H, W) that share it."""
    if not light_fields:
        raise ShapeError("light fields", "none", "at least one (V, U, H, W)")
    for i, values in enumerate(light_fields):
        first = tuple(light_fields[0].shape[:2])
        if values.ndim != 4 or tuple(values.shape[:2]) != first:
            raise ShapeError(f"light field {i}", f"{tuple(values.shape)}", f"(V, U, H, W) with (V, U) = {first}")
    return int(light_fields[0].shape[0]), int(light_fields[0].shape[1])


def _places(cubes: Sequence[Tensor], patch: tuple[int, int]) -> int:
    """How many patches there are."""
    return sum((cube.shape[1] - patch[0] + 1) * (cube.shape[2] - patch[1] + 1) for cube in cubes)
