"""Patch LMMSE whose prior is learned from the snapshot at hand: empirical Bayes by expectation–maximisation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tmca.decoders.batches import one_by_one, part_of
from tmca.decoders.decoder import Progress
from tmca.decoders.lmmse import Blend, Blended, PatchDecoder, blend_weights, blend_window
from tmca.errors import check_range, check_shape
from tmca.operators.block_layout import BlockLayout, Places, equal_windows, evenly_chosen, usual_stride
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.operators.taps import Taps
from tmca.priors.expected import error_moments, refitted
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.gaussian_posterior import BlockPosterior, GaussianSolver, sufficient_precision
from tmca.sensor import Noise

ITERATIONS, TILE = 4, 128
_MARGIN = 16  # pixels around a tile that its prior learns from too
_SAMPLES = 4  # blocks of a tile whose posterior is looked into
_LEAST_READ_NOISE = 5e-4  # snapshot units: while the prior is still unknown, single precision is enough above it
Tile = tuple[int, int]
Priors = dict[Tile, GaussianPrior]
Report = Callable[[float], None]


class AdaptedEstimator:
    """The patch LMMSE under the Gaussian priors that fit the scene behind each snapshot, one for every tile of it.

    A given prior makes the first estimate. Then the mean and stationary covariance of every tile are refitted to the
    estimate there and to what is still unknown of it, and the scene is estimated anew: the scene's own statistics take
    the place of those of other scenes. The estimate is no longer linear in the snapshot.

    Args:
        prior: stationary, to start from.
        taps, noise: of the camera and its sensor.
        iterations: how often the priors are refitted; 0 is the patch LMMSE.
        tile: side of the tiles, pixels; None fits one prior to the whole image.

    Raises:
        SettingError, ShapeError: a prior that is not stationary or does not fit.
    """

    def __init__(
        self, prior: GaussianPrior, taps: Taps, noise: Noise, iterations: int = ITERATIONS, tile: int | None = TILE
    ) -> None:
        self.prior, self.taps, self.iterations = prior.to(taps.code.device), taps, iterations
        self.tiling = Tiling.of((taps.code.shape[1], taps.code.shape[2]), tile)
        model = BlockModel.of(taps, prior.block)
        learning = Noise(max(noise.read, _LEAST_READ_NOISE), noise.shot)
        coarse = BlockLayout.of(model, taps, (prior.block[1], model.valid[1] - model.valid[0]))
        self.coarse = Frame(coarse, self.tiling, learning, torch.float32)
        fine = BlockLayout.of(model, taps, usual_stride(model, taps.code))
        precision = sufficient_precision(self.prior, model, noise)
        self.fine = Frame(fine, self.tiling, noise, precision)

    def __call__(self, snapshot: Tensor, *, uncertainty: bool = False, progress: Progress | None = None) -> Blended:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W'), each under priors of its own; their deviation too."""
        check_shape("snapshot", snapshot, ("B", *self.taps.snapshot_shape))
        parts = [self._adapted(one, uncertainty, report) for one, report in one_by_one(snapshot, progress)]
        return Blended.joined(parts)

    def _adapted(self, snapshot: Tensor, uncertainty: bool, progress: Report) -> Blended:
        priors, share = dict.fromkeys(self.tiling.tiles, self.prior), 1 / (self.iterations + 1)
        for step in range(self.iterations):
            priors = self.coarse.refitted(snapshot, priors, part_of(progress, step * share, (step + 1) * share))
        return self.fine.estimate(snapshot, priors, uncertainty, part_of(progress, 1 - share, 1))


