"""The Gaussian posterior of scene blocks given their complete measurements, and the error that it expects."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockGrid, BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.sensor import Noise

# Variance added to every measurement, in squared snapshot units: G stays invertible without noise and without light.
NOISE_FLOOR = 1e-9
_TOGETHER = 8
"""Blocks whose matrices are held at once while errors are predicted."""


@dataclass(frozen=True)
class BlockPosterior:
    """What the measurements of P blocks say about their n pixels, by ``x̂ = μ + S Aᵀ G⁻¹ (y - A μ)``.

    Args:
        model: geometry of the blocks.
        mean: (n,) prior mean.
        variance: (n,) prior variance.
        cross: (m, P, n) covariance A S of measurements with pixels.
        factor: (P, m, m) lower Cholesky factor of G = A S Aᵀ + noise, float64.
        expected: (P, m) expected measurements A μ.
    """

    model: BlockModel
    mean: Tensor
    variance: Tensor
    cross: Tensor
    factor: Tensor
    expected: Tensor

    def estimate(self, block: int, measured: Tensor) -> Tensor:
        """(N, n) linear minimum-mean-square-error estimate of one block from measurements (N, m)."""
        cross, factor, expected = self._blocks[block]
        solved = torch.cholesky_solve((measured - expected).double().mT, factor).to(cross.dtype)
        return self.mean + solved.mT @ cross

    @cached_property
    def _blocks(self) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Cross covariance, factor and expected measurements of every block; unbound at once, as the derivative of an
        index would fill a tensor of all blocks for each of them."""
        return list(zip(self.cross.unbind(1), self.factor.unbind(0), self.expected.unbind(0), strict=True))

    def error_variance(self) -> Tensor:
        """(P, n) posterior variance of every pixel, the same whatever is measured."""
        cross = self.cross.transpose(0, 1)
        white = torch.linalg.solve_triangular(self.factor.to(cross.dtype), cross, upper=False)
        return (self.variance - white.square().sum(1)).clamp(min=0)

    def moments(self, block: int, measured: Tensor, with_variance: bool) -> tuple[Tensor, Tensor | None]:
        """Estimate (N, n) of one block and, if asked for, the variance (N, valid) of its valid columns."""
        estimate = self.estimate(block, measured)
        if not with_variance:
            return estimate, None
        removed = explained_variance(self.factor[block], self.model.in_judged(self.cross[:, block]))
        return estimate, (self.model.in_judged(self.variance) - removed).clamp(min=0).expand(len(estimate), -1)


def explained_variance(factor: Tensor, cross: Tensor) -> Tensor:
    """(n,) variance that measurements remove: their covariance has the factor (m, m), that with pixels is (m, n)."""
    inverse = torch.linalg.solve_triangular(
        factor, torch.eye(len(factor), dtype=factor.dtype, device=factor.device), upper=False
    )
    return (inverse.to(cross.dtype) @ cross).square_().sum(0)


class GaussianSolver:
    """The posteriors of blocks of one Gaussian prior under one camera and noise.

    Args:
        prior: of the blocks.
        model: geometry of the camera's taps on the blocks.
        noise: of the sensor.
        dtype: of the heavy products; None takes float32 where the noise allows it.
    """

    def __init__(self, prior: GaussianPrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None) -> None:
        self.model, self.noise = model, noise
        self.dtype = dtype or sufficient_precision(prior, model, noise)
        self.mean = prior.mean.reshape(-1).to(self.dtype)
        self.variance = prior.variance.to(self.dtype)
        self.rows = prior.rows(model.pixels(), self.dtype)

    def posterior(self, windows: Tensor) -> BlockPosterior:
        """The posterior of blocks under code windows (P, taps, h, w); differentiable in the windows."""
        weights = self.model.complete(windows.to(self.dtype))
        cross = self.model.cross_covariance(weights, self.rows)
        expected = self.model.measure(weights, self.mean.expand(len(windows), -1))
        signal = self.model.measure(weights, cross).transpose(0, 1).double()
        factor = torch.linalg.cholesky(signal + torch.diag_embed(noise_variance(expected, self.noise)))
        return BlockPosterior(self.model, self.mean, self.variance, cross, factor, expected)

    def typical_variance(self, windows: Tensor) -> Tensor:
        """(n,) posterior variance of each pixel, averaged over code windows."""
        return self.posterior(windows).error_variance().mean(0)


def noise_variance(expected: Tensor, noise: Noise) -> Tensor:
    """Noise variance, float64, of measurements whose expected values are given."""
    return noise.read**2 + NOISE_FLOOR + noise.shot * expected.double().clamp(min=0)


def sufficient_precision(prior: GaussianPrior, model: BlockModel, noise: Noise) -> torch.dtype:
    """float32 where the noise stands well above its rounding errors, float64 where there is next to none."""
    pixels = model.pixels()
    signal = prior.variance[pixels].sum(1).mean()
    variance = noise.read**2 + noise.shot * prior.mean.reshape(-1)[pixels].mean()
    return torch.float32 if variance > 1e-6 * signal else torch.float64


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
    if blocks < 1:
        raise SettingError("blocks", f"{blocks}", "at least 1")
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
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(count, 2, generator=generator).tolist()
    (top, bottom), (left, right) = (grid.tops[0], grid.tops[-1]), (grid.lefts[0], grid.lefts[-1])
    return [(top + int(v * (bottom - top + 1)), left + int(u * (right - left + 1))) for v, u in share]
