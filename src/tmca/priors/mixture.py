"""Gaussian-mixture prior of small scene blocks, kinds of texture at several brightnesses, and its posterior.

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
from tmca.operators.blocks import BlockModel
from tmca.priors.gaussian import GaussianPrior, GaussianSolver, explained_variance, noise_variance, sufficient_precision
from tmca.priors.prior import Prior
from tmca.priors.statistics import (
    FLOOR,
    Kinds,
    checked_cubes,
    leading_eigenvectors,
    lower_factor,
    normalised,
    random_blocks,
)
from tmca.sensor import Noise

_NEGLIGIBLE, _NOTHING = 1e-2, 1e-6
"""Components less probable add nothing worth their time to the variance, and to the mean."""
_BEHIND, _CANDIDATES, _GLANCE_ROWS = 10.0, 8, 2
"""A quick look at some of a block's rows rules out components this far (in log probability) behind the best one, and
keeps no more than this number for each measurement."""
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


@dataclass(frozen=True)
class Components:
    """Likely components of one block: index of kind and gain, and factors of their measurement covariance.

    Args:
        kinds: (M,) index of the kind.
        gains: (M,) brightness, float64.
        factors: (M, m, m) lower Cholesky factors, float64.
        expected: (M, m) expected measurements, float64.
        log_weights: (M,) log of the prior probability.
    """

    kinds: Tensor
    gains: Tensor
    factors: Tensor
    expected: Tensor
    log_weights: Tensor

    def shares(self, measured: Tensor) -> tuple[Tensor, Tensor]:
        """(M, N) log of the joint density of component and measurements (N, m), and (M, N, m) the solved residuals."""
        residual = (measured.double() - self.expected[:, None]).mT
        white = torch.linalg.solve_triangular(self.factors, residual, upper=False)
        half_log_det = self.factors.diagonal(dim1=1, dim2=2).log().sum(1)
        logs = (self.log_weights - half_log_det)[:, None] - 0.5 * white.square().sum(1)
        return logs, torch.linalg.solve_triangular(self.factors.mT, white, upper=True).mT


@dataclass(frozen=True)
class MixturePosterior:
    """What the measurements of P blocks say, by the components that they make likely.

    Args:
        solver: the prior in the precision of the heavy products.
        cross: (m, P, n) covariance A S of measurements with pixels under the base.
        signal: (P, m, m) covariance A S Aᵀ of measurements under the base.
        inside: (P, m, d) A U.
        centre: (P, m) expected measurements A μ of the base.
    """

    solver: MixtureSolver
    cross: Tensor
    signal: Tensor
    inside: Tensor
    centre: Tensor

    def moments(
        self, blocks: Sequence[int], measured: Sequence[Tensor], with_variance: bool
    ) -> list[tuple[Tensor, Tensor | None]]:
        """As of `tmca.priors.gaussian.BlockPosterior`."""
        return [self._moments(block, one, with_variance) for block, one in zip(blocks, measured, strict=True)]

    def _moments(self, block: int, measured: Tensor, with_variance: bool) -> tuple[Tensor, Tensor | None]:
        likely = self.components(block, *self._likely(block, measured))
        logs, solved = likely.shares(measured)
        share = torch.softmax(logs, 0)
        estimate = self._mean(block, likely, share, solved)
        if not with_variance:
            return estimate, None
        return estimate, self._variance(block, likely, share, solved, estimate)

    def components(self, block: int, kinds: Tensor, levels: Tensor, some: slice | Tensor = slice(None)) -> Components:
        """Components (kinds, levels) of one block, seen through ``some`` of its measurements."""
        s, prior = self.solver, self.solver.prior
        inside, gains = self.inside[block, some], prior.gains[levels]
        used, place = kinds.unique(return_inverse=True)
        base = self.signal[block, some][:, some]
        whole = prior.scales[used, None, None] * base.double() + (inside @ s.changes[used] @ inside.mT).double()
        expected = gains[:, None] * (self.centre[block, some] + s.means[kinds] @ inside.mT).double()
        noise = noise_variance(expected, s.noise)
        factors = lower_factor(gains[:, None, None] ** 2 * whole[place] + torch.diag_embed(noise))
        return Components(kinds, gains, factors, expected, prior.weights[kinds, levels].log())

    def _likely(self, block: int, measured: Tensor) -> tuple[Tensor, Tensor]:
        """Kinds and gain levels that a few rows of the measurements (N, m) do not rule out."""
        prior, some = self.solver.prior, self.solver.glance
        kinds, levels = prior.weights.shape
        every = torch.cartesian_prod(torch.arange(kinds), torch.arange(levels)).reshape(-1, 2).to(measured.device)
        if len(every) == 1:
            return every[:, 0], every[:, 1]
        logs, _ = self.components(block, every[:, 0], every[:, 1], some).shares(measured[:, some])
        best = logs.topk(min(_CANDIDATES, len(logs)), dim=0)
        keep = best.indices[best.values > best.values[0] - _BEHIND].unique()
        return every[keep, 0], every[keep, 1]

    def _mean(self, block: int, likely: Components, share: Tensor, solved: Tensor) -> Tensor:
        """(N, n) mean of the component estimates by shares (M, N); ``solved`` (M, N, m) is G⁻¹(y - A μ)."""
        s = self.solver
        some, of = (share > _NOTHING).nonzero(as_tuple=True)  # few components matter to each of the N
        kinds, light = likely.kinds[some], share[some, of] * likely.gains[some]
        pulled = (light * likely.gains[some])[:, None] * solved[some, of]
        inside, tilt = pulled.to(s.dtype) @ self.inside[block], light[:, None].to(s.dtype) * s.means[kinds]
        for kind in kinds.unique():
            members = (kinds == kind).nonzero()[:, 0]
            tilt = tilt.index_add(0, members, inside[members] @ s.changes[kind])

        def gathered(values: Tensor) -> Tensor:
            """Sum over the components of each measurement."""
            return values.new_zeros(share.shape[1], *values.shape[1:]).index_add(0, of, values)

        whole = gathered(s.prior.scales[kinds, None] * pulled).to(s.dtype) @ self.cross[:, block]
        return whole + gathered(tilt) @ s.basis.mT + gathered(light)[:, None].to(s.dtype) * s.centre

    def _variance(self, block: int, likely: Components, share: Tensor, solved: Tensor, estimate: Tensor) -> Tensor:
        """(N, valid) variance within the components plus that between them."""
        pick = self.solver.model.in_valid
        total, weight = torch.zeros_like(pick(estimate)), torch.zeros_like(estimate[:, :1])
        for index in (share.amax(1) > _NEGLIGIBLE).nonzero()[:, 0].tolist():
            probability = share[index].to(estimate.dtype)[:, None]
            alone = torch.zeros_like(share)
            alone[index] = 1
            away = pick(self._mean(block, likely, alone, solved) - estimate)
            total += probability * (self._within(block, likely, index) + away.square())
            weight += probability
        return total / weight

    def _within(self, block: int, likely: Components, index: int) -> Tensor:
        """(valid,) posterior variance of one component."""
        s, kind = self.solver, int(likely.kinds[index])
        scale, square = float(s.prior.scales[kind]), float(likely.gains[index]) ** 2
        cross = scale * s.model.in_valid(self.cross[:, block]) + self.inside[block] @ s.changes[kind] @ s.valid_basis
        before = s.model.in_valid(scale * s.variance + s.tilts[kind])
        return (square * before - square**2 * explained_variance(likely.factors[index], cross)).clamp(min=0)


class MixtureSolver:
    """The posteriors of blocks under one prior, camera and noise; arguments as in `GaussianSolver`."""

    def __init__(
        self, prior: GaussianMixturePrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None
    ) -> None:
        self.prior, self.model, self.noise = prior, model, noise
        self.dtype = dtype or sufficient_precision(prior.base, model, noise)
        self.centre, self.basis = prior.base.mean.reshape(-1).to(self.dtype), prior.basis.to(self.dtype)
        self.means, self.changes = prior.means.to(self.dtype), prior.changes.to(self.dtype)
        self.variance = prior.decoupled.diagonal().to(self.dtype)
        self.tilts = torch.stack([((self.basis @ change) * self.basis).sum(1) for change in self.changes])
        self.rows = prior.decoupled.to(self.dtype)[model.pixels()]
        self.valid_basis = model.in_valid(self.basis.mT)
        self.glance = _glance(model)

    def posterior(self, windows: Tensor, estimates: float | None = None, variance: bool = False) -> MixturePosterior:
        """The posterior of blocks under code windows (P, taps, h, w), computed in one way, whatever is asked for."""
        model, weights = self.model, self.model.complete(windows.to(self.dtype))
        cross = model.cross_covariance(weights, self.rows)
        signal = model.measure(weights, cross).transpose(0, 1)
        inside = model.measure(weights, self.basis.mT[:, None].expand(-1, len(windows), -1)).permute(1, 2, 0)
        centre = model.measure(weights, self.centre.expand(len(windows), -1))
        return MixturePosterior(self, cross, signal, inside.contiguous(), centre)

    def typical_variance(self, windows: Tensor) -> Tensor:
        """(n,) posterior variance of each pixel under the base, averaged over code windows."""
        return GaussianSolver(self.prior.base, self.model, self.noise, self.dtype).typical_variance(windows)


def _glance(model: BlockModel) -> Tensor:
    """Indices of the measurements of a few rows of a block, evenly through its height, in every bucket."""
    rows = model.block[1]
    count = min(_GLANCE_ROWS, rows)
    chosen = torch.tensor(
        [r * rows + (2 * i + 1) * rows // (2 * count) for r in range(model.buckets) for i in range(count)]
    )
    return (chosen[:, None] * model.columns + torch.arange(model.columns)).flatten()
