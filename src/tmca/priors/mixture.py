"""Gaussian-mixture prior of small scene blocks, kinds of texture at several brightnesses.

Example blocks are sorted into kinds by k-means, then by expectation-maximisation in a subspace.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from tmca.errors import ShapeError, check_range
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.prior import Prior
from tmca.priors.statistics import (
    FLOOR,
    Kinds,
    checked_cubes,
    leading_eigenvectors,
    normalised,
    random_blocks,
)

_IN_FILES = {
    "basis": "basis",
    "means": "kind_mean",
    "covariances": "kind_covariance",
    "scales": "kind_scale",
    "gains": "gain_level",
    "weights": "weight",
}


@dataclass(frozen=True, eq=False, repr=False)
class GaussianMixturePrior(Prior):
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

    kind: ClassVar[str] = "mixture"
    in_files: ClassVar[str] = "gaussian mixture"
    called: ClassVar[str] = "a Gaussian-mixture prior"
    learned_by: ClassVar[str] = "`tmca prior learn … --mixture` (of light fields `learn-views`)"
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **GaussianPrior.dimensions,
        "basis": ("pixel", "direction"),
        "kind_mean": ("kind", "direction"),
        "kind_covariance": ("kind", "direction", "other_direction"),
        "kind_scale": ("kind",),
        "gain_level": ("gain",),
        "weight": ("kind", "gain"),
    }
    meanings: ClassVar[Mapping[str, str]] = {
        **GaussianPrior.meanings,
        "basis": "orthonormal leading directions of the blocks",
        "kind_mean": "mean of a kind of block along the leading directions, beside that of all",
        "kind_covariance": "covariance of a kind of block along the leading directions",
        "kind_scale": "covariance of a kind elsewhere, over that of all blocks",
        "gain_level": "brightness of a gain",
        "weight": "probability of a kind of block at a gain",
    }
    settings_of_views: ClassVar[Mapping[str, Any]] = {"kinds": 8, "rank": 150, "gains": 4, "samples": 16_000}
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
        return self.base.block

    @property
    def wavelengths(self) -> tuple[float, ...] | None:
        return self.base.wavelengths

    @property
    def sources(self) -> tuple[str, ...]:
        return self.base.sources

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
        return replace(self.base, mean=mean.reshape(self.block), moments=g**2 * covariance)

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
        return replace(self.base, mean=mean.reshape(self.block), moments=square - torch.outer(mean, mean))

    @classmethod
    def of(cls, prior: GaussianPrior, rank: int = 1) -> GaussianMixturePrior:
        """A mixture of one component that equals the Gaussian prior."""
        basis = leading_eigenvectors(prior.covariance, rank)
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
            SettingError: fewer than one kind, gain or dimension, or too few samples for them.
        """
        for name, number, least in (("kinds", kinds, 1), ("rank", rank, 1), ("gains", gains, 1), ("steps", steps, 0)):
            check_range(name, number, least, whole=True)
        check_range("samples", samples, 10 * kinds, whole=True, remedy="take ten for each kind")
        examples = checked_cubes(cubes, block, views)
        base = GaussianPrior.learn(examples, block, floor=floor, wavelengths=wavelengths, sources=sources, views=views)
        basis = leading_eigenvectors(base.covariance, min(rank, base.mean.numel()))
        blocks = random_blocks(examples, block, samples, seed, mirrored=True, views=views).flatten(1)
        scaled, levels, chosen = normalised(blocks, gains)
        centre = scaled.mean(0)
        parts = Kinds.fit(scaled - centre, basis, base.covariance, kinds, steps, seed)
        counts = parts.members.mT @ one_hot(chosen, gains).double() + 1
        base = replace(base, mean=centre.reshape(base.block))
        return cls(base, basis, parts.means, parts.covariances, parts.scales, levels, counts / counts.sum())

    def sample(self, count: int, seed: int) -> Tensor:
        check_range("count", count, 1, whole=True)
        generator = torch.Generator().manual_seed(seed)
        drawn = torch.multinomial(self.weights.flatten(), count, replacement=True, generator=generator)
        out = torch.empty(count, *self.block, dtype=torch.float64)
        for index in drawn.unique().tolist():
            here = drawn == index
            kind, gain = divmod(index, len(self.gains))
            out[here] = self.component(kind, gain).sample(int(here.sum()), seed + 1 + index)
        return out

    def figure(self) -> Any:
        """Leading eigen-blocks, mean spectrum and eigenvalues of the mixture as one Gaussian."""
        return self.gaussian().figure()

    def _picture(self) -> Any:
        return self.base._picture()

    def arrays(self) -> dict[str, Tensor]:
        return self.base.arrays() | {there: getattr(self, name) for name, there in _IN_FILES.items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        base = GaussianPrior.from_arrays(arrays, about)
        return cls(base, **{name: arrays[there] for name, there in _IN_FILES.items()})
