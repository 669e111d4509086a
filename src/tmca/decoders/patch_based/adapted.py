"""Patch LMMSE whose prior is learned from the snapshot at hand: empirical Bayes by expectation–maximisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.decoders.patch_based.blending import Blend, Estimate, blend_weights, check_snapshot, spread_out
from tmca.decoders.patch_based.patches import PatchDecoder
from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.adaptation import error_moments, refitted
from tmca.priors.blocks import BlockGrid, BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.posterior import BlockPosterior, GaussianSolver, sufficient_precision
from tmca.sensor import Noise

ITERATIONS, TILE = 4, 128
_MARGIN = 16  # pixels around a tile that its prior learns from too
_SAMPLES = 4  # blocks of a tile whose posterior is looked into
_LEAST_READ_NOISE = 5e-4  # snapshot units: while the prior is still unknown, single precision is enough above it


class AdaptedLMMSE(PatchDecoder):
    """The patch LMMSE under the Gaussian priors that fit the scene behind each snapshot, one for every tile of it.

    A given prior makes the first estimate. Then the mean and stationary covariance of every tile are refitted to the
    estimate there and to what is still unknown of it, and the scene is estimated anew, ``iterations`` times: the
    scene's own statistics take the place of those of other scenes. The estimate is no longer linear in the snapshot.

    Args:
        prior: stationary, to start from.
        iterations: how often the priors are refitted; 0 is the patch LMMSE.
        tile: side of the tiles, pixels; None fits one prior to the whole image.

    Raises:
        SettingError: a negative number, or a prior that is not stationary.
    """

    prior: GaussianPrior

    def __init__(self, prior: GaussianPrior, iterations: int = ITERATIONS, tile: int | None = TILE) -> None:
        super().__init__(prior)
        if iterations < 0 or (tile is not None and tile < 1):
            raise SettingError("adapted", f"{iterations} iterations, tiles of {tile}", "≥ 0 iterations, tiles of ≥ 1")
        self.iterations, self.tile = iterations, tile

    def __call__(  # type: ignore[override]
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float = 0.0,
        shot: float = 0.0,
        *,
        uncertainty: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> Estimate:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W'), each under priors of its own.

        Args:
            snapshot: in snapshot units.
            taps: of the camera.
            read_noise: standard deviation, in snapshot units.
            shot: variance of the shot noise per snapshot unit (full scale / full well).
            uncertainty: also return the standard deviation of every entry under the fitted priors.
            progress: told the share that is done.

        Raises:
            ShapeError: the snapshot does not fit the taps, or is smaller than the prior's block.
            SettingError: negative noise, or a snapshot that is not finite.
        """
        check_snapshot(snapshot, taps)
        self.prior = self.prior.to(taps.code.device)
        found = []
        for place, one in enumerate(snapshot.split(1)):
            told = _share(progress, place, len(snapshot))
            found.append(self._adapted(one, taps, read_noise, shot, uncertainty, told))
        deviations = [one.deviation for one in found if one.deviation is not None]
        return Estimate(torch.cat([one.estimate for one in found]), torch.cat(deviations) if deviations else None)

    def _adapted(
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float,
        shot: float,
        uncertainty: bool,
        progress: Callable[[float], None],
    ) -> Estimate:
        tiling = Tiling.of((taps.code.shape[1], taps.code.shape[2]), self.tile)
        priors, read = dict.fromkeys(tiling.tiles, self.prior), max(read_noise, _LEAST_READ_NOISE)
        model = BlockModel.of(taps, self.prior.block)
        coarse = (self.prior.block[1], model.judged[1] - model.judged[0])
        for step in range(self.iterations):
            told = _share(progress, step, self.iterations + 1)
            frame = Frame(snapshot, taps, model, tiling, coarse, read, shot, torch.float32)
            priors = frame.refitted(priors, told)
        fine = self._stride(model, taps.code)
        dtype = sufficient_precision(self.prior, model, Noise(read_noise, shot))
        frame = Frame(snapshot, taps, model, tiling, fine, read_noise, shot, dtype)
        return frame.estimate(priors, uncertainty, _share(progress, self.iterations, self.iterations + 1))


