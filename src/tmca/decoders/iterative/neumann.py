"""The step of ADMM that the discrete cosine transform makes diagonal: ``(shift·I + ∇ᵀ∇) x = b``."""

from __future__ import annotations

import math

import scipy.fft
import torch
from torch import Tensor


def cosines(size: int, like: Tensor) -> Tensor:
    """Orthonormal DCT-II matrix (size, size), one frequency per row."""
    index = torch.arange(size, dtype=torch.float64)
    matrix = torch.cos(math.pi / size * torch.outer(index, index + 0.5)) * math.sqrt(2 / size)
    matrix[0] /= math.sqrt(2)
    return matrix.to(like)


def _eigenvalues(size: int) -> Tensor:
    return 2 - 2 * torch.cos(math.pi / size * torch.arange(size, dtype=torch.float64))


class NeumannSolver:
    """Solves ``(shift·I + ∇ᵀ∇) x = b`` with the gradient of `tmca.decoders.iterative.tv`, exactly.

    The DCT-II diagonalises ∇ᵀ∇ (forward differences, Neumann boundary) with the eigenvalues 2 − 2 cos(πk/N)
    per axis (Strang 1999). On the CPU the transform is SciPy's, elsewhere two matrix products.

    Args:
        like: (…, H, W) tensor whose size, type and device the right-hand sides have.
        shift: > 0.
        by_matrices: transform by matrix products, by default wherever the tensors are not on the CPU.
    """

    def __init__(self, like: Tensor, shift: float, *, by_matrices: bool | None = None) -> None:
        height, width = like.shape[-2:]
        eigenvalues = _eigenvalues(height)[:, None] + _eigenvalues(width)
        self.response = (1 / (shift + eigenvalues)).to(like)
        by_matrices = like.device.type != "cpu" if by_matrices is None else by_matrices
        self.matrices = (cosines(height, like), cosines(width, like)) if by_matrices else None

    def __call__(self, right: Tensor) -> Tensor:
        """x (…, H, W) for the right-hand side b of that shape, whose values may be overwritten."""
        if self.matrices is not None:
            rows, columns = self.matrices
            return rows.mT @ ((rows @ right @ columns.mT) * self.response) @ columns
        axes = {"axes": (-2, -1), "norm": "ortho", "overwrite_x": True}
        spectrum = torch.from_numpy(scipy.fft.dctn(right.numpy(), **axes))
        return torch.from_numpy(scipy.fft.idctn(spectrum.mul_(self.response).numpy(), **axes))
