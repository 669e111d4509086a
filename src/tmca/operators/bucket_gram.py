"""``A Aᵀ`` of taps that fill several buckets: a block (R, R) for every sensor pixel, tied to its right neighbour where
displacements are fractional."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor

_SHIFT, _REFINEMENTS = 1e-9, 4
_SINGULAR = 1e-12
"""Share of the squared trace below which the determinant of a block is rounding."""


def paired_blocks(code: Tensor, pairs: Iterable[tuple[int, int, int]], columns: int) -> Tensor:
    """(H, columns, R, R) sums of ``code[r, a] · code[s, b]`` over pairs of taps.

    Args:
        code: (R, T, H, W) of every bucket.
        pairs: taps a and b, and the column on which the product of their column 0 lies.
        columns: W' of the result.
    """
    buckets, _, rows, width = code.shape
    blocks = code.new_zeros(buckets, buckets, rows, columns)
    for a, b, column in pairs:
        blocks[..., column : column + width] += code[:, None, a] * code[None, :, b]
    return blocks.permute(2, 3, 0, 1)


def solve_blocks(blocks: Tensor, right: Tensor) -> Tensor:
    """``blocks⁺ right``: blocks (H, n, R, R) positive semidefinite, right (..., H, n, R); the least-norm solution where
    one is singular, as under a shutter that leaves a bucket dark."""
    return (pseudo_inverse(blocks) * right[..., None, :]).sum(-1)  # a batched product of 2×2 is many times slower


def pseudo_inverse(blocks: Tensor) -> Tensor:
    """(..., R, R) pseudo-inverses of positive semidefinite blocks; in closed form for two buckets."""
    if blocks.shape[-1] != 2:
        return torch.linalg.pinv(blocks, hermitian=True)
    (a, b), (_, d) = (row.unbind(-1) for row in blocks.unbind(-2))
    trace, determinant = a + d, a * d - b * b
    whole = determinant > _SINGULAR * trace.square()
    adjugate = torch.stack((d, -b, -b, a), -1).unflatten(-1, (2, 2))
    inverse = adjugate / torch.where(whole, determinant, 1)[..., None, None]
    # of rank one the block is trace · v vᵀ, and its pseudo-inverse v vᵀ / trace
    singular = blocks / torch.where(trace > 0, trace, 1).square()[..., None, None]
    return torch.where(whole[..., None, None], inverse, singular)


def solve_tied_blocks(blocks: Tensor, ties: Tensor, right: Tensor) -> Tensor:
    """Solve the symmetric block tridiagonal system along n, all rows at once (block Thomas algorithm).

    Args:
        blocks: (..., H, n, R, R), positive definite with the ties.
        ties: (H, n-1, R, R) of a pixel's buckets (rows) with those of its right neighbour (columns).
        right: (..., H, n, R).
    """
    n = blocks.shape[-3]
    inverses = [torch.linalg.inv(blocks[..., 0, :, :])]
    carried = [right[..., 0, :, None]]
    for i in range(1, n):
        tie = ties[..., i - 1, :, :]
        ratio = tie.mT @ inverses[-1]
        inverses.append(torch.linalg.inv(blocks[..., i, :, :] - ratio @ tie))
        carried.append(right[..., i, :, None] - ratio @ carried[-1])
    solution = [inverses[-1] @ carried[-1]]
    for i in range(n - 2, -1, -1):
        solution.append(inverses[i] @ (carried[i] - ties[..., i, :, :] @ solution[-1]))
    return torch.stack(solution[::-1], dim=-3)[..., 0]


def least_norm_of_tied_blocks(blocks: Tensor, ties: Tensor, right: Tensor) -> Tensor:
    """See ``least_norm``."""
    identity = torch.eye(blocks.shape[-1]).to(blocks)

    def product(solution: Tensor) -> Tensor:
        image = (blocks @ solution[..., None])[..., 0]
        image[..., :-1, :] += (ties @ solution[..., 1:, :, None])[..., 0]
        image[..., 1:, :] += (ties.mT @ solution[..., :-1, :, None])[..., 0]
        return image

    def solve(left: Tensor, shift: Tensor) -> Tensor:
        return solve_tied_blocks(blocks + shift * identity, ties, left)

    return least_norm(product, solve, blocks.diagonal(dim1=-2, dim2=-1).max(), right)


def least_norm(
    product: Callable[[Tensor], Tensor], solve: Callable[[Tensor, Tensor], Tensor], largest: Tensor, right: Tensor
) -> Tensor:
    """Proximal iterations: singular systems (a lone fractional band, closed pixels) need no rank decision.

    What lies in the null space of ``A Aᵀ`` is multiplied by 1/shift; ``Aᵀ`` removes it again, in double precision.

    Args:
        product: with the system.
        solve: the system plus a shift, for a right-hand side.
        largest: entry of its diagonal.
        right: right-hand side.
    """
    shift = _SHIFT * largest.clamp_min(torch.finfo(largest.dtype).tiny)
    solution = torch.zeros_like(right)
    for _ in range(_REFINEMENTS):
        solution = solution + solve(right - product(solution), shift)
    return solution
