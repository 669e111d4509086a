"""Gaussian prior of small scene blocks, what a block explains of a snapshot, and its posterior given that.

A block (L, h, w) explains the snapshot's columns whose light comes wholly from inside it; the others are left to the
blocks that see them whole. Blocks may hang over the image's edge, where the code is zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from tmca.errors import ShapeError, check_range
from tmca.operators.taps import Taps
from tmca.priors.prior import Prior
from tmca.priors.statistics import FLOOR, checked_cubes, stationary_moments
from tmca.sensor import Noise

NOISE_FLOOR = 1e-9
"""Variance of every measurement, squared snapshot units: G stays invertible without noise and without light."""


@dataclass(frozen=True)
class GaussianPrior(Prior):
    """Scene blocks x of shape (L, h, w) as samples of one Gaussian.

    Args:
        mean: (L, h, w) mean irradiance, float64.
        moments: (n, n) covariance of the flattened block, n = L·h·w; or (L, L, h, w) covariance of two pixels by
            their distance in rows and columns, for a prior that is the same everywhere and in mirror image; or
            (L, L, 2h-1, 2w-1) by their displacement, for one that is the same everywhere.
        wavelengths: of the L channels, in metres, or None.
        sources: names (and checksums) of the scenes it was learned from.
    """

    kind: ClassVar[str] = "gaussian"
    called: ClassVar[str] = "a Gaussian prior"
    learned_by: ClassVar[str] = "`tmca prior learn` (of light fields `learn-views`)"
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "mean": ("channel", "y", "x"),
        "covariance": ("pixel", "other_pixel"),
        "autocovariance": ("channel", "other_channel", "dy", "dx"),
    }
    mean: Tensor
    moments: Tensor
    wavelengths: tuple[float, ...] | None = None
    sources: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n, lags = self.mean.numel(), (self.mean.shape[0], *self.mean.shape)
        both = (*lags[:2], *(2 * side - 1 for side in lags[2:]))
        if self.mean.ndim != 3 or tuple(self.moments.shape) not in ((n, n), lags, both):
            found = f"mean {tuple(self.mean.shape)} with moments {tuple(self.moments.shape)}"
            raise ShapeError("prior", found, f"{(n, n)}, {lags} or {both}")
        if self.wavelengths is not None and len(self.wavelengths) != self.mean.shape[0]:
            raise ShapeError("wavelengths", f"{len(self.wavelengths)}", f"{self.mean.shape[0]}, one per channel")

    @property
    def block(self) -> tuple[int, int, int]:
        channels, rows, columns = self.mean.shape
        return channels, rows, columns

    @property
    def stationary(self) -> bool:
        """Whether the covariance is the same everywhere."""
        return self.moments.ndim == 4

    @property
    def mirrored(self) -> bool:
        """Whether it is so in mirror image too: it depends on distance only."""
        return self.stationary and self.moments.shape[2:] == self.mean.shape[1:]

    @property
    def displaced(self) -> Tensor:
        """(L, L, 2h-1, 2w-1) covariance by displacement of a stationary prior."""
        if not self.mirrored:
            return self.moments
        both = torch.cat([self.moments[:, :, 1:].flip(2), self.moments], 2)
        return torch.cat([both[..., 1:].flip(3), both], 3)

    @cached_property
    def covariance(self) -> Tensor:
        """(n, n) covariance of the flattened block, float64."""
        every = torch.arange(self.mean.numel(), device=self.mean.device)
        return self.rows(every, self.moments.dtype) if self.stationary else self.moments

    @property
    def variance(self) -> Tensor:
        """(n,) variance of the flattened block, float64."""
        if not self.stationary:
            return self.moments.diagonal()
        same = self.displaced[:, :, self.block[1] - 1, self.block[2] - 1]
        return same.diagonal().repeat_interleave(self.mean[0].numel())

    def rows(self, pixels: Tensor, dtype: torch.dtype) -> Tensor:
        """(..., n) rows of the covariance that belong to the flat indices ``pixels`` (...), without the whole of it."""
        if not self.stationary:
            return self.moments.to(dtype)[pixels]
        (_, h, w), moments = self.block, self.displaced.to(dtype)
        channel, row, column = torch.unravel_index(pixels, self.block)
        return moments.unfold(2, h, 1).unfold(3, w, 1)[channel, :, h - 1 - row, w - 1 - column].flatten(-3)

    @classmethod
    def learn(
        cls,
        cubes: Iterable[Tensor],
        block: tuple[int, int] = (12, 36),
        *,
        views: tuple[int, int] | None = None,
        floor: float = FLOOR,
        wavelengths: Sequence[float] | None = None,
        sources: Sequence[str] = (),
    ) -> Self:
        """The stationary prior of blocks (h, w) of example cubes (L, H, W), which may differ in size.

        Moments are averaged over every position and its mirror images, which uses all the examples' pixels.

        Args:
            views: (V, U) of light fields, whose views are the channels, row by row, and are mirrored with the pixels.
            floor: variance added to every pixel.
        """
        mean, moments = stationary_moments(checked_cubes(cubes, block, views), block, views, floor)
        lengths = None if wavelengths is None else tuple(float(v) for v in wavelengths)
        return cls(mean, moments, lengths, tuple(sources))

    def scaled(self, gain: float) -> GaussianPrior:
        """The prior of the same scenes under ``gain`` times the light, above 0: what noise does depends on it."""
        check_range("gain", gain, above=0)
        return replace(self, mean=gain * self.mean, moments=gain**2 * self.moments)

    def around(self, mean: Tensor) -> GaussianPrior:
        """A stationary prior's second moments around another mean (L, h, w)."""
        away = (self.mean - mean)[:, 0, 0]
        return replace(self, mean=mean, moments=self.moments + torch.outer(away, away)[:, :, None, None])

    def sample(self, count: int, seed: int) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        white = torch.randn(count, self.mean.numel(), generator=generator, dtype=torch.float64)
        return self.mean + (white @ torch.linalg.cholesky(self.covariance).mT).reshape(count, *self.block)

    def figure(self) -> Any:
        """Leading eigen-blocks, mean spectrum and eigenvalues."""
        from tmca.plots.priors import gaussian_figure

        return gaussian_figure(self.mean.numpy(), self.covariance.numpy(), self.wavelengths)

    def arrays(self) -> dict[str, Tensor]:
        return {"mean": self.mean, "autocovariance" if self.stationary else "covariance": self.moments}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        moments = arrays["autocovariance" if "autocovariance" in arrays else "covariance"]
        return cls(arrays["mean"], moments, about["wavelengths"], about["sources"])


