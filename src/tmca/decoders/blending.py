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
    """Weighted sums of block estimates and variances on the padded frame."""

    total: Tensor
    spread: Tensor | None
    weight: Tensor
    window: Tensor

    @classmethod
    def blank(cls, grid: BlockGrid, batch: int, window: Tensor, spread: bool) -> Canvas:
        left, right, above, below = grid.padding
        shape = (window.shape[0], grid.frame[0] + above + below, grid.frame[1] + left + right)
        total = torch.zeros(batch, *shape, dtype=window.dtype)
        return cls(total, torch.zeros_like(total) if spread else None, total.new_zeros(shape), window)

    def add(self, top: int, left: int, estimate: Tensor, variance: Tensor | None) -> None:
        """Lay one block's estimate (B, n) and variance (B, n) with its corner at (top, left) of the padded frame."""
        _, h, w = self.window.shape
        area = (..., slice(top, top + h), slice(left, left + w))
        self.total[area] += self.window * estimate.unflatten(-1, self.window.shape)
        self.weight[area] += self.window
        if self.spread is not None and variance is not None:
            self.spread[area] += self.window * variance.unflatten(-1, self.window.shape)


def decode_blocks(
    solver: Solver,
    model: BlockModel,
    snapshot: Tensor,
    taps: Taps,
    stride: tuple[int, int],
    uncertainty: bool,
    progress: Callable[[float], None] | None,
) -> Estimate:
    """The scenes behind snapshots (B, 1, H, W'), and the standard deviation of every entry if asked for.

    Blocks under equal code windows share their matrices. Estimates are weighted by the inverse square of the
    variance that is typical of their place in the block; the variance reported is the same mean of the blocks'
    variances, which the error of their mean does not exceed.
    """
    check_snapshot(snapshot, taps)
    grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), stride)
    groups = equal_windows(grid, taps.code)
    typical = solver.typical_variance(grid.code_windows(taps.code, _spread_out(grid.positions)))
    window = (typical + 1e-3 * typical.mean()).pow(-2).unflatten(0, model.block)
    canvas = Canvas.blank(grid, len(snapshot), window / window.mean(), uncertainty)
    measured = snapshot[:, 0].to(solver.dtype)
    with torch.no_grad():
        for done in _lay(solver, model, grid, groups, measured, taps.code, canvas):
            if progress:
                progress(done / len(groups))
    return _finish(canvas, grid)


def _lay(
    solver: Solver,
    model: BlockModel,
    grid: BlockGrid,
    groups: list[list[tuple[int, int]]],
    measured: Tensor,
    code: Tensor,
    canvas: Canvas,
) -> Iterator[int]:
    """Solve the groups batch by batch and lay their blocks on the canvas; yields the groups done."""
    each = model.measurements * canvas.window.numel() * canvas.window.element_size()
    batch, left = max(1, MEMORY // each), grid.padding[0]
    for start in range(0, len(groups), batch):
        part = groups[start : start + batch]
        posterior = solver.posterior(grid.code_windows(code, [places[0] for places in part]))
        for block, places in enumerate(part):
            values = grid.snapshot_windows(measured, places)
            estimate, variance = posterior.moments(block, values.flatten(0, 1), canvas.spread is not None)
            for i, (y, x) in enumerate(places):
                rows = slice(i * len(measured), (i + 1) * len(measured))
                canvas.add(y, x + left, estimate[rows], None if variance is None else variance[rows])
        yield start + len(part)


def _finish(canvas: Canvas, grid: BlockGrid) -> Estimate:
    """Weighted means on the frame."""
    left, _, above, _ = grid.padding
    frame = (..., slice(above, above + grid.frame[0]), slice(left, left + grid.frame[1]))
    weight = canvas.weight[frame]
    estimate = canvas.total[frame] / weight
    return Estimate(estimate, None if canvas.spread is None else (canvas.spread[frame] / weight).sqrt())


def equal_windows(grid: BlockGrid, code: Tensor) -> list[list[tuple[int, int]]]:
    """The grid's positions, grouped by equal code windows."""
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
