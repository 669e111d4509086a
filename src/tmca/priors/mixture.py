"""Gaussian-mixture prior of small scene blocks: kinds of texture, each at several brightnesses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.priors.gaussian import FLOOR, GaussianPrior
from tmca.priors.statistics import random_blocks, scenes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class GaussianMixturePrior:
    """Scene blocks as gain times a sample of one of K Gaussians.

    Kind k has the mean ``base.mean + U m_k`` and the covariance ``s_k S + U (C_k - s_k Λ) Uᵀ``, with S the base's
    covariance, U its leading eigenvectors and Λ their eigenvalues: inside the leading subspace each kind has its own
    covariance C_k, outside it shares the base's up to the factor s_k. At gain g the mean is g and the covariance g²
    times that.

    Args:
        base: Gaussian of the same blocks.
        basis: (n, d) orthonormal leading eigenvectors U.
        means: (K, d) m_k.
        covariances: (K, d, d) C_k.
        scales: (K,) s_k.
        gains: (G,) brightness of each gain.
        weights: (K, G) probability of each kind at each gain.
    """

    base: GaussianPrior
    basis: Tensor
    means: Tensor
    covariances: Tensor
    scales: Tensor
    gains: Tensor
    weights: Tensor

    def __post_init__(self) -> None:
        (n, d), kinds = self.basis.shape, len(self.means)
        shapes = [tuple(a.shape) for a in (self.means, self.covariances, self.scales, self.weights)]
        expected = [(kinds, d), (kinds, d, d), (kinds,), (kinds, len(self.gains))]
        if n != self.base.mean.numel() or shapes != expected:
            raise ShapeError("mixture prior", f"{shapes} on a basis {(n, d)}", f"{expected}")

    @property
    def block(self) -> tuple[int, int, int]:
        """(L, h, w)."""
        return self.base.block

    @cached_property
    def decoupled(self) -> Tensor:
        """(n, n) the base's covariance without what is left between the subspace and the rest: S, to rounding.

        The basis is found by iteration; dropping the remainder keeps every component positive semidefinite.
        """
        reached = self.base.covariance @ self.basis
        across = reached - self.basis @ (self.basis.mT @ reached)
        return self.base.covariance - across @ self.basis.mT - self.basis @ across.mT

    @cached_property
    def changes(self) -> Tensor:
        """(K, d, d) ``C_k - s_k Λ``: what each kind adds to the scaled base inside the subspace."""
        leading = self.basis.mT @ self.decoupled @ self.basis
        return self.covariances - self.scales[:, None, None] * leading

    def component(self, kind: int, gain: int = 0) -> GaussianPrior:
        """One component as a Gaussian prior."""
        g, basis = self.gains[gain], self.basis
        mean = g * (self.base.mean.reshape(-1) + basis @ self.means[kind])
        covariance = self.scales[kind] * self.decoupled + basis @ self.changes[kind] @ basis.mT
        return GaussianPrior(mean.reshape(self.block), g**2 * covariance, self.base.wavelengths, self.base.sources)

    def gaussian(self) -> GaussianPrior:
        """The Gaussian with the mean and covariance of the whole mixture."""
        n = self.base.mean.numel()
        mean, square = torch.zeros(n, dtype=torch.float64), torch.zeros(n, n, dtype=torch.float64)
        for kind in range(len(self.means)):
            part = self.component(kind)
            first = part.mean.flatten() / self.gains[0]
            power = (self.weights[kind] * self.gains**2).sum()
            mean = mean + (self.weights[kind] * self.gains).sum() * first
            square = square + power * (part.covariance / self.gains[0] ** 2 + torch.outer(first, first))
        covariance = square - torch.outer(mean, mean)
        return GaussianPrior(mean.reshape(self.block), covariance, self.base.wavelengths, self.base.sources)

    @classmethod
    def of(cls, prior: GaussianPrior, rank: int = 1) -> GaussianMixturePrior:
        """A mixture of one component that equals the Gaussian prior."""
        basis = leading_eigenvectors(prior, rank)
        leading = basis.mT @ prior.covariance @ basis
        one = torch.ones(1, dtype=torch.float64)
        return cls(prior, basis, one.new_zeros(1, rank), leading[None], one, one, one[None])

    @classmethod
    def learn(
        cls,
        cubes: Iterable[Tensor],
        block: tuple[int, int] = (8, 36),
        *,
        kinds: int = 24,
        rank: int = 200,
        gains: int = 5,
        samples: int = 30000,
        steps: int = 5,
        seed: int = 0,
        floor: float = FLOOR,
        wavelengths: Sequence[float] | None = None,
        sources: Sequence[str] = (),
        views: tuple[int, int] | None = None,
    ) -> GaussianMixturePrior:
        """The mixture of blocks (h, w) cut from example cubes (L, H, W), which may differ in size.

        Blocks are divided by their gain (powers of two below twice the mean brightness), sorted into kinds by
        k-means and refined by ``steps`` of expectation-maximisation in the leading subspace. ``views`` (V, U) says that
        the channels are views, row by row: blocks are mirrored together with them.

        Raises:
            ShapeError: no cube, different band counts, or a block larger than a cube.
            SettingError: fewer than one kind, gain or dimension, or too few samples for them.
            DataError: values that are not finite.
        """
        from tmca.priors.mixture_learning import fit, normalised

        if min(kinds, rank, gains) < 1 or steps < 0 or samples < 10 * kinds:
            raise SettingError(
                "learn",
                f"kinds {kinds}, rank {rank}, gains {gains}, samples {samples}",
                "≥ 1, and 10 samples per kind",
            )
        examples = scenes(cubes, block)
        base = GaussianPrior.learn(examples, block, floor=floor, wavelengths=wavelengths, sources=sources, views=views)
        basis = leading_eigenvectors(base, min(rank, base.mean.numel()))
        blocks = random_blocks(examples, block, samples, seed, mirrored=True, views=views).flatten(1)
        scaled, levels, chosen = normalised(blocks, gains)
        centre = scaled.mean(0)
        base = GaussianPrior(centre.reshape(base.block), base.moments, base.wavelengths, base.sources)
        parts = fit(scaled - centre, basis, base, kinds, steps, seed)
        counts = parts.members.mT @ torch.nn.functional.one_hot(chosen, gains).double() + 1
        return cls(base, basis, parts.means, parts.covariances, parts.scales, levels, counts / counts.sum())

    def to(self, device: torch.device | str) -> GaussianMixturePrior:
        """The prior on a device; itself if it is there."""
        if self.basis.device == torch.device(device):
            return self
        parts = ("basis", "means", "covariances", "scales", "gains", "weights")
        return replace(self, base=self.base.to(device), **{name: getattr(self, name).to(device) for name in parts})

    def sample(self, count: int, seed: int) -> Tensor:
        """(count, L, h, w) random blocks of this prior."""
        generator = torch.Generator().manual_seed(seed)
        drawn = torch.multinomial(self.weights.flatten(), count, replacement=True, generator=generator)
        out = torch.empty(count, *self.block, dtype=torch.float64)
        for index in drawn.unique().tolist():
            here = drawn == index
            kind, gain = divmod(index, len(self.gains))
            out[here] = self.component(kind, gain).sample(int(here.sum()), seed + 1 + index)
        return out

    def figure(self) -> Figure:
        """Leading eigen-blocks, mean spectrum and eigenvalues of the mixture as one Gaussian."""
        return self.gaussian().figure()

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the prior as NetCDF4, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.priors.files import mixture_arrays, write_prior

        base = self.base
        return write_prior(
            path, "gaussian mixture", mixture_arrays(self), base.wavelengths, base.sources, overwrite=overwrite
        )

    @classmethod
    def load(cls, path: str | Path) -> GaussianMixturePrior:
        """Read a prior that ``save`` wrote.

        Raises:
            DataError: no such file, no mixture prior in it, or damaged content.
        """
        from tmca.priors.files import read_prior

        arrays, wavelengths, sources = read_prior(path, "gaussian mixture")
        moments = arrays["autocovariance"] if "autocovariance" in arrays else arrays["covariance"]
        base = GaussianPrior(arrays["mean"], moments, wavelengths, sources)
        parts = ("basis", "kind_mean", "kind_covariance", "kind_scale", "gain_level", "weight")
        return cls(base, *(arrays[name] for name in parts))


def leading_eigenvectors(prior: GaussianPrior, rank: int) -> Tensor:
    """(n, rank) orthonormal eigenvectors of the prior's covariance, largest eigenvalue first.

    Found by subspace iteration from a fixed start, which is enough: the mixture needs a good subspace, and its
    formulas hold for the exact eigenvalues of the covariance inside it.
    """
    n = prior.mean.numel()
    if n <= 4 * rank:
        return torch.linalg.eigh(prior.covariance)[1].flip(1)[:, :rank].contiguous()
    start = torch.randn(n, rank + 20, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for _ in range(12):
        start = torch.linalg.qr(prior.covariance @ start)[0]
    inside = torch.linalg.eigh(start.mT @ prior.covariance @ start)[1].flip(1)[:, :rank]
    return start @ inside
