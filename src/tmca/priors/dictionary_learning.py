"""Learning a dictionary: scikit-learn's online learner on a coreset, inside the leading subspace of its patches."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError
from tmca.priors.coreset import coreset, even_sample

_JUDGES, _SWEEPS = 2048, 200
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Learned:
    """What the learner found.

    Args:
        atoms: (K, n) unit norm, sorted by use, mean zero.
        scales: (K,) mean absolute coefficient over evenly drawn patches.
        mean: (average, standard deviation) of a patch's mean.
        residual: variance of an entry that the sparse code leaves.
        entries: mean number of coefficients of a patch.
        penalty: of the absolute coefficients, in irradiance.
    """

    atoms: Tensor
    scales: Tensor
    mean: tuple[float, float]
    residual: float
    entries: float
    penalty: float


def learn_atoms(
    cubes: Sequence[Tensor],
    patch: tuple[int, int],
    *,
    atoms: int,
    patches: int,
    rank: int,
    penalty: float,
    passes: int,
    batch: int,
    seed: int,
    progress: Progress | None = None,
) -> Learned:
    """Atoms of the patches of cubes (L, H, W), each patch less its own mean.

    Light-field patches lie close to a subspace of far fewer dimensions than they have entries: inside it the learner
    takes minutes for what would take hours.

    Raises:
        DataError: no patch that varies.
        SettingError: more patches than there are places.
    """
    told = progress or (lambda share: None)
    chosen = _centred(coreset(cubes, patch, patches, seed))
    basis = _leading(chosen, rank)
    inside = np.ascontiguousarray((chosen @ basis).numpy(), dtype=np.float64)
    if not inside.any():
        raise DataError("light fields", "no texture", "patches that vary", "learn from other scenes")
    strength = penalty * float(np.sqrt(np.square(inside).sum(1).mean()))
    told(0.1)
    found = _fit(inside, atoms, strength, passes, batch, seed, lambda share: told(0.1 + 0.8 * share))
    judges = even_sample(cubes, patch, _JUDGES, seed + 1)
    codes = _encode(np.asarray((_centred(judges) @ basis).double()), found, strength)
    told(1.0)
    return _sorted(judges, codes, torch.from_numpy(found) @ basis.double().mT, strength)


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
    inside: np.ndarray, atoms: int, penalty: float, passes: int, batch: int, seed: int, told: Progress
) -> np.ndarray:
    """(K, d) unit atoms of samples (N, d), in batches of shuffled passes."""
    from sklearn.decomposition import MiniBatchDictionaryLearning

    random = np.random.default_rng(seed)
    lengths = np.linalg.norm(inside, axis=1)
    scarce = bool(atoms > np.count_nonzero(lengths))
    first = random.choice(len(inside), atoms, replace=scarce, p=lengths / lengths.sum())
    start = inside[first] / lengths[first, None]
    learner = MiniBatchDictionaryLearning(
        atoms,
        alpha=penalty,
        batch_size=batch,
        fit_algorithm="cd",
        dict_init=start,
        random_state=seed,
        transform_max_iter=_SWEEPS,
    )
    batches = [part for _ in range(passes) for part in np.split(random.permutation(len(inside)), _cuts(inside, batch))]
    with _unfinished_codes():
        for done, part in enumerate(batches, start=1):
            learner.partial_fit(inside[part])
            told(done / len(batches))
    found = np.asarray(learner.components_, dtype=np.float64)
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12)


def _cuts(inside: np.ndarray, batch: int) -> range:
    return range(batch, len(inside), batch)


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


def _sorted(judges: Tensor, codes: Tensor, atoms: Tensor, penalty: float) -> Learned:
    """Atoms by falling use, and what evenly drawn patches need of them."""
    scales = codes.abs().mean(0)
    order = scales.argsort(descending=True, stable=True)
    centred, means = _centred(judges).double(), judges.flatten(1).mean(1).double()
    unit = atoms - atoms.mean(1, keepdim=True)
    unit = unit / torch.linalg.vector_norm(unit, dim=1, keepdim=True)
    left = (centred - codes @ atoms).square().mean()
    entries = (codes != 0).sum(1).double().mean()
    spread = (float(means.mean()), float(means.std(correction=0)))
    return Learned(unit[order], scales[order], spread, float(left), float(entries), penalty)
