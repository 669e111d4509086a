"""Gaussian prior of small scene blocks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError, check_range, check_shape
from tmca.priors.prior import Prior
from tmca.priors.statistics import FLOOR, checked_cubes, lower_factor, stationary_moments

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SLACK, _ROWS = 1 + 1e-6, 1024
"""By which rounding may exceed a bound, and rows of a covariance that are looked at together."""


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
        channel, row, column = pixels // (h * w), pixels // w % h, pixels % w
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

    def cut(self, rows: int, columns: int) -> GaussianPrior:
        """The prior of smaller blocks."""
        (channels, h, w), moments = self.block, self.moments
        if not self.stationary:
            every = moments.reshape(channels, h, w, channels, h, w)
            moments = every[:, :rows, :columns, :, :rows, :columns].reshape((channels * rows * columns,) * 2)
        elif self.mirrored:
            moments = moments[..., :rows, :columns]
        else:
            moments = moments[..., h - rows : h + rows - 1, w - columns : w + columns - 1]
        return replace(self, mean=self.mean[:, :rows, :columns], moments=moments)

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