Tile = tuple[int, int]


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
        """All of them."""
        return [(i, j) for i in range(self.counts[0]) for j in range(self.counts[1])]

    def places(self, grid: BlockGrid) -> dict[Tile, list[tuple[int, int]]]:
        """Positions of blocks by the tile in which their middle lies."""
        found: dict[Tile, list[tuple[int, int]]] = {tile: [] for tile in self.tiles}
        for top, left in grid.positions:
            middle = (top + grid.model.block[1] / 2, left + sum(grid.model.judged) / 2)
            row, column = (
                min(max(int(m * n / length), 0), n - 1)
                for m, n, length in zip(middle, self.counts, self.size, strict=True)
            )
            found[row, column].append((top, left))
        return {tile: places for tile, places in found.items() if places}

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
    """One snapshot and how it is estimated under a prior for every tile."""

    snapshot: Tensor
    taps: Taps
    model: BlockModel
    tiling: Tiling
    stride: tuple[int, int]
    read_noise: float
    shot: float
    dtype: torch.dtype

    def estimate(
        self, priors: dict[Tile, GaussianPrior], uncertainty: bool, progress: Callable[[float], None]
    ) -> Estimate:
        """The whole scene, every block under the prior of its tile."""
        blend = self._blend(priors, uncertainty=uncertainty)
        parts = self.tiling.places(blend.grid)
        for done, (tile, places) in enumerate(parts.items(), start=1):
            blend.lay(self._solver(priors[tile]), places)
            progress(done / len(parts))
        return blend.estimate()

    def refitted(
        self, priors: dict[Tile, GaussianPrior], progress: Callable[[float], None]
    ) -> dict[Tile, GaussianPrior]:
        """The priors of the next iteration."""
        blend, unknown = self._blend(priors, scatter=True), {}
        parts = self.tiling.places(blend.grid)
        for done, (tile, places) in enumerate(parts.items(), start=1):
            solver = self._solver(priors[tile])
            blend.lay(solver, places)
            windows = blend.grid.code_windows(blend.code, spread_out(places, _SAMPLES))
            unknown[tile] = _Unknown.of(priors[tile], solver.posterior(windows))
            progress(done / len(parts))
        found = blend.estimate()
        return priors | {tile: self._fitted(tile, priors[tile], found, unknown[tile]) for tile in parts}

    def _fitted(self, tile: Tile, prior: GaussianPrior, found: Estimate, unknown: _Unknown) -> GaussianPrior:
        assert found.scatter is not None
        around = (slice(None), *self.tiling.area(tile, _MARGIN, self.model.block[1:]))
        inside = (slice(None), *self.tiling.area(tile, 0, (1, 1)))
        moments = unknown.blended(float(found.scatter[0][inside].mean()))
        return refitted(prior, found.estimate[0][around].clamp_min(0), moments)

    def _blend(self, priors: dict[Tile, GaussianPrior], *, uncertainty: bool = False, scatter: bool = False) -> Blend:
        solver = self._solver(priors[self.tiling.tiles[len(self.tiling.tiles) // 2]])
        return Blend.of(
            solver, self.model, self.snapshot, self.taps, self.stride, uncertainty=uncertainty, scatter=scatter
        )

    def _solver(self, prior: GaussianPrior) -> GaussianSolver:
        return GaussianSolver(prior, self.model, Noise(self.read_noise, self.shot), self.dtype)


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
        """Moments of the blended estimate's error.

        The blend errs less than single blocks, by just the variance of what they say of the same pixel.
        """
        single = self.moments[:, :, 0, 0].diagonal().mean()
        return self.moments * ((self.variance - scatter) / single).clamp_min(0)


def _share(progress: Callable[[float], None] | None, place: int, count: int) -> Callable[[float], None]:
    """Turn the share of one of several parts into the share of all."""
    return lambda share: progress((place + share) / count) if progress else None
