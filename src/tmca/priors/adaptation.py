"""A Gaussian prior refitted to the scene behind one snapshot: the maximisation step of empirical Bayes."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError
from tmca.priors.gaussian import FLOOR, GaussianPrior
from tmca.priors.posterior import BlockPosterior
from tmca.priors.statistics import autocovariance


def refitted(prior: GaussianPrior, estimate: Tensor, unknown: Tensor) -> GaussianPrior:
    """The stationary prior that makes a scene likeliest of which only an estimate and its error's moments are known.

    The expected second moments of the scene are those of the estimate plus those of its error
    (expectation–maximisation, Dempster, Laird and Rubin 1977).

    Args:
        prior: whose block and wavelengths are kept.
        estimate: (L, H, W) of the scene.
        unknown: (L, L, h, w) covariance of its error by distance, as ``error_moments`` gives it.

    Raises:
        ShapeError: an estimate smaller than the prior's block.
    """
    _, rows, columns = prior.block
    if estimate.shape[1] < rows or estimate.shape[2] < columns:
        raise ShapeError("estimate", f"{tuple(estimate.shape)}", f"at least the prior's block {prior.block}")
    mean, moments = autocovariance([estimate.double()], (rows, columns))
    moments = moments + unknown
    moments[:, :, 0, 0] += FLOOR * torch.eye(len(moments), dtype=moments.dtype, device=moments.device)
    return replace(prior, mean=mean, moments=moments)


def error_moments(prior: GaussianPrior, posterior: BlockPosterior) -> Tensor:
    """(L, L, h, w) covariance by distance of what the measurements of blocks leave unknown, averaged over the blocks.

    Only the valid columns count. Pairs are divided by all places of a block, also where the distance leaves fewer
    pairs: the taper keeps every block covariance positive semidefinite.

    Args:
        prior: stationary, of the blocks.
        posterior: of some blocks under it.

    Raises:
        SettingError: a prior that is not stationary.
    """
    if not prior.mirrored:
        found, wanted = "one that is not the same in mirror image", "a stationary prior of cubes"
        raise SettingError("prior", found, wanted, "learn one anew")
    (bands, h, _), (first, last) = prior.block, posterior.model.valid
    width = last - first
    removed = torch.zeros(bands, bands, h, width, dtype=torch.float64, device=prior.moments.device)
    for factor, cross in zip(posterior.factor, posterior.cross.unbind(1), strict=True):
        part = posterior.model.in_judged(cross)
        white = torch.linalg.solve_triangular(factor.to(part.dtype), part, upper=False)
        removed += _correlation(white.unflatten(1, (bands, h, width))) / len(posterior.factor)
    pairs = (h - torch.arange(h)[:, None]) * (width - torch.arange(width))
    before = prior.moments[..., :width] * pairs.to(prior.moments)
    unknown = torch.zeros_like(prior.moments)
    unknown[..., :width] = (before - removed) / (h * width)
    return unknown


def _correlation(parts: Tensor) -> Tensor:
    """(L, L, h, w) sum over m of the correlations by distance of parts (m, L, h, w) with themselves, all four ways."""
    h, w = parts.shape[2:]
    spectrum = torch.fft.rfft2(parts, s=(2 * h, 2 * w))
    total = torch.fft.irfft2(torch.einsum("mayx,mbyx->abyx", spectrum, spectrum.conj()), s=(2 * h, 2 * w))
    for axis in (-2, -1):
        total = (total + total.flip(axis).roll(1, axis)) / 2
    total = (total + total.transpose(0, 1)) / 2
    return total[..., :h, :w]
