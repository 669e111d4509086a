"""Learning a dictionary: scikit-learn's online learner on a coreset, inside the leading subspace of its patches.

The coreset is few of the many patches, chosen so that texture is not drowned out by flat ground.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, SettingError

_CORESET, _TESTED, _SWEEPS = 8000, 2048, 200
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Learned:
    """What was learned.

    Args:
        atoms: (K, n) unit norm, sorted by use, mean zero.
        scales: (K,) mean absolute coefficient over evenly drawn patches.
        residual: variance of an entry that the sparse code leaves.
        notes: settings; the penalty in irradiance, the mean number of ``entries`` of a code, ``mean`` and
            ``mean_deviation`` of the patches' means.
    """

    atoms: Tensor
    scales: Tensor
    residual: float
    notes: dict[str, Any]


@dataclass(frozen=True)
class AtomLearner:
    """Learns atoms of patches, each less its own mean.

    Light-field patches lie close to a subspace of far fewer dimensions than they have entries: inside it scikit-learn's
    ``MiniBatchDictionaryLearning`` takes minutes for what would take hours.

    Args:
        atoms: number K of atoms.
        coreset: number of patches to learn from; 8000, or as many as there are, without.
        rank: dimensions of the leading subspace in which atoms are learned.
        penalty: of the absolute coefficients while learning, as a share of the typical norm of a patch.
        passes: times that each patch is seen.
        batch: patches per step.
        seed: of the coreset and of the first atoms.

    Raises:
        SettingError: numbers below 1, or a penalty that is not above 0.
    """

    atoms: int = 1024
    coreset: int | None = None
    rank: int = 400
    penalty: float = 0.02
    passes: int = 2
    batch: int = 256
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("atoms", "coreset", "rank", "passes", "batch"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise SettingError(name, f"{value}", "at least 1")
        if not self.penalty > 0:
            raise SettingError("penalty", f"{self.penalty}", "above 0")

    def __call__(self, cubes: Sequence[Tensor], patch: tuple[int, int], progress: Progress) -> Learned:
        """Atoms of the patches (h, w) of cubes (L, H, W).

        Raises:
            DataError: no patch that varies.
            SettingError: more patches than there are places.
        """
        count = min(_CORESET, _places(cubes, patch)) if self.coreset is None else self.coreset
        chosen = _centred(coreset(cubes, patch, count, self.seed))
        basis = _leading(chosen, self.rank)
        inside = np.ascontiguousarray((chosen @ basis).numpy(), dtype=np.float64)
        if not inside.any():
            raise DataError("light fields", "no texture", "patches that vary", "learn from other scenes")
        penalty = self.penalty * float(np.sqrt(np.square(inside).sum(1).mean()))
        progress(0.1)
        atoms = self._fit(inside, penalty, lambda share: progress(0.1 + 0.8 * share))
        tested = even_sample(cubes, patch, _TESTED, self.seed + 1)
        codes = _encode(np.asarray((_centred(tested) @ basis).double()), atoms, penalty)
        progress(1.0)
        notes = asdict(self) | {"coreset": count, "penalty": penalty}
        return _sorted(tested, codes, torch.from_numpy(atoms) @ basis.double().mT, notes)

    def _fit(self, inside: np.ndarray, penalty: float, progress: Progress) -> np.ndarray:
        """(K, d) unit atoms of samples (N, d), in batches of shuffled passes."""
        from sklearn.decomposition import MiniBatchDictionaryLearning

        random = np.random.default_rng(self.seed)
        lengths = np.linalg.norm(inside, axis=1)
        scarce = bool(self.atoms > np.count_nonzero(lengths))
        first = random.choice(len(inside), self.atoms, replace=scarce, p=lengths / lengths.sum())
        learner = MiniBatchDictionaryLearning(
            self.atoms,
            alpha=penalty,
            batch_size=self.batch,
            fit_algorithm="cd",
            dict_init=inside[first] / lengths[first, None],
            random_state=self.seed,
            transform_max_iter=_SWEEPS,
        )
        cuts = range(self.batch, len(inside), self.batch)
        batches = [part for _ in range(self.passes) for part in np.split(random.permutation(len(inside)), cuts)]
        with _unfinished_codes():
            for done, part in enumerate(batches, start=1):
                learner.partial_fit(inside[part])
                progress(done / len(batches))
        atoms = np.asarray(learner.components_, dtype=np.float64)
        return atoms / np.maximum(np.linalg.norm(atoms, axis=1, keepdims=True), 1e-12)


def _centred(patches: Tensor) -> Tensor:
    flat = patches.flatten(1)
    return flat - flat.mean(1, keepdim=True)


def _leading(patches: Tensor, rank: int) -> Tensor:
    """(n, d) leading eigenvectors of the second moment of patches (N, n)."""
    most = min(rank, *patches.shape)
    if len(patches) < patches.shape[1]:
        return torch.linalg.svd(patches, full_matrices=False).Vh[:most].mT
    return torch.linalg.eigh(patches.mT @ patches).eigenvectors[:, -most:].flip(1)


def _encode(inside: np.ndarray, atoms: np.ndarray, penalty: float) -> Tensor:
    """(N, K) sparse codes."""
    from sklearn.decomposition import sparse_encode

    with _unfinished_codes():
        codes = sparse_encode(inside, atoms, algorithm="lasso_cd", alpha=penalty, max_iter=_SWEEPS)
    return torch.from_numpy(np.asarray(codes, dtype=np.float64))


@contextmanager
def _unfinished_codes() -> Iterator[None]:
    """While atoms are still moving, codes need not be exact: no warning for those that stop early."""
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


def _sorted(tested: Tensor, codes: Tensor, atoms: Tensor, notes: dict[str, Any]) -> Learned:
    """Atoms by falling use, and what evenly drawn patches need of them."""
    scales = codes.abs().mean(0)
    order = scales.argsort(descending=True, stable=True)
    centred, means = _centred(tested).double(), tested.flatten(1).mean(1).double()
    unit = atoms - atoms.mean(1, keepdim=True)
    unit = unit / torch.linalg.vector_norm(unit, dim=1, keepdim=True)
    residual = float((centred - codes @ atoms).square().mean())
    notes = notes | {"entries": float((codes != 0).sum(1).double().mean())}
    notes |= {"mean": float(means.mean()), "mean_deviation": float(means.std(correction=0))}
    return Learned(unit[order], scales[order], residual, notes)


def _places(cubes: Sequence[Tensor], patch: tuple[int, int]) -> int:
    """How many patches there are."""
    return sum((cube.shape[1] - patch[0] + 1) * (cube.shape[2] - patch[1] + 1) for cube in cubes)


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


def coreset(cubes: Sequence[Tensor], patch: tuple[int, int], count: int, seed: int, flat: float = 0.25) -> Tensor:
    """(N, L, h, w) patches drawn with probability ∝ variance + ``flat`` times the mean variance.

    A patch teaches a dictionary in proportion to what it varies by; the share for flat ones keeps them in.

    Raises:
        SettingError: fewer places than patches.
    """
    maps = [patch_variance(cube, patch) for cube in cubes]
    mean = torch.cat([values.flatten() for values in maps]).mean().clamp_min(1e-12)
    places = sample_places([values + flat * mean for values in maps], count, torch.Generator().manual_seed(seed))
    return _cut(cubes, places, patch)


def even_sample(cubes: Sequence[Tensor], patch: tuple[int, int], count: int, seed: int) -> Tensor:
    """(N, L, h, w) patches from places that are all equally likely, as many as there are at most."""
    maps = [torch.ones(cube.shape[1] - patch[0] + 1, cube.shape[2] - patch[1] + 1) for cube in cubes]
    places = sample_places(maps, min(count, _places(cubes, patch)), torch.Generator().manual_seed(seed))
    return _cut(cubes, places, patch)
