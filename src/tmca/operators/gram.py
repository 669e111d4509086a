"""``A Aᵀ`` of a collapsed camera: diagonal, or tridiagonal along x where a band falls between two pixels; of
``Aᵀ A`` the diagonal."""

from __future__ import annotations

from itertools import product

import torch
from torch import Tensor

from tmca.operators.taps import Taps, sum_by_channel


def gram_diagonal(taps: Taps) -> Tensor:
    """(H, W') diagonal of ``A Aᵀ``: summed squares of the codes that meet in each sensor pixel."""
    diagonal = taps.code.new_zeros(taps.code.shape[1], taps.snapshot_width)
    columns = taps.code.shape[2]
    for code, offset in zip(taps.code, taps.offsets, strict=True):
        diagonal[:, offset : offset + columns].addcmul_(code, code)
    return diagonal


def channel_energy(taps: Taps) -> Tensor:
    """(L, H, W) diagonal of ``Aᵀ A``: squared codes of the taps that read each entry of the scene, summed."""
    return sum_by_channel(taps.code.square(), taps.channels, taps.scene_channels)


def gram_neighbour(taps: Taps) -> Tensor | None:
    """(H, W'-1) coupling of each sensor pixel with its right neighbour, None if there is none."""
    columns = taps.code.shape[2]
    pairs = [
        (a, b)
        for a, b in product(range(len(taps.offsets)), repeat=2)
        if taps.channels[a] == taps.channels[b] and taps.offsets[b] == taps.offsets[a] + 1
    ]
    if not pairs:
        return None
    coupling = taps.code.new_zeros(taps.code.shape[1], taps.snapshot_width - 1)
    for a, b in pairs:
        offset = taps.offsets[a]
        coupling[:, offset : offset + columns].addcmul_(taps.code[a], taps.code[b])
    return coupling


def solve_tridiagonal(diagonal: Tensor, coupling: Tensor, right: Tensor) -> Tensor:
    """Solve the symmetric tridiagonal system along the last axis, all rows at once (Thomas' algorithm).

    Args:
        diagonal: (H, n), positive definite with the coupling.
        coupling: (H, n-1).
        right: (..., H, n).
    """
    n = diagonal.shape[-1]
    pivots, carried = [diagonal[..., 0]], [right[..., 0]]
    for i in range(1, n):
        ratio = coupling[..., i - 1] / pivots[-1]
        pivots.append(diagonal[..., i] - ratio * coupling[..., i - 1])
        carried.append(right[..., i] - ratio * carried[-1])
    solution = [carried[-1] / pivots[-1]]
    for i in range(n - 2, -1, -1):
        solution.append((carried[i] - coupling[..., i] * solution[-1]) / pivots[i])
    return torch.stack(solution[::-1], dim=-1)
