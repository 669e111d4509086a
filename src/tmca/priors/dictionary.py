"""An overcomplete dictionary of light-field patches: a patch is its mean and a sum of few atoms.

It is learned by scikit-learn's online learner on a coreset, inside the leading subspace of its patches. The coreset is
few of the many patches, chosen so that texture is not drowned out by flat ground.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, Json
from torch import Tensor

from tmca.attributes import Attributes, FiniteJson
from tmca.errors import DataError, SettingError, ShapeError, check_range
from tmca.priors.learning import PATCH
from tmca.priors.prior import Prior
from tmca.priors.statistics import checked_cubes

_Side = Annotated[int, Field(ge=1)]
_CORESET, _TESTED, _SWEEPS = 8000, 2048, 200


class DictionaryAttributes(Attributes):
    """What the file of a dictionary says."""

    views: tuple[_Side, _Side]
    residual: float = Field(ge=0)
    notes: Json[dict[str, FiniteJson]]


@dataclass(frozen=True, eq=False, repr=False)
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
    of_views: ClassVar[bool] = True
    of_rendered: ClassVar[bool] = False
    learned_by: ClassVar[str] = "`tmca prior learn-views … --dictionary --out …`"
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]] = {"atom": ("number", "view", "y", "x"), "scale": ("number",)}
    meanings: ClassVar[Mapping[str, str]] = {
        "atom": "atoms of unit norm, the most used first",
        "scale": "mean absolute coefficient of an atom, relative irradiance",
    }
    wavelengths: ClassVar[None] = None
    stated: ClassVar[type[Attributes]] = DictionaryAttributes
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
        atoms: int = 1024,
        coreset: int | None = None,
        rank: int = 400,
        penalty: float = 0.02,
        passes: int = 2,
        batch: int = 256,
        seed: int = 0,
    ) -> Self:
        """The dictionary of the patches (h, w) of light fields (V·U, H, W), each patch less its own mean.

        Light-field patches lie close to a subspace of far fewer dimensions than they have entries: inside it
        ``MiniBatchDictionaryLearning`` takes minutes for what would take hours.

        Args:
            views: (V, U), row by row.
            progress: called with the share that is done.
            atoms: number K of atoms.
            coreset: number of patches to learn from; 8000, or as many as there are, without.
            rank: dimensions of the leading subspace in which atoms are learned.
            penalty: of the absolute coefficients while learning, as a share of the typical norm of a patch.
            passes: times that each patch is seen.
            batch: patches per step.
            seed: of the coreset and of the first atoms.

        Raises:
            DataError: no patch that varies.
            SettingError: impossible numbers, or more patches than there are places.
        """
        notes = {"atoms": atoms, "coreset": coreset, "rank": rank, "passes": passes, "batch": batch}
        for name, value in notes.items():
            check_range(name, 1 if value is None else value, 1)
        check_range("penalty", penalty, above=0)
        examples, report = checked_cubes(cubes, patch, views), progress or (lambda share: None)
        chosen = _centred(textured_sample(examples, patch, coreset, seed))
        basis = _leading(chosen, rank)
        inside = np.ascontiguousarray((chosen @ basis).numpy(), dtype=np.float64)
        if not inside.any():
            raise DataError("light fields", "no texture", "patches that vary", "learn from other scenes")
        penalty *= float(np.sqrt(np.square(inside).sum(1).mean()))
        report(0.1)
        learned = _fit(inside, atoms, penalty, passes, batch, seed, lambda share: report(0.1 + 0.8 * share))
        tested = even_sample(examples, patch, _TESTED, seed + 1)
        codes = _encode(np.asarray((_centred(tested) @ basis).double()), learned, penalty)
        report(1.0)
        scales, full = codes.abs().mean(0), torch.from_numpy(learned) @ basis.double().mT
        order = scales.argsort(descending=True, stable=True)
        unit = torch.nn.functional.normalize(_centred(full), dim=1)[order].unflatten(1, examples[0].shape[:1] + patch)
        residual = float((_centred(tested).double() - codes @ full).square().mean())
        means = tested.flatten(1).mean(1).double()
        about = {**notes, "coreset": len(chosen), "penalty": penalty, "seed": seed}
        about |= {"entries": float((codes != 0).sum(1).double().mean())}
        about |= {"mean": float(means.mean()), "mean_deviation": float(means.std(correction=0))}
        return cls(unit, scales[order], views, residual, tuple(sources), about)

    def sample(self, count: int, seed: int) -> Tensor:
        """(count, L, h, w) random blocks: Laplacian coefficients, which the LASSO has in mind, around random means."""
        check_range("count", count, 1, whole=True)
        generator = torch.Generator().manual_seed(seed)
        uniform = torch.rand(count, len(self.atoms), generator=generator, dtype=torch.float64) - 0.5
        codes = -self.scales * uniform.sign() * (1 - 2 * uniform.abs()).log()
        means = torch.randn(count, generator=generator, dtype=torch.float64) * self.notes.get("mean_deviation", 0.0)
        means = means + self.notes.get("mean", 0.0)
        return (codes @ self.atoms.flatten(1)).reshape(count, *self.block) + means[:, None, None, None]

    def figure(self) -> Any:
        """The most used atoms as mosaics of their views."""
        from tmca.plots.priors import dictionary_figure

        return dictionary_figure(self.atoms.numpy(), self.scales.numpy(), self.views)

    def arrays(self) -> dict[str, Tensor]:
        return {"atom": self.atoms.float(), "scale": self.scales}  # atoms in single precision

    def attributes(self) -> dict[str, Any]:
        return {"views": list(self.views), "residual": self.residual, "notes": json.dumps(self.notes)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        atoms = arrays["atom"]
        atoms = torch.nn.functional.normalize(atoms.flatten(1), dim=1).reshape(atoms.shape)
        return cls(atoms, arrays["scale"], about["views"], about["residual"], about["sources"], about["notes"])


def _centred(patches: Tensor) -> Tensor:
    flat = patches.flatten(1)
    return flat - flat.mean(1, keepdim=True)


def _leading(patches: Tensor, rank: int) -> Tensor:
    """(n, d) leading eigenvectors of the second moment of patches (N, n)."""
    most = min(rank, *patches.shape)
    if len(patches) < patches.shape[1]:
        return torch.linalg.svd(patches, full_matrices=False).Vh[:most].mT
    return torch.linalg.eigh(patches.mT @ patches).eigenvectors[:, -most:].flip(1)


def _fit(
    inside: NDArray[np.float64],
    atoms: int,
    penalty: float,
    passes: int,
    batch: int,
    seed: int,
    progress: Callable[[float], None],
) -> NDArray[np.float64]:
    """(K, d) unit atoms of samples (N, d), in batches of shuffled passes."""
    from sklearn.decomposition import MiniBatchDictionaryLearning
    from sklearn.exceptions import ConvergenceWarning

    generator = np.random.default_rng(seed)
    lengths = np.linalg.norm(inside, axis=1)
    scarce = bool(atoms > np.count_nonzero(lengths))
    first = generator.choice(len(inside), atoms, replace=scarce, p=lengths / lengths.sum())
    learner = MiniBatchDictionaryLearning(
        atoms, alpha=penalty, batch_size=batch, fit_algorithm="cd", dict_init=inside[first] / lengths[first, None],
        random_state=seed, transform_max_iter=_SWEEPS,
    )  # fmt: skip
    cuts = range(batch, len(inside), batch)
    batches = [part for _ in range(passes) for part in np.split(generator.permutation(len(inside)), cuts)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # codes need not be exact while atoms are still moving
        for done, part in enumerate(batches, start=1):
            learner.partial_fit(inside[part])
            progress(done / len(batches))
    learned = np.asarray(learner.components_, dtype=np.float64)
    return learned / np.maximum(np.linalg.norm(learned, axis=1, keepdims=True), 1e-12)


def _encode(inside: NDArray[np.float64], atoms: NDArray[np.float64], penalty: float) -> Tensor:
    """(N, K) sparse codes."""
    from sklearn.decomposition import sparse_encode
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        codes = sparse_encode(inside, atoms, algorithm="lasso_cd", alpha=penalty, max_iter=_SWEEPS)
    return torch.from_numpy(np.asarray(codes, dtype=np.float64))


def patch_variance(cube: Tensor, patch: tuple[int, int]) -> Tensor:
    """(H - h + 1, W - w + 1) variance of all entries of the patch (L, h, w) at each place of a cube (L, H, W)."""
    pool = torch.nn.functional.avg_pool2d
    first, second = (
        pool(values[None, None], patch, stride=1)[0, 0] for values in (cube.mean(0), cube.square().mean(0))
    )
    return (second - first.square()).clamp_min(0)


def sample_places(maps: Sequence[Tensor], count: int, generator: torch.Generator) -> list[tuple[int, int, int]]:
    """``count`` different places (map, row, column), drawn with probability in proportion to the maps.

    Raises:
        SettingError: fewer places than asked for.
    """
    most = sum(values.numel() for values in maps)
    if not 1 <= count <= most:
        raise SettingError("coreset", f"{count} patches", f"1 to {most}, the places there are", "take fewer patches")
    weights = torch.cat([values.flatten() for values in maps]).double()
    uniform = torch.rand(most, generator=generator, dtype=torch.float64).clamp_min(1e-300)
    # the largest of log p + Gumbel noise are a draw without replacement
    drawn = (weights.log() - (-uniform.log()).log()).topk(count).indices
    ends = torch.tensor([values.numel() for values in maps]).cumsum(0)
    which = torch.bucketize(drawn, ends, right=True)
    inside = drawn - torch.nn.functional.pad(ends, (1, 0))[which]
    return [(i, *divmod(p, maps[i].shape[1])) for i, p in zip(which.tolist(), inside.tolist(), strict=True)]


def _cut(cubes: Sequence[Tensor], places: Sequence[tuple[int, int, int]], patch: tuple[int, int]) -> Tensor:
    """(N, L, h, w) patches at the places, single precision."""
    h, w = patch
    return torch.stack([cubes[i][:, y : y + h, x : x + w].float() for i, y, x in places])


def textured_sample(
    cubes: Sequence[Tensor], patch: tuple[int, int], count: int | None, seed: int, flat: float = 0.25
) -> Tensor:
    """(N, L, h, w) patches drawn with probability ∝ variance + ``flat`` times the mean variance.

    A patch teaches a dictionary in proportion to what it varies by; the share for flat ones keeps them in.

    Raises:
        SettingError: fewer places than patches.
    """
    maps = [patch_variance(cube, patch) for cube in cubes]
    every = torch.cat([values.flatten() for values in maps])
    count = min(_CORESET, len(every)) if count is None else count
    maps = [values + flat * every.mean().clamp_min(1e-12) for values in maps]
    return _cut(cubes, sample_places(maps, count, torch.Generator().manual_seed(seed)), patch)


def even_sample(cubes: Sequence[Tensor], patch: tuple[int, int], count: int, seed: int) -> Tensor:
    """(N, L, h, w) patches from places that are all equally likely, as many as there are at most."""
    maps = [torch.ones(cube.shape[1] - patch[0] + 1, cube.shape[2] - patch[1] + 1) for cube in cubes]
    count = min(count, sum(values.numel() for values in maps))
    return _cut(cubes, sample_places(maps, count, torch.Generator().manual_seed(seed)), patch)