@dataclass(frozen=True)
class BlockModel:
    """Geometry shared by every block of shape (L, h, w) under the same taps.

    Measurement (i, c) of a block is snapshot row i and the c-th complete column.

    Args:
        block: (L, h, w).
        channels: channel of each tap.
        offsets: offset of each tap past the smallest one, in pixels.
        origin: the smallest offset, in pixels.
    """

    block: tuple[int, int, int]
    channels: tuple[int, ...]
    offsets: tuple[int, ...]
    origin: int

    @classmethod
    def of(cls, taps: Taps, block: tuple[int, int, int]) -> BlockModel:
        """The model of blocks (L, h, w) seen through ``taps``.

        Raises:
            ShapeError: other channel count, or a block no wider than the dispersion.
        """
        origin, span = min(taps.offsets), max(taps.offsets) - min(taps.offsets)
        if block[0] != taps.scene_channels:
            found, wanted = f"{block[0]} channels", f"the {taps.scene_channels} of the codes"
            raise ShapeError("prior", found, wanted, "learn the prior on the same bands")
        if block[2] <= span:
            found, wanted = f"blocks {block[2]} columns wide", f"more than the dispersion of {span}"
            raise ShapeError("prior", found, wanted, "learn wider blocks")
        return cls(block, taps.channels, tuple(o - origin for o in taps.offsets), origin)

    @property
    def span(self) -> int:
        """Columns between the first and the last tap."""
        return max(self.offsets)

    @property
    def columns(self) -> int:
        """Complete snapshot columns of a block."""
        return self.block[2] - self.span

    @property
    def measurements(self) -> int:
        """Complete measurements of a block."""
        return self.block[1] * self.columns

    @property
    def valid(self) -> tuple[int, int]:
        """First and one-past-last block column whose light lands on complete snapshot columns in the most taps."""
        count = [sum(self.span <= x + o < self.block[2] for o in self.offsets) for x in range(self.block[2])]
        seen = [x for x, taps in enumerate(count) if taps == max(count)]
        return seen[0], seen[-1] + 1

    def in_judged(self, values: Tensor) -> Tensor:
        """The part of values (..., L·h·w) that belongs to the valid columns, flat again."""
        first, last = self.valid
        return values.unflatten(-1, self.block)[..., first:last].flatten(-3)

    def pixels(self) -> Tensor:
        """(measurements, taps) flat index, in the block, of the pixel that each tap brings to each measurement."""
        (_, h, w), row = self.block, torch.arange(self.block[1])[:, None, None]
        column = self.span + torch.arange(self.columns)[None, :, None] - torch.tensor(self.offsets)
        return (torch.tensor(self.channels) * h * w + row * w + column).reshape(self.measurements, -1)

    def complete(self, windows: Tensor) -> Tensor:
        """(P, taps, h, columns) the part of code windows (P, taps, h, w) that feeds the complete measurements."""
        parts = [windows[:, t, :, self.span - o : self.span - o + self.columns] for t, o in enumerate(self.offsets)]
        return torch.stack(parts, 1)

    def measure(self, weights: Tensor, blocks: Tensor) -> Tensor:
        """A applied to blocks (..., P, n), with weights (P, taps, h, columns): (..., P, measurements)."""
        bands = blocks.unflatten(-1, self.block).unbind(-3)
        total = blocks.new_zeros(*blocks.shape[:-1], self.block[1], self.columns)
        for t, (channel, o) in enumerate(zip(self.channels, self.offsets, strict=True)):
            light = bands[channel][..., self.span - o : self.span - o + self.columns]
            total = torch.addcmul(total, light, weights[:, t])
        return total.flatten(-2)

    def cross_covariance(self, weights: Tensor, rows: Tensor) -> Tensor:
        """(measurements, P, n) covariance A S of measurements with pixels; ``rows`` is ``covariance[pixels()]``."""
        return torch.bmm(weights.permute(2, 3, 0, 1).flatten(0, 1), rows)


