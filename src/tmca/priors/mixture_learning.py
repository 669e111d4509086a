"""Sorting example blocks into kinds: k-means, then expectation-maximisation in a subspace."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.priors.gaussian import GaussianPrior

# Members of a kind that count as much as the common covariance it is shrunk towards.
SHRINKAGE = 400.0
# Independent dimensions that the light outside the subspace counts for in the likelihood of a kind: neighbouring
# fine details are correlated, so far fewer than there are pixels.
OUTSIDE = 60


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
    found = _moments(inside, outside, members)
    for _ in range(steps):
        found = _moments(inside, outside, torch.softmax(_log_shares(inside, outside, found), 1))
    return Kinds(found.means, found.covariances, found.scales / shared.clamp(min=1e-12), found.members)


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
        own = (away * members[:, kind : kind + 1]).mT @ away / count
        share = SHRINKAGE / (count + SHRINKAGE)
        covariances.append(
            (1 - share) * own + share * common * (own.trace() / common.trace()) + 1e-9 * torch.eye(len(own))
        )
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
