"""Scenes' own priors, and what they are together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from tmca.errors import SettingError, ShapeError
from tmca.priors.gaussian import GaussianPrior


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
    moments = torch.stack([share * around(prior, mean).moments for share, prior in parts]).sum(0)
    sources = tuple(source for prior in priors for source in prior.sources)
    return replace(priors[0], mean=mean, moments=moments, sources=sources)


def around(prior: GaussianPrior, mean: torch.Tensor) -> GaussianPrior:
    """A stationary prior's second moments around another mean (L, h, w)."""
    away = (prior.mean - mean)[:, 0, 0]
    return replace(prior, mean=mean, moments=prior.moments + torch.outer(away, away)[:, :, None, None])


def cropped(prior: GaussianPrior, rows: int, columns: int) -> GaussianPrior:
    """A stationary prior of smaller blocks.

    Raises:
        ShapeError: a larger block, or a prior that is not stationary.
    """
    if not prior.stationary or rows > prior.block[1] or columns > prior.block[2]:
        raise ShapeError("prior", f"blocks {prior.block}", f"a stationary prior of at least {rows}×{columns} pixels")
    mean, (height, width) = prior.mean[:, :rows, :columns], prior.block[1:]
    moments = prior.moments[:, :, :rows, :columns]
    if not prior.mirrored:
        moments = prior.moments[:, :, height - rows : height + rows - 1, width - columns : width + columns - 1]
    return replace(prior, mean=mean.contiguous(), moments=moments.contiguous())
