"""Taps: the common form of every collapsed coded camera, and its operator.

A tap takes one channel of the scene (a band, a view), weighs it pixel by pixel and lays it on the snapshot some
columns further on. CASSI has a tap per band (two where the dispersion is fractional), the dual disperser and the
light-field camera one tap per channel with no offset. ``A Aᵀ`` is then diagonal, or tridiagonal along x; a sensor with
several buckets has the same taps once for each of them, and a small block in every entry of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import torch
from torch import Tensor

from tmca.errors import ShapeError
from tmca.operators.bucket_gram import (
    least_norm,
    least_norm_of_tied_blocks,
    paired_blocks,
    solve_blocks,
    solve_tied_blocks,
)
from tmca.operators.kernels import backproject, project
from tmca.operators.linear import LinearOperator


@dataclass(frozen=True)
class Taps:
    """``y[r, m, n + offsets[t]] += code[t, m, n] * scene[channels[t], m, n]`` for every tap t of every bucket r.

    Args:
        code: (taps, H, W) weight of each tap, the time-multiplexed code with the sensor response folded in; those of
            the first bucket, then those of the second, ….
        channels: scene channel that each tap reads.
        offsets: column of the snapshot on which each tap's column 0 falls, ≥ 0, in pixels.
        scene_channels: number of channels L of the scene.
        snapshot_width: columns W' of the snapshot.
        buckets: number R of buckets of every sensor pixel, whose taps have the same channels and offsets.
    """

    code: Tensor
    channels: tuple[int, ...]
    offsets: tuple[int, ...]
    scene_channels: int
    snapshot_width: int
    buckets: int = 1

    def __post_init__(self) -> None:
        taps, _, width = self.code.shape
        if not taps == len(self.channels) == len(self.offsets):
            counts = f"{taps} codes, {len(self.channels)} channels, {len(self.offsets)} offsets"
            raise ShapeError("taps", counts, "one of each per tap")
        if any(part != self.of_bucket(part) * self.buckets for part in (self.channels, self.offsets)):
            raise ShapeError("taps", f"{taps} that differ from bucket to bucket", f"{self.buckets} times the same")
        first, last = min(self.offsets), max(self.offsets)
        if first < 0 or last + width > self.snapshot_width:
            layout = f"offsets {first}…{last}, width {width}, snapshot of {self.snapshot_width}"
            raise ShapeError("taps", layout, "every tap inside the snapshot")

    @classmethod
    def of_buckets(cls, parts: Sequence[Taps]) -> Taps:
        """The taps of a sensor each of whose buckets has some of its own; itself for one."""
        if len(parts) == 1:
            return parts[0]
        one, channels, offsets = parts[0], (c for p in parts for c in p.channels), (o for p in parts for o in p.offsets)
        code = torch.cat([part.code for part in parts])
        return replace(one, code=code, channels=tuple(channels), offsets=tuple(offsets), buckets=len(parts))

    @classmethod
    def of_frames(cls, parts: Sequence[Taps]) -> Taps:
        """The taps of a scene that changes: those of every frame, whose channels follow those of the frame before."""
        one, codes = parts[0], torch.cat([part.bucket_code for part in parts], 1)
        count = one.scene_channels
        channels = tuple(c + g * count for g, part in enumerate(parts) for c in part.of_bucket(part.channels))
        offsets = tuple(o for part in parts for o in part.of_bucket(part.offsets))
        channels, offsets = channels * one.buckets, offsets * one.buckets
        return Taps(codes.flatten(0, 1), channels, offsets, count * len(parts), one.snapshot_width, one.buckets)

    def of_bucket(self, parts: tuple[int, ...]) -> tuple[int, ...]:
        """Channels or offsets of one bucket."""
        return parts[: len(parts) // self.buckets]

    @property
    def bucket_code(self) -> Tensor:
        """(R, T, H, W) code of every bucket."""
        return self.code.unflatten(0, (self.buckets, -1))

    @property
    def scene_shape(self) -> tuple[int, int, int]:
        """(L, H, W) of the scene."""
        return (self.scene_channels, self.code.shape[1], self.code.shape[2])

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(R, H, W') of the snapshot."""
        return (self.buckets, self.code.shape[1], self.snapshot_width)

    def window(self, top: int, left: int, height: int, width: int) -> Taps:
        """The same camera behind a part of its codes: a scene of (height, width), dark around.

        Args:
            top, left: first row and column of the part, scene pixels.
            height, width: its size, pixels.

        Raises:
            ShapeError: it reaches beyond the codes.
        """
        rows, columns = self.code.shape[1:]
        if min(top, left) < 0 or top + height > rows or left + width > columns or min(height, width) < 1:
            part = f"{height}×{width} pixels at row {top}, column {left}"
            raise ShapeError("window", part, f"a part of {rows}×{columns}")
        code = self.code[:, top : top + height, left : left + width]
        return replace(self, code=code, snapshot_width=width + self.snapshot_width - columns)

    def gram_diagonal(self) -> Tensor:
        """(R, H, W') diagonal of ``A Aᵀ``: summed squares of the codes that meet in each bucket of a sensor pixel."""
        diagonal = self.code.new_zeros(self.snapshot_shape)
        columns, share = self.code.shape[2], len(self.code) // self.buckets
        for t, (code, offset) in enumerate(zip(self.code, self.offsets, strict=True)):
            diagonal[t // share, :, offset : offset + columns].addcmul_(code, code)
        return diagonal

    def _neighbours(self) -> list[tuple[int, int]]:
        """Taps of one bucket that bring light of one entry of the scene to a sensor pixel and its right neighbour."""
        channels, offsets = self.of_bucket(self.channels), self.of_bucket(self.offsets)
        every = product(range(len(offsets)), repeat=2)
        return [(a, b) for a, b in every if channels[a] == channels[b] and offsets[b] == offsets[a] + 1]

    @property
    def tied(self) -> bool:
        """Whether ``A Aᵀ`` ties sensor pixels to their neighbours, as fractional displacements do."""
        return bool(self._neighbours())

    def gram_blocks(self) -> tuple[Tensor, Tensor | None]:
        """``A Aᵀ`` by sensor pixel: (H, W', R, R) of its buckets with each other, and (H, W'-1, R, R) of them with
        those of the right neighbour, None if there is none; float64."""
        code, offsets = self.bucket_code.double(), self.of_bucket(self.offsets)
        same = paired_blocks(code, [(t, t, offset) for t, offset in enumerate(offsets)], self.snapshot_width)
        ties = [(a, b, offsets[a]) for a, b in self._neighbours()]
        return same, paired_blocks(code, ties, self.snapshot_width - 1) if ties else None

    def gram_neighbour(self) -> Tensor | None:
        """(H, W'-1) coupling of each sensor pixel with its right neighbour in ``A Aᵀ``, None if there is none; of a
        sensor with one bucket."""
        columns, pairs = self.code.shape[2], self._neighbours()
        if not pairs:
            return None
        coupling = self.code.new_zeros(self.code.shape[1], self.snapshot_width - 1)
        for a, b in pairs:
            offset = self.offsets[a]
            coupling[:, offset : offset + columns].addcmul_(self.code[a], self.code[b])
        return coupling

    def channel_energy(self) -> Tensor:
        """(L, H, W) diagonal of ``Aᵀ A``: squared codes of the taps that read each entry of the scene, summed."""
        return sum_by_channel(self.code.square(), self.channels, self.scene_channels)


def sum_by_channel(code: Tensor, channels: tuple[int, ...], scene_channels: int) -> Tensor:
    """(t, H, W) codes of taps → (L, H, W), summed over the taps that read the same channel."""
    total = code.new_zeros(scene_channels, *code.shape[1:])
    return total.index_add(0, torch.tensor(channels, device=code.device), code)


class TapOperator(LinearOperator):
    """``y[r, m, n + o_t] = Σ_t code[t, m, n] · x[c_t, m, n]``, (B, L, H, W) → (B, R, H, W'); its inverse is closed."""

    code: Tensor

    def __init__(self, taps: Taps) -> None:
        super().__init__()
        self.register_buffer("code", taps.code)
        self.scene_shape, self.snapshot_shape = taps.scene_shape, taps.snapshot_shape
        self._layout = (taps.channels, taps.offsets, taps.scene_channels, taps.snapshot_width, taps.buckets)

    @property
    def taps(self) -> Taps:
        """The operator's taps, on its present device."""
        return Taps(self.code, *self._layout)

    def A(self, scene: Tensor) -> Tensor:
        self._check("scene", scene)
        return project(scene, self.code, self._layout)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        self._check("snapshot", snapshot)
        return backproject(snapshot, self.code, self._layout)

    def gram_solve(self, snapshot: Tensor, shift: float | Tensor, **iteration: object) -> Tensor:
        """A division, or a tridiagonal solve along x; in blocks for several buckets. Without a shift, pixels that no
        light reaches give zero."""
        taps = self.taps
        if taps.buckets > 1:
            return _solve_buckets(taps, snapshot, shift)
        coupling = taps.gram_neighbour()
        if coupling is None:
            diagonal = taps.gram_diagonal()[0] + shift
            return torch.where(diagonal > 0, snapshot / diagonal.clamp_min(torch.finfo(diagonal.dtype).tiny), 0)
        diagonal, coupling, right = taps.gram_diagonal()[0].double(), coupling.double(), snapshot.double()
        if not isinstance(shift, Tensor) and shift == 0:
            return _least_norm(diagonal, coupling, right).to(snapshot.dtype)
        return solve_tridiagonal(diagonal + shift, coupling, right).to(snapshot.dtype)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        if not self.taps.tied:
            return super().A_dagger(snapshot)
        self._check("snapshot", snapshot)
        precise = self.gram_solve(snapshot.double(), 0.0)
        return backproject(precise, self.code.double(), self._layout).to(snapshot.dtype)


def of_buckets(parts: Sequence[TapOperator]) -> TapOperator:
    """The operator of a sensor with a part for each of its buckets; itself for one."""
    return parts[0] if len(parts) == 1 else TapOperator(Taps.of_buckets([part.taps for part in parts]))


def _solve_buckets(taps: Taps, snapshot: Tensor, shift: float | Tensor) -> Tensor:
    """``(A Aᵀ + shift·I)⁺ snapshot`` of several buckets, (B, R, H, W')."""
    blocks, ties = taps.gram_blocks()
    right, whole = snapshot.double().movedim(1, -1), isinstance(shift, Tensor) or shift > 0
    if whole:
        shifts = torch.as_tensor(shift, dtype=blocks.dtype, device=blocks.device)
        shifts = shifts.expand(torch.broadcast_shapes(shifts.shape, taps.snapshot_shape))
        blocks = blocks + torch.diag_embed(shifts.movedim(-3, -1))
    if ties is None:
        solution = solve_blocks(blocks, right)
    else:
        solution = (solve_tied_blocks if whole else least_norm_of_tied_blocks)(blocks, ties, right)
    return solution.movedim(-1, 1).to(snapshot.dtype)


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


def _least_norm(diagonal: Tensor, coupling: Tensor, right: Tensor) -> Tensor:
    """See ``least_norm``."""

    def product(solution: Tensor) -> Tensor:
        image = diagonal * solution
        image[..., :-1] += coupling * solution[..., 1:]
        image[..., 1:] += coupling * solution[..., :-1]
        return image

    return least_norm(
        product, lambda left, shift: solve_tridiagonal(diagonal + shift, coupling, left), diagonal.max(), right
    )
