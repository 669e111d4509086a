"""Estimates of overlapping blocks, blended into one image."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import blake2b
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockGrid, BlockModel

# Bytes of the covariances of measurements with pixels that are held at once.
MEMORY = 2**27


class Estimate(NamedTuple):
    """Scenes (B, L, H, W) and, where asked for, the standard deviation (B, L, H, W) of every entry."""

    estimate: Tensor
    deviation: Tensor | None = None


class Posterior(Protocol):
    """The posterior of a batch of blocks."""

    def moments(self, block: int, measured: Tensor, spread: bool) -> tuple[Tensor, Tensor | None]: ...


class Solver(Protocol):
    """What a decoder needs of a prior under a given camera and noise."""

    dtype: torch.dtype

    def posterior(self, windows: Tensor) -> Posterior: ...

    def typical_variance(self, windows: Tensor) -> Tensor: ...


@dataclass
class Canvas:
    """Weighted sums of what blocks say about the padded frame.

    Args:
        total: (B, L, H, W) sum.
        weight: (L, H, W) sum of weights.
        window: (L, h, w) weight of each place in a block.
    """

    total: Tensor
    weight: Tensor
    window: Tensor

    @classmethod
    def blank(cls, grid: BlockGrid, batch: int, window: Tensor) -> Canvas:
        left, right, above, below = grid.padding
        shape = (window.shape[0], grid.frame[0] + above + below, grid.frame[1] + left + right)
        return cls(window.new_zeros(batch, *shape), window.new_zeros(shape), window)

    def add(self, top: int, left: int, values: Tensor) -> None:
        """Lay one block's values (B, L·h·w) with its corner at (top, left) of the padded frame."""
        _, h, w = self.window.shape
        area = (..., slice(top, top + h), slice(left, left + w))
        self.total[area] += self.window * values.unflatten(-1, self.window.shape)
        self.weight[area] += self.window

    def mean(self, grid: BlockGrid) -> Tensor:
        """(B, L, H, W) weighted mean on the frame."""
        left, _, above, _ = grid.padding
        frame = (..., slice(above, above + grid.frame[0]), slice(left, left + grid.frame[1]))
        return self.total[frame] / self.weight[frame]


def decode_blocks(
    solver: Solver,
    model: BlockModel,
    snapshot: Tensor,
    taps: Taps,
    stride: tuple[int, int],
    uncertainty: bool = False,
    progress: Callable[[float], None] | None = None,
    differentiable: bool = False,
) -> Estimate:
    """The scenes behind snapshots (B, 1, H, W'), and the standard deviation of every entry if asked for.

    Blocks under equal code windows share their matrices. Estimates are weighted by the inverse square of the
    variance that is typical of their place in the block. The variance reported is the same mean of the variances in
    the blocks' judged columns, which the error of the blended estimate hardly exceeds. ``differentiable`` lets
    gradients reach code and snapshot, the weights of the blend apart.
    """
    check_snapshot(snapshot, taps)
    grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), stride)
    code = grid.pad_code(taps.code if differentiable else taps.code.detach())
    groups = equal_windows(grid, code)
    typical = solver.typical_variance(grid.code_windows(code.detach(), _spread_out(grid.positions)))
    window = (typical + 1e-3 * typical.mean()).pow(-2).unflatten(0, model.block)
    window = window / window.mean()
    first, last = model.judged
    canvases = [Canvas.blank(grid, len(snapshot), part) for part in (window, window[..., first:last].contiguous())]
    values = grid.pad_snapshot(snapshot[:, 0].to(solver.dtype))
    with torch.set_grad_enabled(differentiable and torch.is_grad_enabled()):
        for done in _lay(solver, grid, groups, values, code, canvases[: 1 + uncertainty]):
            if progress:
                progress(done / len(groups))
    return Estimate(canvases[0].mean(grid), canvases[1].mean(grid).sqrt() if uncertainty else None)


def _lay(
    solver: Solver,
    grid: BlockGrid,
    groups: list[list[tuple[int, int]]],
    snapshot: Tensor,
    code: Tensor,
    canvases: list[Canvas],
) -> Iterator[int]:
    """Solve the groups batch by batch, lay estimates (and variances) on their canvases; yields the groups done."""
    model, window = grid.model, canvases[0].window
    batch = max(1, MEMORY // (model.measurements * window.numel() * window.element_size()))
    shifts = (0, model.judged[0])
    for start in range(0, len(groups), batch):
        part = groups[start : start + batch]
        posterior = solver.posterior(grid.code_windows(code, [places[0] for places in part]))
        for block, places in enumerate(part):
            measured = grid.snapshot_windows(snapshot, places)
            found = posterior.moments(block, measured.flatten(0, 1), len(canvases) > 1)
            for canvas, values, shift in zip(canvases, found, shifts, strict=False):
                if values is not None:
                    for (y, x), own in zip(places, values.unflatten(0, measured.shape[:2]), strict=True):
                        canvas.add(y, x + grid.padding[0] + shift, own)
        yield start + len(part)


def equal_windows(grid: BlockGrid, code: Tensor) -> list[list[tuple[int, int]]]:
    """The grid's positions, grouped by equal windows of the padded code."""
    groups: dict[bytes, list[tuple[int, int]]] = {}
    for place in grid.positions:
        window = grid.code_windows(code.detach(), [place]).contiguous().cpu().numpy()
        groups.setdefault(blake2b(window.data, digest_size=16).digest(), []).append(place)
    return list(groups.values())


def check_snapshot(snapshot: Tensor, taps: Taps) -> None:
    """Raise ShapeError unless the snapshot (B, 1, H, W') is one that the taps make, SettingError if not finite."""
    if snapshot.ndim != 4 or tuple(snapshot.shape[1:]) != taps.snapshot_shape:
        raise ShapeError("snapshot", f"{tuple(snapshot.shape)}", f"(B, {', '.join(map(str, taps.snapshot_shape))})")
    if not torch.isfinite(snapshot).all():
        raise SettingError("snapshot", "values that are not finite", "numbers", "fill dead pixels first")


def _spread_out(places: list[tuple[int, int]], count: int = 8) -> list[tuple[int, int]]:
    """A few of the positions, evenly through the list."""
    return [places[i] for i in torch.linspace(0, len(places) - 1, min(count, len(places))).long().tolist()]
