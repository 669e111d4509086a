"""Gaussian prior of small scene blocks: mean and covariance, learned from example scenes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.priors.prior import Prior
from tmca.priors.statistics import (
    autocovariance,
    directed_autocovariance,
    scenes,
    toeplitz_rows,
    two_sided,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Variance of what examples cannot tell (quantisation, noise of the example camera), in squared irradiance.
FLOOR = 1e-6


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
        """(L, h, w)."""
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
        return two_sided(self.moments) if self.mirrored else self.moments

    @cached_property
    def covariance(self) -> Tensor:
        """(n, n) covariance of the flattened block, float64."""
        if not self.stationary:
            return self.moments
        return toeplitz_rows(self.displaced, torch.arange(self.mean.numel(), device=self.mean.device))

    @property
    def variance(self) -> Tensor:
        """(n,) variance of the flattened block, float64."""
        if not self.stationary:
            return self.moments.diagonal()
        row, column = (0, 0) if self.mirrored else (self.block[1] - 1, self.block[2] - 1)
        return self.moments[:, :, row, column].diagonal().repeat_interleave(self.mean[0].numel())

    def rows(self, pixels: Tensor, dtype: torch.dtype) -> Tensor:
        """(..., n) rows of the covariance that belong to the flat indices ``pixels`` (...), without the whole of it."""
        if not self.stationary:
            return self.moments.to(dtype)[pixels]
        return toeplitz_rows(self.displaced.to(dtype), pixels)

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

        Raises:
            ShapeError: no cube, different band counts, or a block larger than a cube.
            DataError: values that are not finite.
        """
        examples = scenes(cubes, block, views)
        if floor < 0:
            raise SettingError("floor", f"{floor}", "≥ 0")
        if views is None:
            mean, moments = autocovariance(examples, block)
            same = moments[:, :, 0, 0]
        else:
            mean, moments = directed_autocovariance(examples, block, views)
            same = moments[:, :, block[0] - 1, block[1] - 1]
        same += floor * torch.eye(len(same), dtype=same.dtype)  # a view: of a pixel with itself
        lengths = None if wavelengths is None else tuple(float(v) for v in wavelengths)
        return cls(mean, moments, lengths, tuple(sources))

    def scaled(self, gain: float) -> GaussianPrior:
        """The prior of the same scenes under ``gain`` times the light: what noise does depends on it.

        Raises:
            SettingError: a gain that is not above 0.
        """
        if not gain > 0:
            raise SettingError("gain", f"{gain}", "a number above 0")
        return replace(self, mean=gain * self.mean, moments=gain**2 * self.moments)

    def around(self, mean: Tensor) -> GaussianPrior:
        """A stationary prior's second moments around another mean (L, h, w)."""
        away = (self.mean - mean)[:, 0, 0]
        return replace(self, mean=mean, moments=self.moments + torch.outer(away, away)[:, :, None, None])

    def sample(self, count: int, seed: int) -> Tensor:
        """(count, L, h, w) random blocks of this prior."""
        generator = torch.Generator().manual_seed(seed)
        white = torch.randn(count, self.mean.numel(), generator=generator, dtype=torch.float64)
        return self.mean + (white @ torch.linalg.cholesky(self.covariance).mT).reshape(count, *self.block)

    def figure(self) -> Figure:
        """Leading eigen-blocks, mean spectrum and eigenvalues."""
        from tmca.plots.priors import gaussian_figure

        return gaussian_figure(self.mean.numpy(), self.covariance.numpy(), self.wavelengths)

    def arrays(self) -> dict[str, Tensor]:
        """Mean and moments."""
        return {"mean": self.mean, "autocovariance" if self.stationary else "covariance": self.moments}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        """The prior of a file."""
        name = "autocovariance" if "autocovariance" in arrays else "covariance"
        return cls(arrays["mean"], arrays[name], about["wavelengths"], about["sources"])


def pooled(priors: Sequence[GaussianPrior], weights: Sequence[float] | None = None) -> GaussianPrior:
    """The prior of a scene that is one of several, each with a stationary prior of its own.

    With weights in proportion to the scenes' areas it is the prior that ``GaussianPrior.learn`` finds from all of them.

    Args:
        priors: stationary, of the same block and wavelengths.
        weights: share of each, in any unit; equal if None.

    Raises:
        SettingError: no priors, weights that are not positive, or a prior that is not stationary.
        ShapeError: priors of different blocks.
    """
    if not priors or any(not prior.stationary for prior in priors):
        raise SettingError("pooled", f"{len(priors)} priors", "one stationary prior at least")
    if len({(prior.block, prior.mirrored) for prior in priors}) > 1:
        raise ShapeError("pooled", f"blocks {sorted({prior.block for prior in priors})}", "one block for all")
    shares = torch.ones(len(priors)) if weights is None else torch.tensor(list(weights))
    if len(shares) != len(priors) or not bool((shares > 0).all()):
        raise SettingError("weights", f"{shares.tolist()}", f"{len(priors)} numbers above 0")
    parts = list(zip((shares.double() / shares.double().sum()).tolist(), priors, strict=True))
    mean = torch.stack([share * prior.mean for share, prior in parts]).sum(0)
    moments = torch.stack([share * prior.around(mean).moments for share, prior in parts]).sum(0)
    return replace(priors[0], mean=mean, moments=moments, sources=tuple(s for prior in priors for s in prior.sources))
