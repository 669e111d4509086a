"""Gaussian prior of small scene blocks, and the posterior of blocks given what they explain of a snapshot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError, check_range, check_shape
from tmca.operators.blocks import BlockModel, MeasurementCovariance, Smoothing, displacement_pays
from tmca.priors.prior import Prior
from tmca.priors.statistics import FLOOR, checked_cubes, lower_factor, stationary_moments
from tmca.sensor import Noise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SLACK, _ROWS = 1 + 1e-6, 1024
"""By which rounding may exceed a bound, and rows of a covariance that are looked at together."""
NOISE_FLOOR = 1e-9
"""Variance of every measurement, squared snapshot units: G stays invertible without noise and without light."""


@dataclass(frozen=True, eq=False, repr=False)
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
    meanings: ClassVar[Mapping[str, str]] = {
        "mean": "mean of a block, relative irradiance",
        "covariance": "covariance of the pixels of a block, channel by channel and row by row",
        "autocovariance": "covariance of two pixels of a block by their displacement, relative irradiance squared",
    }
    mean: Tensor
    moments: Tensor
    wavelengths: tuple[float, ...] | None = None
    sources: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_shape("prior", self.mean, ("L", "h", "w"))
        n, lags = self.mean.numel(), (self.mean.shape[0], *self.mean.shape)
        both = (*lags[:2], *(2 * side - 1 for side in lags[2:]))
        if tuple(self.moments.shape) not in ((n, n), lags, both):
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

    def rows(self, pixels: Tensor, dtype: torch.dtype, columns: slice = slice(None)) -> Tensor:
        """(..., n) rows of the covariance that belong to the flat indices ``pixels`` (...), without the whole of it; of
        some of the block's columns alone, (..., L·h·columns), if asked for."""
        if not self.stationary:
            return self.moments.to(dtype)[pixels].unflatten(-1, self.block)[..., columns].flatten(-3)
        (_, h, w), moments = self.block, self.displaced.to(dtype)
        channel, row, column = torch.unravel_index(pixels, self.block)
        every = moments.unfold(2, h, 1).unfold(3, w, 1)[..., columns]
        return every[channel, :, h - 1 - row, w - 1 - column].flatten(-3)

    def _picture(self) -> Figure:
        """How channels vary together, and how pixels do over their distance."""
        from tmca.plots.thumbnails import Panel, row_figure

        (_, rows, columns), deviation = self.block, self.variance.sqrt().reshape(self.block)
        if not self.stationary:
            return row_figure([Panel("deviation of a block, mean of channels", deviation.mean(0).numpy(force=True))])
        moments, spread = self.displaced, deviation[:, 0, 0]
        together = moments[:, :, rows - 1, columns - 1] / (spread[:, None] * spread)
        apart = moments.diagonal().mean(-1) / spread.square().mean()
        limits: dict[str, Any] = {"colours": "RdBu_r", "low": -1.0, "top": 1.0}
        panels = (
            Panel("correlation of channels", together.numpy(force=True), **limits),
            Panel("of pixels, by displacement", apart.numpy(force=True), bar="correlation", **limits),
        )
        return row_figure(panels)

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
        check_range("count", count, 1, whole=True)
        white = torch.randn(
            count, self.mean.numel(), generator=torch.Generator().manual_seed(seed), dtype=torch.float64
        )
        return self.mean + (white @ lower_factor(self.covariance).mT).reshape(count, *self.block)

    def figure(self) -> Any:
        """Leading eigen-blocks, mean spectrum and eigenvalues."""
        from tmca.plots.priors import gaussian_figure

        return gaussian_figure(self.mean.numpy(), self.covariance.numpy(), self.wavelengths)

    def arrays(self) -> dict[str, Tensor]:
        return {"mean": self.mean, "autocovariance" if self.stationary else "covariance": self.moments}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        moments = arrays["autocovariance" if "autocovariance" in arrays else "covariance"]
        prior = cls(arrays["mean"], moments, about["wavelengths"], about["sources"])
        prior._check_correlations()
        return prior

    def _check_correlations(self) -> None:
        """Raises SettingError where a covariance is larger than the variances of its pixels allow.

        That is what shows at a glance; who solves with it notices whatever else is not positive definite.
        """
        deviation = self.variance.clamp_min(0).sqrt()
        if self.stationary:
            same = deviation[:: self.mean[0].numel()]
            bounds: Tensor = torch.outer(same, same)[:, :, None, None]
            allowed = bool((self.moments.abs() <= _SLACK * bounds).all())
        else:
            parts = zip(self.moments.split(_ROWS), deviation.split(_ROWS), strict=True)
            allowed = all(bool((part.abs() <= _SLACK * torch.outer(some, deviation)).all()) for part, some in parts)
        if not allowed:
            raise SettingError("covariance", "values larger than its variances allow", "one of scene blocks")


