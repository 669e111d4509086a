"""The Gaussian posterior of scene blocks given their complete measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.priors.blocks import NOISE_FLOOR, BlockModel


@dataclass(frozen=True)
class BlockPosterior:
    """What the measurements of P blocks say about their n pixels, by ``x̂ = μ + S Aᵀ G⁻¹ (y - A μ)``.

    Args:
        cross: (measurements, P, n) covariance A S of measurements with pixels.
        factor: (P, measurements, measurements) lower Cholesky factor of G = A S Aᵀ + noise, float64.
        expected: (P, measurements) expected measurements A μ.
    """

    cross: Tensor
    factor: Tensor
    expected: Tensor

    def correction(self, block: int, measured: Tensor) -> Tensor:
        """(..., n) what measurements (..., measurements) of one block add to the prior mean."""
        residual = (measured - self.expected[block]).double().reshape(-1, measured.shape[-1])
        solved = torch.cholesky_solve(residual.mT, self.factor[block]).to(self.cross.dtype)
        return (solved.mT @ self.cross[:, block]).reshape(*measured.shape[:-1], -1)

    def explained(self, pixels: slice | Tensor = slice(None)) -> Tensor:
        """(P, n) prior variance that the measurements remove, at the chosen pixels."""
        factor = self.factor.to(self.cross.dtype)
        cross = self.cross[:, :, pixels].transpose(0, 1)
        return torch.linalg.solve_triangular(factor, cross, upper=False).square().sum(1)

    def log_likelihood(self, block: int, measured: Tensor) -> Tensor:
        """(...) log density of measurements (..., measurements) of one block."""
        residual = (measured - self.expected[block]).double().reshape(-1, measured.shape[-1])
        white = torch.linalg.solve_triangular(self.factor[block], residual.mT, upper=False)
        half_log_det = self.factor[block].diagonal().log().sum()
        value = -0.5 * white.square().sum(0) - half_log_det - 0.5 * len(white) * math.log(2 * math.pi)
        return value.reshape(measured.shape[:-1])


def block_posterior(
    model: BlockModel, mean: Tensor, rows: Tensor, windows: Tensor, read_noise: float, shot: float
) -> BlockPosterior:
    """The posterior of blocks under code windows (P, taps, h, w); differentiable in the windows.

    Args:
        mean: (n,) prior mean.
        rows: (measurements, taps, n) ``covariance[model.pixels()]``; sets the precision of the heavy products.
        read_noise: standard deviation, in snapshot units.
        shot: variance of the shot noise per snapshot unit.
    """
    weights = model.complete(windows.to(rows.dtype))
    cross = model.cross_covariance(weights, rows)
    expected = model.measure(weights, mean.to(rows.dtype).expand(len(windows), -1))
    noise = read_noise**2 + NOISE_FLOOR + shot * expected.double().clamp(min=0)
    spread = model.measure(weights, cross).transpose(0, 1).double()
    factor = torch.linalg.cholesky(spread + torch.diag_embed(noise))
    return BlockPosterior(cross, factor, expected)
