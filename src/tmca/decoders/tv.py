"""Isotropic total variation of cubes: value, gradient and divergence, proximal operator, solver of its ADMM step.

Finite differences are forward, with the last one zero (Neumann boundary). ``joint=False`` sums the variation
of every band; ``joint=True`` is the vectorial variation of Bresson and Chan (2008), whose gradient norm runs
over both axes and all bands, so that the edges of all bands fall together.
"""

from __future__ import annotations

import math

import scipy.fft
import torch
from torch import Tensor
from torch.nn.functional import pad

from tmca.errors import SettingError, ShapeError

_LARGEST_LAPLACIAN = 8.0  # bound on the eigenvalues of ∇ᵀ∇ in two dimensions


def gradient(cube: Tensor, out: Tensor | None = None) -> Tensor:
    """Forward differences along y and x.

    Args:
        cube: (B, L, H, W).
        out: (2, B, L, H, W) to write to.

    Returns:
        (2, B, L, H, W), differences along H first; zero in the last row and the last column respectively.
    """
    if out is None:
        pads = ((0, 0, 0, 1), (0, 1))
        return torch.stack([pad(cube.diff(dim=axis), room) for axis, room in zip((-2, -1), pads, strict=True)])
    torch.sub(cube[..., 1:, :], cube[..., :-1, :], out=out[0, ..., :-1, :])
    torch.sub(cube[..., 1:], cube[..., :-1], out=out[1, ..., :-1])
    out[0, ..., -1, :] = 0
    out[1, ..., -1] = 0
    return out


def divergence(field: Tensor, out: Tensor | None = None) -> Tensor:
    """The negative adjoint of `gradient`: ``⟨∇x, p⟩ = −⟨x, div p⟩`` for every x and p.

    Args:
        field: (2, B, L, H, W).
        out: (B, L, H, W) to write to.
    """
    rows, columns = field[0, ..., :-1, :], field[1, ..., :-1]
    div = torch.empty_like(field[0]) if out is None else out
    div[..., :-1, :] = rows
    div[..., -1, :] = 0
    div[..., 1:, :] -= rows
    div[..., :-1] += columns
    div[..., 1:] -= columns
    return div


def field_norm(field: Tensor, joint: bool = False) -> Tensor:
    """Length of the gradient at every pixel: (B, L, H, W), or (B, 1, H, W) over all bands if ``joint``."""
    if not joint:
        return (field[0] * field[0]).addcmul_(field[1], field[1]).sqrt_()
    energy = torch.zeros_like(field[0, :, :1])
    for band in field.transpose(1, 2).flatten(0, 1):  # a running sum needs no other cube
        energy[:, 0].addcmul_(band, band)
    return energy.sqrt_()


def total_variation(cube: Tensor, joint: bool = False) -> Tensor:
    """Isotropic total variation of every cube of a batch.

    Args:
        cube: (B, L, H, W).
        joint: one gradient norm over all bands instead of one per band.

    Returns:
        (B,) sums over pixels (and bands, unless joint), in the units of the cube; differentiable, with
        derivative zero where the cube is flat.
    """
    if cube.ndim != 4:
        raise ShapeError("cube", f"shape {tuple(cube.shape)}", "(B, L, H, W)")
    norm = torch.linalg.vector_norm(gradient(cube), dim=(0, 2) if joint else (0,))
    return norm.flatten(1).sum(1)


def project(field: Tensor, radius: float, joint: bool = False, out: Tensor | None = None) -> Tensor:
    """Projection of a (2, B, L, H, W) field onto lengths up to ``radius``."""
    norm = field_norm(field, joint).clamp_min_(max(radius, torch.finfo(field.dtype).tiny))
    return torch.mul(field, norm.reciprocal_().mul_(radius), out=out)


@torch.no_grad()
def tv_prox(
    cube: Tensor, weight: float, joint: bool = False, *, max_iterations: int = 200, tolerance: float = 1e-4
) -> Tensor:
    """Total-variation denoising, ``argmin_x ½‖x − cube‖² + weight · TV(x)``.

    Fast gradient projection on the dual (Beck and Teboulle 2009).

    Args:
        cube: (B, L, H, W).
        weight: weight of the total variation, ≥ 0, in the units of the cube.
        joint: one gradient norm over all bands instead of one per band.
        max_iterations: most steps taken.
        tolerance: stop when a step changes the estimate by less than this share of its norm.

    Raises:
        SettingError: a negative weight or fewer than one iteration.
    """
    if not (weight >= 0 and math.isfinite(weight)):
        raise SettingError("weight", f"{weight}", "a finite number ≥ 0")
    if max_iterations < 1:
        raise SettingError("max_iterations", f"{max_iterations}", "at least 1")
    dual = cube.new_zeros((2, *cube.shape))
    ahead, step, estimate = dual.clone(), 1.0, cube
    for _ in range(max_iterations):
        ascent = ahead + gradient(cube + divergence(ahead)) / _LARGEST_LAPLACIAN
        ascent = project(ascent, weight, joint)
        step_next = (1 + math.sqrt(1 + 4 * step**2)) / 2
        ahead = ascent + (ascent - dual) * ((step - 1) / step_next)
        dual, step, previous = ascent, step_next, estimate
        estimate = cube + divergence(dual)
        if torch.linalg.vector_norm(estimate - previous) <= tolerance * torch.linalg.vector_norm(estimate):
            break
    return estimate


def cosines(size: int, like: Tensor) -> Tensor:
    """Orthonormal DCT-II matrix (size, size), one frequency per row."""
    index = torch.arange(size, dtype=torch.float64)
    matrix = torch.cos(math.pi / size * torch.outer(index, index + 0.5)) * math.sqrt(2 / size)
    matrix[0] /= math.sqrt(2)
    return matrix.to(like)


def _eigenvalues(size: int) -> Tensor:
    return 2 - 2 * torch.cos(math.pi / size * torch.arange(size, dtype=torch.float64))


class NeumannSolver:
    """Solves ``(shift·I + ∇ᵀ∇) x = b`` with the gradient of this file, exactly.

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