@dataclass(frozen=True)
class BlockGrid:
    """Where blocks are laid over a frame: corners may hang over its edges.

    Args:
        model: geometry of one block.
        frame: (H, W) of the scene.
        tops: first row of each row of blocks.
        lefts: first column of each column of blocks, may be negative.
    """

    model: BlockModel
    frame: tuple[int, int]
    tops: tuple[int, ...]
    lefts: tuple[int, ...]

    @classmethod
    def cover(cls, model: BlockModel, frame: tuple[int, int], stride: tuple[int, int]) -> BlockGrid:
        """Blocks ``stride`` (rows, columns) apart, the last ones flush, whose valid columns cover the frame."""
        (_, h, _), (first, last) = model.block, model.valid
        tops = _starts(frame[0] - h, stride[0])
        lefts = [x - first for x in _starts(frame[1] - (last - first), min(stride[1], model.columns, last - first))]
        return cls(model, frame, tuple(tops), tuple(lefts))

    @property
    def positions(self) -> list[tuple[int, int]]:
        """(top, left) of every block, row by row."""
        return [(top, left) for top in self.tops for left in self.lefts]

    @property
    def padding(self) -> tuple[int, int, int, int]:
        """Zeros to add left, right, above and below the frame so that every block lies inside."""
        _, h, w = self.model.block
        right, below = max(self.lefts) + w - self.frame[1], max(self.tops) + h - self.frame[0]
        return max(0, -min(self.lefts)), max(0, right), 0, max(0, below)

    def pad_code(self, code: Tensor) -> Tensor:
        """A code (taps, H, W) with zeros around, where blocks hang over the frame."""
        return torch.nn.functional.pad(code, self.padding)

    def pad_snapshot(self, snapshot: Tensor) -> Tensor:
        """Snapshots (B, H, W') with zeros around: no light falls there."""
        left, _, _, below = self.padding
        right = max(0, max(self.lefts) + self.model.block[2] + self.model.origin - snapshot.shape[-1])
        return torch.nn.functional.pad(snapshot, (left, right, 0, below))

    def code_windows(self, padded: Tensor, positions: list[tuple[int, int]]) -> Tensor:
        """(P, taps, h, w) windows of a padded code."""
        (_, h, w), left = self.model.block, self.padding[0]
        return torch.stack([padded[:, y : y + h, x + left : x + left + w] for y, x in positions])

    def snapshot_windows(self, padded: Tensor, positions: list[tuple[int, int]]) -> Tensor:
        """(P, B, measurements) complete measurements of each block in padded snapshots."""
        model, first = self.model, self.padding[0] + self.model.origin + self.model.span
        views = [padded[:, y : y + model.block[1], x + first : x + first + model.columns] for y, x in positions]
        return torch.stack(views).flatten(2)


def _starts(slack: int, stride: int) -> list[int]:
    """0, stride, 2·stride … and ``slack`` itself as the last; [0] where there is no slack."""
    return [*range(0, slack, stride), max(0, slack)]


