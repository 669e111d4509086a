"""The explicit matrix of a small operator, and what it says: rank, condition number, coherence."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from math import prod

import numpy as np
import torch
from scipy import sparse

from tmca.errors import SettingError
from tmca.operators.linear import LinearOperator

_LARGEST = 20_000


@dataclass(frozen=True)
class Conditioning:
    """Rank, condition number and coherence of a measurement matrix.

    ``condition`` is the ratio of the largest to the smallest non-zero singular value; ``coherence`` the largest cosine
    between two different non-zero columns; ``dark_columns`` counts scene entries that the camera never sees.
    """

    rank: int
    condition: float
    coherence: float
    dark_columns: int
    shape: tuple[int, int]


def sparse_matrix(
    operator: LinearOperator, *, dtype: torch.dtype = torch.float64, batch: int = 256
) -> sparse.csr_matrix:
    """The operator as a sparse matrix, by imaging one scene entry after the other.

    Args:
        operator: any operator, at small size.
        dtype: of the probes.
        batch: probes imaged at once.

    Returns:
        (pixels of the snapshot, entries of the scene), both in C order.

    Raises:
        SettingError: the scene has more than 20 000 entries.
    """
    entries = prod(operator.scene_shape)
    if entries > _LARGEST:
        raise SettingError("explicit matrix", f"{entries} scene entries", f"at most {_LARGEST}", "use a smaller camera")
    columns = []
    with torch.no_grad():
        probe = deepcopy(operator).to("cpu", dtype)
        for start in range(0, entries, batch):
            count = min(batch, entries - start)
            unit = torch.zeros(count, entries, dtype=dtype)
            unit[torch.arange(count), start + torch.arange(count)] = 1
            image = probe.A(unit.reshape(count, *operator.scene_shape)).reshape(count, -1)
            columns.append(sparse.csr_matrix(image.numpy()).T)
    return sparse.hstack(columns).tocsr()


def conditioning(matrix: sparse.csr_matrix | np.ndarray) -> Conditioning:
    """Rank, condition number and coherence of a measurement matrix (dense singular values: small sizes)."""
    dense = np.asarray(matrix.todense()) if isinstance(matrix, sparse.csr_matrix) else np.asarray(matrix)
    singular = np.linalg.svd(dense, compute_uv=False)
    threshold = singular[0] * max(dense.shape) * np.finfo(dense.dtype).eps if singular.size else 0.0
    nonzero = singular[singular > threshold]
    norms = np.linalg.norm(dense, axis=0)
    seen = dense[:, norms > 0] / norms[norms > 0]
    cosines = np.abs(seen.T @ seen)
    np.fill_diagonal(cosines, 0)
    return Conditioning(
        rank=int(nonzero.size),
        condition=float(nonzero[0] / nonzero[-1]) if nonzero.size else float("inf"),
        coherence=float(cosines.max()) if cosines.size else 0.0,
        dark_columns=int((norms == 0).sum()),
        shape=(int(dense.shape[0]), int(dense.shape[1])),
    )
