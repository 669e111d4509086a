"""Errors that a Gaussian prior expects of the linear estimate of its blocks, and a prior refitted with them."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError, check_range
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.operators.taps import Taps
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.gaussian_posterior import BlockPosterior, GaussianSolver
from tmca.priors.statistics import stationary_moments
from tmca.sensor import Noise

_TOGETHER = 8
"""Blocks whose matrices are held at once."""


def expected_mse(prior: GaussianPrior, taps: Taps, noise: Noise, *, blocks: int = 32, seed: int = 0) -> Tensor:
    """Expected mean squared error of the linear estimate of single blocks; differentiable in ``taps.code``.

    The mean of the posterior variance over the valid columns of ``blocks`` at random places of the frame. Overlapping
    blocks, blended, do somewhat better than this.

    Returns:
        Scalar, in squared irradiance. ``-10 log10`` of it is the expected PSNR.

    Raises:
        ShapeError: the prior's bands or block do not fit the taps.
        SettingError: no blocks.
    """
    check_range("blocks", blocks, 1)
    model = BlockModel.of(taps, prior.block)
    height, width = taps.code.shape[1:]
    grid = BlockGrid.cover(model, (height, width), (height, width))
    solver, padded = GaussianSolver(prior, model, noise, torch.float64), grid.pad_code(taps.code)
    (first, last), places = model.valid, _places(grid, blocks, seed)
    total = padded.new_zeros((), dtype=torch.float64)
    for start in range(0, blocks, _TOGETHER):
        windows = grid.code_windows(padded, places[start : start + _TOGETHER])
        variance = solver.posterior(windows).error_variance().unflatten(1, prior.block)
        total = total + variance[..., first:last].mean((1, 2, 3)).sum()
    return total / blocks


def expected_psnr(prior: GaussianPrior, taps: Taps, noise: Noise) -> float:
    """``expected_mse`` as a peak signal-to-noise ratio in dB."""
    return float(-10 * torch.log10(expected_mse(prior, taps, noise)))


def _places(grid: BlockGrid, count: int, seed: int) -> list[tuple[int, int]]:
    """Corners (top, left) of ``count`` blocks, uniformly random over the frame."""
    share = torch.rand(count, 2, generator=torch.Generator().manual_seed(seed)).tolist()
    (top, bottom), (left, right) = (grid.tops[0], grid.tops[-1]), (grid.lefts[0], grid.lefts[-1])
    return [(top + int(v * (bottom - top + 1)), left + int(u * (right - left + 1))) for v, u in share]


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
    model, (bands, h, _) = posterior.solver.model, prior.block
    width = model.valid[1] - model.valid[0]
    removed = torch.zeros(bands, bands, h, width, dtype=torch.float64, device=prior.moments.device)
    for factor, cross in zip(posterior.factor, posterior.cross.unbind(1), strict=True):
        part = model.in_valid(cross)
        white = torch.linalg.solve_triangular(factor.to(part.dtype), part, upper=False)
        removed += _correlation(white.unflatten(1, (bands, h, width))) / len(posterior.factor)
    pairs = (h - torch.arange(h)[:, None]) * (width - torch.arange(width))
    unknown = torch.zeros_like(prior.moments)
    unknown[..., :width] = (prior.moments[..., :width] * pairs.to(prior.moments) - removed) / (h * width)
    return unknown


def _correlation(parts: Tensor) -> Tensor:
    """(L, L, h, w) sum over m of the correlations by distance of parts (m, L, h, w) with themselves, all four ways."""
    h, w = parts.shape[2:]
    spectrum = torch.fft.rfft2(parts, s=(2 * h, 2 * w))
    total = torch.fft.irfft2(torch.einsum("mayx,mbyx->abyx", spectrum, spectrum.conj()), s=(2 * h, 2 * w))
    for axis in (-2, -1):
        total = (total + total.flip(axis).roll(1, axis)) / 2
    return (total + total.transpose(0, 1))[..., :h, :w] / 2


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
    mean, moments = stationary_moments([estimate.double()], (rows, columns))
    return replace(prior, mean=mean, moments=moments + unknown)
