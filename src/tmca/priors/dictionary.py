"""An overcomplete dictionary of light-field patches: a patch is its mean and a sum of few atoms."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

import torch
from torch import Tensor

from tmca.errors import ShapeError
from tmca.priors.dictionary_learning import AtomLearner
from tmca.priors.prior import Prior
from tmca.priors.statistics import scenes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PATCH = (11, 11)
"""Rows and columns of patches where none are given."""


@dataclass(frozen=True)
class PatchDictionary(Prior):
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

    kind: ClassVar[str] = "dictionary"
    called: ClassVar[str] = "a dictionary"
    argument: ClassVar[str] = "dictionary"
    learned_by: ClassVar[str] = "`tmca prior learn-views … --dictionary --out …`"
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]] = {"atom": ("number", "view", "y", "x"), "scale": ("number",)}
    wavelengths: ClassVar[None] = None
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
        cubes: Iterable[Tensor],
        patch: tuple[int, int] = PATCH,
        *,
        views: tuple[int, int],
        sources: Sequence[str] = (),
        progress: Callable[[float], None] | None = None,
        **settings: Any,
    ) -> Self:
        """The dictionary of the patches of light fields (V·U, H, W), which may differ in size.

        Args:
            patch: (h, w) pixels.
            views: (V, U), row by row.
            sources: names to keep.
            progress: called with the share that is done.
            settings: of ``AtomLearner``.

        Raises:
            ShapeError: no light field, other views, or a patch larger than a light field.
            DataError: values that are not finite, or no patch that varies.
            SettingError: impossible numbers, or more patches than there are places.
        """
        examples, learner = scenes(cubes, patch, views), AtomLearner(**settings)
        learned = learner(examples, patch, progress or (lambda share: None))
        atoms = learned.atoms.reshape(len(learned.atoms), len(examples[0]), *patch)
        return cls(atoms, learned.scales, views, learned.residual, tuple(sources), learned.notes)

    def sample(self, count: int, seed: int) -> Tensor:
        """(count, L, h, w) random blocks: Laplacian coefficients, which the LASSO has in mind, around random means."""
        generator = torch.Generator().manual_seed(seed)
        uniform = torch.rand(count, len(self.atoms), generator=generator, dtype=torch.float64) - 0.5
        codes = -self.scales * uniform.sign() * (1 - 2 * uniform.abs()).log()
        means = torch.randn(count, generator=generator, dtype=torch.float64) * self.notes.get("mean_deviation", 0.0)
        means = means + self.notes.get("mean", 0.0)
        return (codes @ self.atoms.flatten(1)).reshape(count, *self.block) + means[:, None, None, None]

    def figure(self, atoms: int = 48) -> Figure:
        """The most used atoms as mosaics of their views."""
        from tmca.plots.priors import dictionary_figure

        return dictionary_figure(self.atoms.numpy(), self.scales.numpy(), self.views, atoms)

    def arrays(self) -> dict[str, Tensor]:
        """Atoms, in single precision, and scales."""
        return {"atom": self.atoms.float(), "scale": self.scales}

    def attributes(self) -> dict[str, Any]:
        """Views, residual and notes."""
        return {"views": list(self.views), "residual": self.residual, "notes": json.dumps(self.notes)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        """The dictionary of a file."""
        atoms, notes = arrays["atom"], json.loads(about["notes"])
        atoms = torch.nn.functional.normalize(atoms.flatten(1), dim=1).reshape(atoms.shape)
        v, u = (int(number) for number in about["views"])
        return cls(atoms, arrays["scale"], (v, u), float(about["residual"]), about["sources"], notes)