@dataclass(frozen=True)
class Tiling:
    """A frame (H, W) in equal parts, ``counts`` of them along each axis."""

    size: tuple[int, int]
    counts: tuple[int, int]

    @classmethod
    def of(cls, size: tuple[int, int], side: int | None) -> Tiling:
        """Tiles as near to this side as the frame allows."""
        height, width = (max(1, round(length / side)) if side else 1 for length in size)
        return cls(size, (height, width))

    @property
    def tiles(self) -> list[Tile]:
        return [(i, j) for i in range(self.counts[0]) for j in range(self.counts[1])]

    def places(self, grid: BlockGrid) -> dict[Tile, Places]:
        """Positions of blocks by the tile in which their middle lies."""
        parts: dict[Tile, Places] = {tile: [] for tile in self.tiles}
        for top, left in grid.positions:
            middle = (top + grid.model.block[1] / 2, left + sum(grid.model.valid) / 2)
            row, column = (
                min(max(int(m * n / length), 0), n - 1)
                for m, n, length in zip(middle, self.counts, self.size, strict=True)
            )
            parts[row, column].append((top, left))
        return {tile: places for tile, places in parts.items() if places}

    def area(self, tile: Tile, margin: int, least: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns of a tile with a margin, no fewer than ``least``."""
        parts = []
        for place, count, length, few in zip(tile, self.counts, self.size, least, strict=True):
            first, last = place * length // count - margin, (place + 1) * length // count + margin
            first = max(0, min(first, length - few))
            parts.append(slice(first, min(length, max(last, first + few))))
        return parts[0], parts[1]


@dataclass
class Frame:
    """How snapshots are estimated under a prior for every tile."""

    layout: BlockLayout
    tiling: Tiling
    noise: Noise
    dtype: torch.dtype

    def estimate(self, snapshot: Tensor, priors: Priors, uncertainty: bool, progress: Report) -> Blended:
        """The whole scene, every block under the prior of its tile."""
        blend = self._blend(snapshot, priors, uncertainty=uncertainty)
        for _ in self._solved(blend, priors, progress):
            pass
        return blend.result()

    def refitted(self, snapshot: Tensor, priors: Priors, progress: Report) -> Priors:
        """The priors of the next iteration."""
        blend, unknown = self._blend(snapshot, priors, scatter=True), dict[Tile, _Unknown]()
        for tile, places, solver in self._solved(blend, priors, progress):
            windows = self.layout.grid.code_windows(self.layout.code, evenly_chosen(places, _SAMPLES))
            unknown[tile] = _Unknown.of(priors[tile], solver.posterior(windows))
        scene = blend.result()
        return priors | {tile: self._fitted(tile, priors[tile], scene, unknown[tile]) for tile in unknown}

    def _fitted(self, tile: Tile, prior: GaussianPrior, scene: Blended, unknown: _Unknown) -> GaussianPrior:
        assert scene.scatter is not None
        around = (slice(None), *self.tiling.area(tile, _MARGIN, self.layout.grid.model.block[1:]))
        inside = (slice(None), *self.tiling.area(tile, 0, (1, 1)))
        moments = unknown.blended(float(scene.scatter[0][inside].mean()))
        return refitted(prior, scene.estimate[0][around].clamp_min(0), moments)

    def _blend(self, snapshot: Tensor, priors: Priors, **more: bool) -> Blend:
        middle = self._solver(priors[self.tiling.tiles[len(self.tiling.tiles) // 2]])
        return Blend(self.layout, blend_window(self.layout, middle), snapshot, **more)

    def _solved(self, blend: Blend, priors: Priors, progress: Report) -> Iterator[tuple[Tile, Places, GaussianSolver]]:
        """Lay the blocks of tile after tile, each solved under its own prior."""
        parts = self.tiling.places(self.layout.grid)
        for done, (tile, places) in enumerate(parts.items(), start=1):
            solver = self._solver(priors[tile])
            blend.lay(solver, equal_windows(self.layout.grid, self.layout.code, places))
            yield tile, places, solver
            progress(done / len(parts))

    def _solver(self, prior: GaussianPrior) -> GaussianSolver:
        return GaussianSolver(prior, self.layout.grid.model, self.noise, self.dtype)


@dataclass(frozen=True)
class _Unknown:
    """What the measurements of single blocks leave unknown: its moments by distance, and its weighted mean variance."""

    moments: Tensor
    variance: Tensor

    @classmethod
    def of(cls, prior: GaussianPrior, posterior: BlockPosterior) -> _Unknown:
        single = posterior.error_variance().mean(0)
        return cls(error_moments(prior, posterior), (blend_weights(single) * single).mean())

    def blended(self, scatter: float) -> Tensor:
        """Those of the blend, which errs less than single blocks, by the variance of what they say of a pixel."""
        single = self.moments[:, :, 0, 0].diagonal().mean()
        return self.moments * ((self.variance - scatter) / single).clamp_min(0)


@dataclass
class AdaptedLMMSE(PatchDecoder):
    """The patch LMMSE under priors that are refitted to the scene behind the snapshot itself.

    Args:
        uncertainty: also predict the standard deviation of every entry.
        iterations: how often the priors are refitted.
        tile: side of the tiles that have a prior each, pixels.
        calibrated: with the standard deviation, bring it to the errors of known scenes; False leaves it as predicted.
    """

    name, label, cameras = "lmmse-adapted", "LMMSE adapted", frozenset({"spectral"})
    iterations: int = ITERATIONS
    tile: int | None = TILE
    calibrated: bool = True

    def __post_init__(self) -> None:
        check_range("iterations", self.iterations, 0, whole=True)
        if self.tile is not None:
            check_range("tile", self.tile, 1, whole=True)

    def setup(self, camera: Any, prior: Any) -> AdaptedEstimator:
        return AdaptedEstimator(prior, camera.taps(), camera.noise, self.iterations, self.tile)