@dataclass(frozen=True)
class BlockPosterior:
    """What the measurements of P blocks say about their n pixels, by ``x̂ = μ + S Aᵀ G⁻¹ (y - A μ)``.

    Args:
        solver: the prior in the precision of the heavy products.
        weights: (P, T, R·h, columns) of the T taps of a bucket.
        factor: (P, m, m) lower Cholesky factor of G = A S Aᵀ + noise, float64.
        expected: (P, m) expected measurements A μ.
        known: `cross`, where it is there already.
    """

    solver: GaussianSolver
    weights: Tensor
    factor: Tensor
    expected: Tensor
    known: Tensor | None = None

    @cached_property
    def cross(self) -> Tensor:
        """(m, P, n) covariance A S of measurements with pixels."""
        return self._with(self.solver.rows) if self.known is None else self.known

    @cached_property
    def cross_valid(self) -> Tensor:
        """(m, P, valid) the same of the valid columns."""
        return self._with(self.solver.valid_rows) if self.known is None else self.solver.model.in_valid(self.known)

    def _with(self, rows: Tensor) -> Tensor:
        return self.solver.model.cross_covariance(self.weights, rows)

    def estimate(self, block: int, measured: Tensor) -> Tensor:
        """(N, n) linear minimum-mean-square-error estimate of one block from measurements (N, m)."""
        return self._estimates([block], [measured])[0]

    def _estimates(self, blocks: Sequence[int], measured: Sequence[Tensor]) -> list[Tensor]:
        solver = self.solver
        solved = [self._solved(block, values) for block, values in zip(blocks, measured, strict=True)]
        if self.known is not None:
            return [solver.mean + part @ self._cross[block] for block, part in zip(blocks, solved, strict=True)]
        counts = [len(part) for part in solved]
        seen = torch.tensor(blocks).repeat_interleave(torch.tensor(counts))
        away = solver.smoothing(solver.model.spread(self.weights[seen], torch.cat(solved)))
        return [solver.mean + part for part in away.split(counts)]

    def _solved(self, block: int, measured: Tensor) -> Tensor:
        """(N, m) G⁻¹ (y - A μ) of one block."""
        factor, expected = self._equations[block]
        return torch.cholesky_solve((measured - expected).double().mT, factor).mT.to(self.solver.dtype)

    def log_evidence(self, block: int, measured: Tensor) -> Tensor:
        """(N,) log probability density of measurements (N, m) of one block, up to what depends on m alone."""
        factor, expected = self._equations[block]
        white = torch.linalg.solve_triangular(factor, (measured - expected).double().mT, upper=False)
        return -factor.diagonal().log().sum() - white.square().sum(0) / 2

    def linear(self, block: int) -> tuple[Tensor, Tensor, Tensor]:
        """Of one block: the matrix (m, n) that measurements are multiplied by, the estimate (n,) where they are zero,
        and the variance (n,) of its error."""
        cross, factor, expected = self.cross[:, block], self.factor[block], self.expected[block]
        exact = torch.cholesky_inverse(factor) @ cross.double()
        dark = self.solver.mean - (expected.double() @ exact).to(cross.dtype)
        gain = exact.to(cross.dtype)
        return gain, dark, (self.solver.variance - (cross * gain).sum(0)).clamp(min=0)

    @cached_property
    def _equations(self) -> Sequence[tuple[Tensor, Tensor]]:
        """Factor and expected measurements of every block, unbound at once: the derivative of an index would fill a
        tensor of all blocks for each."""
        return list(zip(self.factor.unbind(0), self.expected.unbind(0), strict=True))

    @cached_property
    def _cross(self) -> Sequence[Tensor]:
        """Covariances with pixels, likewise."""
        return self.cross.unbind(1)

    def error_variance(self) -> Tensor:
        """(P, n) posterior variance of every pixel, the same whatever is measured."""
        pairs = zip(self._equations, self._cross, strict=True)
        explained = [explained_variance(factor, cross) for (factor, _), cross in pairs]
        return (self.solver.variance - torch.stack(explained)).clamp(min=0)

    def valid_variance(self, block: int) -> Tensor:
        """(valid,) the same of one block's valid columns."""
        before = self.solver.model.in_valid(self.solver.variance)
        return (before - explained_variance(self.factor[block], self.cross_valid[:, block])).clamp(min=0)

    def moments(
        self, blocks: Sequence[int], measured: Sequence[Tensor], with_variance: bool
    ) -> list[tuple[Tensor, Tensor | None]]:
        """Estimates (N, n) of some blocks from measurements (N, m) of each and, if asked for, variances (N, valid) of
        their valid columns."""
        pairs = zip(blocks, self._estimates(blocks, measured), strict=True)
        return [
            (one, self.valid_variance(block).expand(len(one), -1) if with_variance else None) for block, one in pairs
        ]


