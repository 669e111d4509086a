"""Isotropic total variation of cubes: value, gradient and proximal operator.

Finite differences are forward, with the last one zero (Neumann boundary). ``joint=False`` sums the variation
of every band; ``joint=True`` is the vectorial variation of Bresson and Chan (2008), whose gradient norm runs
over both axes and all bands, so that the edges of all bands fall together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import pad

from tmca.decoders.least_squares import check_iteration
from tmca.errors import check_range, check_shape

LARGEST_LAPLACIAN = 8.0
"""Bound on the eigenvalues of ∇ᵀ∇ in two dimensions."""


def gradient(cube: Tensor) -> Tensor:
    """Forward differences (2, B, L, H, W) of a cube (B, L, H, W), along H first; zero in the last row or column."""
    rows, columns = pad(cube.diff(dim=-2), (0, 0, 0, 1)), pad(cube.diff(dim=-1), (0, 1))
    return torch.stack((rows, columns))


def add_gradient(field: Tensor, cube: Tensor, factor: float = 1.0) -> Tensor:
    """A field (2, B, L, H, W) that a factor times the gradient of a cube is added to, in place."""
    rows, columns = field[0, ..., :-1, :], field[1, ..., :-1]
    rows.add_(cube[..., 1:, :], alpha=factor).sub_(cube[..., :-1, :], alpha=factor)
    columns.add_(cube[..., 1:], alpha=factor).sub_(cube[..., :-1], alpha=factor)
    return field


def divergence(field: Tensor) -> Tensor:
    """The negative adjoint of `gradient`, (2, B, L, H, W) → (B, L, H, W): ``⟨∇x, p⟩ = −⟨x, div p⟩``."""
    return add_adjoint(torch.zeros_like(field[0]), field).neg_()


def add_adjoint(cube: Tensor, field: Tensor) -> Tensor:
    """A cube (B, L, H, W) that the adjoint of `gradient` of a field is added to, in place."""
    rows, columns = field[0, ..., :-1, :], field[1, ..., :-1]
    cube[..., 1:, :] += rows
    cube[..., :-1, :] -= rows
    cube[..., 1:] += columns
    cube[..., :-1] -= columns
    return cube


def field_norm(field: Tensor, joint: bool = False) -> Tensor:
    """Length of the gradient at every pixel: (B, L, H, W), or (B, 1, H, W) over all bands if ``joint``."""
    if not joint:
        return (field[0] * field[0]).addcmul_(field[1], field[1]).sqrt_()
    energy = torch.zeros_like(field[0, :, :1])
    for band in field.transpose(1, 2).flatten(0, 1):  # a running sum needs no other cube
        energy[:, 0].addcmul_(band, band)
    return energy.sqrt_()


def total_variation(cube: Tensor, joint: bool = False) -> Tensor:
    """Isotropic total variation (B,) of cubes (B, L, H, W), summed over pixels (and bands, unless joint).

    It is differentiable, with derivative zero where the cube is flat.
    """
    check_shape("cube", cube, ("B", "L", "H", "W"))
    norm = torch.linalg.vector_norm(gradient(cube), dim=(0, 2) if joint else (0,))
    return norm.flatten(1).sum(1)


def project(field: Tensor, radius: float, joint: bool = False) -> Tensor:
    """Projection of a (2, B, L, H, W) field onto lengths up to ``radius``."""
    return field * cut(field, radius, joint)


def cut(field: Tensor, radius: float, joint: bool) -> Tensor:
    """What brings the lengths of a field down to ``radius``, at most one."""
    length = field_norm(field, joint).clamp_min_(max(radius, torch.finfo(field.dtype).tiny))
    return length.reciprocal_().mul_(radius)


@torch.no_grad()
def tv_prox(
    cube: Tensor, weight: float, joint: bool = False, *, max_iterations: int = 200, tolerance: float = 1e-4
) -> Tensor:
    """Total-variation denoising, ``argmin_x ½‖x − cube‖² + weight · TV(x)``.

    Fast gradient projection on the dual (Beck and Teboulle 2009).

    Args:
        cube: (B, L, H, W).
        weight: ≥ 0, in the units of the cube.
        joint: one gradient norm over all bands instead of one per band.
        max_iterations: most steps taken.
        tolerance: stop when a step changes the estimate by less than this share of its norm.
    """
    check_range("weight", weight, 0)
    check_iteration(max_iterations, tolerance)
    dual = cube.new_zeros((2, *cube.shape))
    ahead, step, estimate = dual.clone(), 1.0, cube
    for _ in range(max_iterations):
        ascent = ahead + gradient(cube + divergence(ahead)) / LARGEST_LAPLACIAN
        ascent = project(ascent, weight, joint)
        step_next = (1 + math.sqrt(1 + 4 * step**2)) / 2
        ahead = ascent + (ascent - dual) * ((step - 1) / step_next)
        dual, step, previous = ascent, step_next, estimate
        estimate = cube + divergence(dual)
        if torch.linalg.vector_norm(estimate - previous) <= tolerance * torch.linalg.vector_norm(estimate):
            break
    return estimate


def distance(parts: Sequence[Tensor], others: Sequence[Tensor]) -> float:
    """Euclidean norm of all differences together."""
    return norm([part - other for part, other in zip(parts, others, strict=True)])


def norm(parts: list[Tensor]) -> float:
    """Euclidean norm of all together."""
    return math.hypot(*(float(torch.linalg.vector_norm(part)) for part in parts))
