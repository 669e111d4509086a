"""The Gaussian posterior of scene blocks given their complete measurements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.priors.blocks import BlockModel
from tmca.priors.gaussian import GaussianPrior

# Variance added to every measurement, in squared snapshot units: G stays invertible without noise and without light.
NOISE_FLOOR = 1e-9


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

    def moments(self, block: int, measured: Tensor, spread: bool) -> tuple[Tensor, Tensor | None]:
        """Estimate (N, n) of one block and, if ``spread``, the variance (N, judged) of its judged columns."""
        estimate = self.estimate(block, measured)
        if not spread:
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
        read_noise: standard deviation, in snapshot units.
        shot: variance of the shot noise per snapshot unit (full scale / full well).
        dtype: of the heavy products; None takes float32 where the noise allows it.

    Raises:
        SettingError: negative noise.
    """

    def __init__(
        self,
        prior: GaussianPrior,
        model: BlockModel,
        read_noise: float,
        shot: float,
        dtype: torch.dtype | None = None,
    ) -> None:
        check_noise(read_noise, shot)
        self.model, self.read_noise, self.shot = model, read_noise, shot
        self.dtype = dtype or sufficient_precision(prior, model, read_noise, shot)
        self.mean = prior.mean.reshape(-1).to(self.dtype)
        self.variance = prior.variance.to(self.dtype)
        self.rows = prior.rows(model.pixels(), self.dtype)

    def posterior(self, windows: Tensor) -> BlockPosterior:
        """The posterior of blocks under code windows (P, taps, h, w); differentiable in the windows."""
        weights = self.model.complete(windows.to(self.dtype))
        cross = self.model.cross_covariance(weights, self.rows)
        expected = self.model.measure(weights, self.mean.expand(len(windows), -1))
        spread = self.model.measure(weights, cross).transpose(0, 1).double()
        noise = noise_variance(expected, self.read_noise, self.shot)
        factor = torch.linalg.cholesky(spread + torch.diag_embed(noise))
        return BlockPosterior(self.model, self.mean, self.variance, cross, factor, expected)

    def typical_variance(self, windows: Tensor) -> Tensor:
        """(n,) posterior variance of each pixel, averaged over code windows."""
        return self.posterior(windows).error_variance().mean(0)


def check_noise(read_noise: float, shot: float) -> None:
    """Raises SettingError unless both are numbers ≥ 0."""
    if not (read_noise >= 0 and shot >= 0):
        raise SettingError("noise", f"read noise {read_noise}, shot {shot}", "numbers ≥ 0")


def noise_variance(expected: Tensor, read_noise: float, shot: float) -> Tensor:
    """Noise variance, float64, of measurements whose expected values are given."""
    return read_noise**2 + NOISE_FLOOR + shot * expected.double().clamp(min=0)


def sufficient_precision(prior: GaussianPrior, model: BlockModel, read_noise: float, shot: float) -> torch.dtype:
    """float32 where the noise stands well above its rounding errors, float64 where there is next to none."""
    pixels = model.pixels()
    signal = prior.variance[pixels].sum(1).mean()
    noise = read_noise**2 + shot * prior.mean.reshape(-1)[pixels].mean()
    return torch.float32 if noise > 1e-6 * signal else torch.float64
