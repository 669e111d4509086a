"""Expected error of the best linear estimate of scene blocks as a function of the code alone, with its derivative.

With the code's weights A, the prior covariance S of a block and its judged pixels J, the error is
``tr S_JJ - tr G⁻¹ M`` with ``G = A S Aᵀ + noise`` and ``M = A S_·J S_J· Aᵀ``. Both G and M are quadratic in the weights
with coefficients that depend on neither code nor noise: the covariances of the pixels that the taps bring together.
They are kept, so that a code costs a few thousandths of what its whole posterior does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from tmca.priors.blocks import BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.posterior import noise_variance
from tmca.sensor import Noise


@dataclass(frozen=True)
class BlockMse:
    """Mean squared error over the judged pixels of blocks, for m measurements of T taps each.

    Args:
        model: geometry of the blocks.
        covariance: (m, T, m, T) prior covariance S of the pixels under the taps.
        reach: (m, T, m, T) their covariances with the judged pixels multiplied up, ``S_·J S_J·``.
        mean: (m, T) prior mean of the same pixels.
        variance: mean prior variance of a judged pixel.
        read_noise: standard deviation, in snapshot units.
        shot: variance of the shot noise per snapshot unit.
    """

    model: BlockModel
    covariance: Tensor
    reach: Tensor
    mean: Tensor
    variance: float
    read_noise: float = 0.0
    shot: float = 0.0

    @classmethod
    def of(cls, prior: GaussianPrior, model: BlockModel, read_noise: float = 0.0, shot: float = 0.0) -> BlockMse:
        """What a prior says of blocks of this geometry.

        Raises:
            SettingError: negative noise.
        """
        Noise(read_noise, shot)  # refuses a negative one
        pixels = model.pixels()
        flat, shape = pixels.flatten(), (*pixels.shape, *pixels.shape)
        rows = prior.rows(flat, torch.float64)
        judged = model.in_judged(rows)
        reach = (judged @ judged.mT) / judged.shape[1]
        variance = float(model.in_judged(prior.variance).mean())
        mean = prior.mean.reshape(-1).double()[pixels]
        return cls(model, rows[:, flat].reshape(shape), reach.reshape(shape), mean, variance, read_noise, shot)

    def under(self, read_noise: float, shot: float) -> BlockMse:
        """The same blocks under another noise.

        Raises:
            SettingError: negative noise.
        """
        Noise(read_noise, shot)  # refuses a negative one
        return replace(self, read_noise=read_noise, shot=shot)

    def __call__(self, windows: Tensor) -> Tensor:
        """(P,) mean squared errors of blocks under code windows (P, taps, h, w), in squared irradiance; differentiable.

        ``tmca.priors.expected_mse`` of the same windows gives the same.
        """
        weights = self.model.complete(windows.double()).flatten(2).mT
        found: Tensor = _Error.apply(weights, self)
        return found


@dataclass(frozen=True)
class Products:
    """What the weights (P, m, T) of blocks make of a ``BlockMse``.

    Args:
        covariant: (m, P, m, T) covariance of every measurement with the pixels under the taps of every other.
        reaching: the same of the judged products.
        inverse: (P, m, m) G⁻¹.
        reached: (P, m, m) M.
    """

    covariant: Tensor
    reaching: Tensor
    inverse: Tensor
    reached: Tensor

    @classmethod
    def of(cls, error: BlockMse, weights: Tensor) -> Products:
        """Both quadratic forms and the inverse."""
        covariant, spread = quadratic(error.covariance, weights)
        reaching, reached = quadratic(error.reach, weights)
        expected = (weights * error.mean).sum(-1)
        noise = noise_variance(expected, Noise(error.read_noise, error.shot))
        factor = torch.linalg.cholesky(spread + torch.diag_embed(noise))
        return cls(covariant, reaching, torch.cholesky_inverse(factor), reached)

    @property
    def error_removed(self) -> Tensor:
        """(P,) tr G⁻¹ M."""
        return (self.inverse * self.reached).sum((1, 2))

    @property
    def sandwiched(self) -> Tensor:
        """(P, m, m) G⁻¹ M G⁻¹."""
        return self.inverse @ self.reached @ self.inverse


def quadratic(form: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Half applied (m, P, m, T) and wholly applied (P, m, m) quadratic form of weights (P, m, T)."""
    measurements, taps = form.shape[:2]
    half = torch.bmm(weights.transpose(0, 1), form.reshape(measurements, taps, -1))
    half = half.unflatten(-1, (measurements, taps))
    return half, torch.einsum("ipjt,pjt->pij", half, weights)


class _Error(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, weights: Tensor, error: BlockMse) -> Tensor:
        found = Products.of(error, weights)
        if ctx.needs_input_grad[0]:
            ctx.save_for_backward(_gradient(found, error, weights))
        return error.variance - found.error_removed

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        (gradient,) = ctx.saved_tensors
        return grads[0][:, None, None] * gradient, None


def _gradient(found: Products, error: BlockMse, weights: Tensor) -> Tensor:
    """(P, m, T) derivative of every block's error in its weights."""
    sandwiched = found.sandwiched
    kept = torch.einsum("pij,jpit->pit", sandwiched, found.covariant)
    removed = torch.einsum("pij,jpit->pit", found.inverse, found.reaching)
    lit = (weights * error.mean).sum(-1) > 0
    noise = error.shot * (sandwiched.diagonal(dim1=1, dim2=2) * lit)[..., None] * error.mean
    return 2 * (kept - removed) + noise
