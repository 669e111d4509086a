"""Estimates of overlapping blocks, blended into one image."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import blake2b
from math import prod
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockGrid, BlockModel

# Bytes of the covariances of measurements with pixels that are held at once.
MEMORY = 2**27


class Estimate(NamedTuple):
    """Scenes (B, L, H, W) and, where asked for, more of the same shape.

    Args:
        estimate: the scenes.
        deviation: standard deviation of every entry.
        scatter: variance of what the blocks over a pixel say: the mean square error of single blocks less that of
            their blend, whatever the errors are.
    """

    estimate: Tensor
    deviation: Tensor | None = None
    scatter: Tensor | None = None


class Posterior(Protocol):
    """The posterior of a batch of blocks."""

    def moments(self, block: int, measured: Tensor, with_variance: bool) -> tuple[Tensor, Tensor | None]: ...


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
    scatter: bool = False,
) -> Estimate:
    """The scenes behind snapshots (B, 1, H, W'), and the standard deviation and scatter of every entry if asked for.

    Blocks under equal code windows share their matrices. Estimates are weighted by the inverse square of the
    variance that is typical of their place in the block. The variance reported is the same mean of the variances in
    the blocks' judged columns, which the error of the blended estimate hardly exceeds. ``differentiable`` lets
    gradients reach code and snapshot, the weights of the blend apart.
    """
    blend = Blend.of(
        solver, model, snapshot, taps, stride, uncertainty=uncertainty, scatter=scatter, differentiable=differentiable
    )
    with torch.set_grad_enabled(differentiable and torch.is_grad_enabled()):
        blend.lay(solver, progress=progress)
    return blend.estimate()


@dataclass
class Blend:
    """Snapshots, the code that made them, and the canvases on which their blocks are laid.

    Args:
        grid: of the blocks.
        code: (taps, H, W) padded.
        snapshot: (B, H, W') padded.
        canvases: of the estimate, of its variance and of its square; None where not asked for.
    """

    grid: BlockGrid
    code: Tensor
    snapshot: Tensor
    canvases: list[Canvas | None]

    @classmethod
    def of(
        cls,
        solver: Solver,
        model: BlockModel,
        snapshot: Tensor,
        taps: Taps,
        stride: tuple[int, int],
        *,
        uncertainty: bool = False,
        scatter: bool = False,
        differentiable: bool = False,
    ) -> Blend:
        """Empty canvases; ``solver`` says how the places in a block are weighted."""
        check_snapshot(snapshot, taps)
        grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), stride)
        code = grid.pad_code(taps.code if differentiable else taps.code.detach())
        typical = solver.typical_variance(grid.code_windows(code.detach(), spread_out(grid.positions)))
        window = blend_weights(typical).unflatten(0, model.block)
        first, last = model.judged
        parts = (window, window[..., first:last].contiguous() if uncertainty else None, window if scatter else None)
        canvases = [None if part is None else Canvas.blank(grid, len(snapshot), part) for part in parts]
        return cls(grid, code, grid.pad_snapshot(snapshot[:, 0].to(solver.dtype)), canvases)

    def lay(
        self,
        solver: Solver,
        places: list[tuple[int, int]] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Solve the blocks at some places, all of them by default, and lay them on the canvases."""
        groups = equal_windows(self.grid, self.code, places)
        for done in _lay(solver, self.grid, groups, self.snapshot, self.code, self.canvases):
            if progress:
                progress(done / len(groups))

    def estimate(self) -> Estimate:
        """What the canvases say."""
        mean, variance, square = (None if canvas is None else canvas.mean(self.grid) for canvas in self.canvases)
        assert mean is not None
        between = None if square is None else (square - mean.square()).clamp_min(0)
        return Estimate(mean, None if variance is None else variance.sqrt(), between)


def blend_weights(variance: Tensor) -> Tensor:
    """Weights, one on average, of the places in a block whose typical variances are given."""
    weights = (variance + 1e-3 * variance.mean()).pow(-2)
    return weights / weights.mean()


def _lay(
    solver: Solver,
    grid: BlockGrid,
    groups: list[list[tuple[int, int]]],
    snapshot: Tensor,
    code: Tensor,
    canvases: list[Canvas | None],
) -> Iterator[int]:
    """Solve the groups batch by batch, lay estimates (and variances) on their canvases; yields the groups done."""
    model, n = grid.model, prod(grid.model.block)
    batch = max(1, MEMORY // (model.measurements * n * solver.dtype.itemsize))
    shifts = (0, model.judged[0], 0)
    for start in range(0, len(groups), batch):
        part = groups[start : start + batch]
        posterior = solver.posterior(grid.code_windows(code, [places[0] for places in part]))
        for block, places in enumerate(part):
            measured = grid.snapshot_windows(snapshot, places)
            estimate, variance = posterior.moments(block, measured.flatten(0, 1), canvases[1] is not None)
            found = (estimate, variance, estimate.square())
            for canvas, values, shift in zip(canvases, found, shifts, strict=True):
                if canvas is not None and values is not None:
                    for (y, x), own in zip(places, values.unflatten(0, measured.shape[:2]), strict=True):
                        canvas.add(y, x + grid.padding[0] + shift, own)
        yield start + len(part)


def equal_windows(
    grid: BlockGrid, code: Tensor, places: list[tuple[int, int]] | None = None
) -> list[list[tuple[int, int]]]:
    """The grid's positions, or some of them, grouped by equal windows of the padded code."""
    groups: dict[bytes, list[tuple[int, int]]] = {}
    for place in grid.positions if places is None else places:
        window = grid.code_windows(code.detach(), [place]).contiguous().cpu().numpy()
        groups.setdefault(blake2b(window.data, digest_size=16).digest(), []).append(place)
    return list(groups.values())


def check_snapshot(snapshot: Tensor, taps: Taps) -> None:
    """Raise ShapeError unless the snapshot (B, 1, H, W') is one that the taps make, SettingError if not finite."""
    if snapshot.ndim != 4 or tuple(snapshot.shape[1:]) != taps.snapshot_shape:
        raise ShapeError("snapshot", f"{tuple(snapshot.shape)}", f"(B, {', '.join(map(str, taps.snapshot_shape))})")
    if not torch.isfinite(snapshot).all():
        raise SettingError("snapshot", "values that are not finite", "numbers", "fill dead pixels first")


def spread_out(places: list[tuple[int, int]], count: int = 8) -> list[tuple[int, int]]:
    """A few of the positions, evenly through the list."""
    return [places[i] for i in torch.linspace(0, len(places) - 1, min(count, len(places))).long().tolist()]