@dataclass(frozen=True)
class BlockPosterior:
    """What the measurements of P blocks say about their n pixels, by ``x̂ = μ + S Aᵀ G⁻¹ (y - A μ)``.

    Args:
        solver: the prior in the precision of the heavy products.
        cross: (m, P, n) covariance A S of measurements with pixels.
        factor: (P, m, m) lower Cholesky factor of G = A S Aᵀ + noise, float64.
        expected: (P, m) expected measurements A μ.
    """

    solver: GaussianSolver
    cross: Tensor
    factor: Tensor
    expected: Tensor

    def estimate(self, block: int, measured: Tensor) -> Tensor:
        """(N, n) linear minimum-mean-square-error estimate of one block from measurements (N, m)."""
        cross, factor, expected = self._blocks[block]
        solved = torch.cholesky_solve((measured - expected).double().mT, factor).to(cross.dtype)
        return self.solver.mean + solved.mT @ cross

    @cached_property
    def _blocks(self) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Cross covariance, factor and expected measurements of every block; unbound at once, as the derivative of an
        index would fill a tensor of all blocks for each of them."""
        return list(zip(self.cross.unbind(1), self.factor.unbind(0), self.expected.unbind(0), strict=True))

    def error_variance(self) -> Tensor:
        """(P, n) posterior variance of every pixel, the same whatever is measured."""
        cross = self.cross.transpose(0, 1)
        white = torch.linalg.solve_triangular(self.factor.to(cross.dtype), cross, upper=False)
        return (self.solver.variance - white.square().sum(1)).clamp(min=0)

    def moments(self, block: int, measured: Tensor, with_variance: bool) -> tuple[Tensor, Tensor | None]:
        """Estimate (N, n) of one block and, if asked for, the variance (N, valid) of its valid columns."""
        estimate = self.estimate(block, measured)
        if not with_variance:
            return estimate, None
        valid = self.solver.model.in_judged
        left = valid(self.solver.variance) - explained_variance(self.factor[block], valid(self.cross[:, block]))
        return estimate, left.clamp(min=0).expand(len(estimate), -1)


def explained_variance(factor: Tensor, cross: Tensor) -> Tensor:
    """(n,) variance that measurements remove: their covariance has the factor (m, m), that with pixels is (m, n)."""
    inverse = torch.linalg.solve_triangular(factor, torch.eye(len(factor)).to(factor), upper=False)
    return (inverse.to(cross.dtype) @ cross).square_().sum(0)


class GaussianSolver:
    """The posteriors of blocks under one prior, camera and noise.

    Args:
        prior: of the blocks.
        model: geometry of the camera's taps on the blocks.
        noise: of the sensor.
        dtype: of the heavy products; None takes float32 where the noise allows it.
    """

    def __init__(self, prior: GaussianPrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None) -> None:
        self.model, self.noise = model, noise
        self.dtype = dtype or sufficient_precision(prior, model, noise)
        self.mean = prior.mean.reshape(-1).to(self.dtype)
        self.variance = prior.variance.to(self.dtype)
        self.rows = prior.rows(model.pixels(), self.dtype)

    def posterior(self, windows: Tensor) -> BlockPosterior:
        """The posterior of blocks under code windows (P, taps, h, w); differentiable in the windows."""
        weights = self.model.complete(windows.to(self.dtype))
        cross = self.model.cross_covariance(weights, self.rows)
        expected = self.model.measure(weights, self.mean.expand(len(windows), -1))
        signal = self.model.measure(weights, cross).transpose(0, 1).double()
        factor = torch.linalg.cholesky(signal + torch.diag_embed(noise_variance(expected, self.noise)))
        return BlockPosterior(self, cross, factor, expected)

    def typical_variance(self, windows: Tensor) -> Tensor:
        """(n,) posterior variance of each pixel, averaged over code windows."""
        return self.posterior(windows).error_variance().mean(0)


def noise_variance(expected: Tensor, noise: Noise) -> Tensor:
    """Noise variance, float64, of measurements whose expected values are given."""
    return noise.read**2 + NOISE_FLOOR + noise.shot * expected.double().clamp(min=0)


def sufficient_precision(prior: GaussianPrior, model: BlockModel, noise: Noise) -> torch.dtype:
    """float32 where the noise stands well above its rounding errors, float64 where there is next to none."""
    pixels = model.pixels()
    signal = prior.variance[pixels].sum(1).mean()
    variance = noise.read**2 + noise.shot * prior.mean.reshape(-1)[pixels].mean()
    return torch.float32 if variance > 1e-6 * signal else torch.float64
