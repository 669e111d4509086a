"""Gaussian-mixture prior of small scene blocks: kinds of texture, each at several brightnesses.

Example blocks are sorted into kinds by k-means, then by expectation-maximisation in a subspace.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.priors.gaussian import FLOOR, GaussianPrior
from tmca.priors.prior import Prior
from tmca.priors.statistics import random_blocks, scenes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Members of a kind that count as much as the common covariance it is shrunk towards.
SHRINKAGE = 400.0
# Independent dimensions that the light outside the subspace counts for in the likelihood of a kind: neighbouring
# fine details are correlated, so far fewer than there are pixels.
OUTSIDE = 60
_IN_FILES = {
    "basis": "basis",
    "means": "kind_mean",
    "covariances": "kind_covariance",
    "scales": "kind_scale",
    "gains": "gain_level",
    "weights": "weight",
}


@dataclass(frozen=True)
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

    @property
    def wavelengths(self) -> tuple[float, ...] | None:
        """Of the base."""
        return self.base.wavelengths

    @property
    def sources(self) -> tuple[str, ...]:
        """Of the base."""
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
        if min(kinds, rank, gains) < 1 or steps < 0 or samples < 10 * kinds:
            found = f"kinds {kinds}, rank {rank}, gains {gains}, samples {samples}"
            raise SettingError("learn", found, "≥ 1, and 10 samples per kind")
        examples = scenes(cubes, block, views)
        base = GaussianPrior.learn(examples, block, floor=floor, wavelengths=wavelengths, sources=sources, views=views)
        basis = leading_eigenvectors(base, min(rank, base.mean.numel()))
        blocks = random_blocks(examples, block, samples, seed, mirrored=True, views=views).flatten(1)
        scaled, levels, chosen = normalised(blocks, gains)
        centre = scaled.mean(0)
        base = replace(base, mean=centre.reshape(base.block))
        parts = fit(scaled - centre, basis, base, kinds, steps, seed)
        counts = parts.members.mT @ torch.nn.functional.one_hot(chosen, gains).double() + 1
        return cls(base, basis, parts.means, parts.covariances, parts.scales, levels, counts / counts.sum())

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

    def arrays(self) -> dict[str, Tensor]:
        """Those of the base and of the kinds."""
        return self.base.arrays() | {there: getattr(self, name) for name, there in _IN_FILES.items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        """The prior of a file."""
        base = GaussianPrior.from_arrays(arrays, about)
        return cls(base, **{name: arrays[there] for name, there in _IN_FILES.items()})


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


@dataclass(frozen=True)
class Kinds:
    """Moments of K kinds of blocks in a subspace, and (samples, K) the share of each block in each kind."""

    means: Tensor
    covariances: Tensor
    scales: Tensor
    members: Tensor


def normalised(blocks: Tensor, gains: int) -> tuple[Tensor, Tensor, Tensor]:
    """Blocks (N, n) divided by their gain, the gains (G,) and (N,) the gain that each block has.

    Gains are powers of two below twice the mean brightness; a single gain is 1.
    """
    brightness = blocks.mean(1)
    if gains == 1:
        return blocks, blocks.new_ones(1), torch.zeros(len(blocks), dtype=torch.long)
    top = 2 * brightness.mean()
    chosen = (top / brightness.clamp(min=1e-6)).log2().round().clamp(0, gains - 1).long()
    levels = top * 2.0 ** -torch.arange(gains, dtype=torch.float64)
    return blocks / levels[chosen, None], levels, chosen


def fit(centred: Tensor, basis: Tensor, base: GaussianPrior, kinds: int, steps: int, seed: int) -> Kinds:
    """Kinds of centred blocks (N, n) in the subspace ``basis`` (n, d)."""
    inside = centred @ basis
    outside = (centred.square().sum(1) - inside.square().sum(1)).clamp(min=1e-9)
    shared = base.covariance.trace() - (basis * (base.covariance @ basis)).sum()
    members = torch.nn.functional.one_hot(k_means(inside[:, :25], kinds, seed), kinds).double()
    parts = _moments(inside, outside, members)
    for _ in range(steps):
        parts = _moments(inside, outside, torch.softmax(_log_shares(inside, outside, parts), 1))
    return replace(parts, scales=parts.scales / shared.clamp(min=1e-12))


def k_means(points: Tensor, count: int, seed: int, steps: int = 25) -> Tensor:
    """(N,) cluster of each point (N, d); empty clusters start again at a random point."""
    generator = torch.Generator().manual_seed(seed)
    centres = points[torch.randperm(len(points), generator=generator)[:count]]
    for _ in range(steps):
        nearest = torch.cdist(points, centres).argmin(1)
        fresh = points[torch.randint(len(points), (count,), generator=generator)]
        sums = torch.zeros_like(centres).index_add_(0, nearest, points)
        sizes = torch.bincount(nearest, minlength=count)[:, None]
        centres = torch.where(sizes > 0, sums / sizes.clamp(min=1), fresh)
    return torch.cdist(points, centres).argmin(1)


def _moments(inside: Tensor, outside: Tensor, members: Tensor) -> Kinds:
    """Weighted moments of every kind, shrunk to the common covariance at the kind's own energy."""
    counts = members.sum(0) + 1e-9
    means = members.mT @ inside / counts[:, None]
    common = torch.cov(inside.mT, correction=0).reshape(inside.shape[1], -1) + 1e-9 * torch.eye(inside.shape[1])
    covariances = []
    for kind, count in enumerate(counts):
        away = inside - means[kind]
        alone = (away * members[:, kind : kind + 1]).mT @ away / count
        share = SHRINKAGE / (count + SHRINKAGE)
        shrunk = (1 - share) * alone + share * common * (alone.trace() / common.trace())
        covariances.append(shrunk + 1e-9 * torch.eye(len(alone)))
    return Kinds(means, torch.stack(covariances), members.mT @ outside / counts, members)


def _log_shares(inside: Tensor, outside: Tensor, kinds: Kinds) -> Tensor:
    """(N, K) log of the joint density of each block and kind, up to a constant."""
    columns = []
    for mean, covariance, scale, count in zip(
        kinds.means, kinds.covariances, kinds.scales, kinds.members.sum(0), strict=True
    ):
        factor = torch.linalg.cholesky(covariance + 1e-6 * torch.eye(len(mean)))
        white = torch.linalg.solve_triangular(factor, (inside - mean).mT, upper=False)
        distance = white.square().sum(0) + OUTSIDE * (outside / scale + scale.log())
        columns.append((count + 1e-9).log() - factor.diagonal().log().sum() - 0.5 * distance)
    return torch.stack(columns, 1)