def explained_variance(factor: Tensor, cross: Tensor) -> Tensor:
    """(n,) variance that measurements remove: their covariance has the factor (m, m), that with pixels is (m, n)."""
    inverse = torch.linalg.solve_triangular(factor, torch.eye(len(factor)).to(factor), upper=False).to(cross.dtype)
    explained, start = cross.new_zeros(cross.shape[1:]), 0
    for rows in inverse.chunk(4):  # zero above the diagonal
        end = start + len(rows)
        explained = explained + (rows[:, :end] @ cross[:end]).square_().sum(0)
        start = end
    return explained


class GaussianSolver:
    """The posteriors of blocks under one prior, camera and noise.

    Args:
        prior: of the blocks.
        model: geometry of the camera's taps on the blocks.
        noise: of the sensor.
        dtype: of the heavy products; None takes float32 where the noise allows it.
    """

    def __init__(self, prior: GaussianPrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None) -> None:
        self.prior, self.model, self.noise = prior, model, noise
        self.dtype = dtype or sufficient_precision(prior, model, noise)
        self.mean = prior.mean.reshape(-1).to(self.dtype)
        self.variance = prior.variance.to(self.dtype)

    @cached_property
    def covariance(self) -> MeasurementCovariance:
        """Of measurements, under a stationary prior."""
        return MeasurementCovariance(self.prior.displaced.to(self.dtype), self.model)

    @cached_property
    def smoothing(self) -> Smoothing:
        """Products with the covariance of a stationary prior."""
        return Smoothing(self.prior.displaced.to(self.dtype))

    @cached_property
    def rows(self) -> Tensor:
        """(m, T, n) covariance of the pixels that taps bring to measurements with all pixels."""
        return self.prior.rows(self.model.pixels(), self.dtype)

    @cached_property
    def valid_rows(self) -> Tensor:
        """(m, T, valid) the same with those of the valid columns."""
        if "rows" in vars(self):
            return self.model.in_valid(self.rows)
        return self.prior.rows(self.model.pixels(), self.dtype, slice(*self.model.valid))

    def drop_rows(self) -> None:
        """Free the rows, tens of megabytes that are made again where they are asked for."""
        for name in ("rows", "valid_rows"):
            vars(self).pop(name, None)

    def posterior(self, windows: Tensor, estimates: float | None = None, variance: bool = False) -> BlockPosterior:
        """The posterior of blocks under code windows (P, taps, h, w); differentiable in the windows.

        Args:
            estimates: of each block that will be asked for, which decides how they are computed; None where
                covariances with pixels are asked for.
            variance: of valid columns will be asked for.
        """
        weights = self.model.complete(windows.to(self.dtype))
        expected = self.model.measure(weights, self.mean.expand(len(windows), -1))
        if estimates is not None and self._by_displacement(weights, estimates, variance):
            cross, signal = None, self.covariance(weights)
        else:
            cross = self.model.cross_covariance(weights, self.rows)
            signal = self.model.measure(weights, cross).transpose(0, 1)
        noise = torch.diag_embed(noise_variance(expected, self.noise))
        return BlockPosterior(self, weights, lower_factor(signal.double() + noise), expected, cross)

    def _by_displacement(self, weights: Tensor, estimates: float, variance: bool) -> bool:
        possible = self.prior.stationary and weights.device.type == "cpu" and not weights.requires_grad
        return possible and displacement_pays(self.model, estimates, variance)

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
