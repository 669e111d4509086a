"""Expected error of the best linear estimate of scene blocks as a function of the code alone, with its derivative.

With the code's weights A, the prior covariance S of a block and its valid pixels J, the error is
``tr S_JJ - tr G⁻¹ M`` with ``G = A S Aᵀ + noise`` and ``M = A S_·J S_J· Aᵀ``. Both G and M are quadratic in the weights
with coefficients that depend on neither code nor noise: the covariances of the pixels that the taps bring together.
They are kept, so that a code costs a few thousandths of what its whole posterior does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from tmca.priors.gaussian import BlockModel, GaussianPrior, noise_variance
from tmca.sensor import Noise


@dataclass(frozen=True)
class BlockMse:
    """Mean squared error over the valid pixels of blocks, for m measurements of T taps each.

    Args:
        model: geometry of the blocks.
        covariance: (m, T, m, T) prior covariance S of the pixels under the taps.
        reach: (m, T, m, T) their covariances with the valid pixels multiplied up, ``S_·J S_J·``.
        mean: (m, T) prior mean of the same pixels.
        variance: mean prior variance of a valid pixel.
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
        middle = model.in_judged(rows)
        reach = (middle @ middle.mT) / middle.shape[1]
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
        errors: Tensor = _Error.apply(self.weights(windows), self)
        return errors

    def weights(self, windows: Tensor) -> Tensor:
        """(P, m, T) weights, float64, of the pixels under the taps of every measurement."""
        return self.model.complete(windows.double()).flatten(2).mT


@dataclass(frozen=True)
class Products:
    """What the weights (P, m, T) of blocks make of a ``BlockMse``.

    Args:
        covariant: (m, P, m, T) covariance of every measurement with the pixels under the taps of every other.
        reaching: the same of the valid products.
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
        products = Products.of(error, weights)
        if ctx.needs_input_grad[0]:
            ctx.save_for_backward(_gradient(products, error, weights))
        return error.variance - products.error_removed

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        (gradient,) = ctx.saved_tensors
        return grads[0][:, None, None] * gradient, None


def _gradient(products: Products, error: BlockMse, weights: Tensor) -> Tensor:
    """(P, m, T) derivative of every block's error in its weights."""
    sandwiched = products.sandwiched
    added = torch.einsum("pij,jpit->pit", sandwiched, products.covariant)
    removed = torch.einsum("pij,jpit->pit", products.inverse, products.reaching)
    bright = (weights * error.mean).sum(-1) > 0
    noise = error.shot * (sandwiched.diagonal(dim1=1, dim2=2) * bright)[..., None] * error.mean
    return 2 * (added - removed) + noise


@dataclass(frozen=True)
class BlockState:
    """One block under its present weights, and what changes of a few of them do, without a new factorisation for each.

    A changed pixel of a code changes the weights of r of the m measurements. Then ``G`` and ``M`` change in r rows and
    columns, and ``tr G⁻¹ M`` follows by the Woodbury identity with matrices of size 2r.

    Args:
        error: of such blocks.
        weights: (m, T), float64.
        products: of these weights, a batch of one.
    """

    error: BlockMse
    weights: Tensor
    products: Products

    @classmethod
    def of(cls, error: BlockMse, weights: Tensor) -> BlockState:
        """The state of a block under weights (m, T)."""
        weights = weights.double()
        return cls(error, weights, Products.of(error, weights[None]))

    @property
    def value(self) -> float:
        """Mean squared error over the valid pixels."""
        return self.error.variance - float(self.products.error_removed[0])

    def after(self, changes: Tensor) -> Tensor:
        """(B,) errors under ``weights + changes[b]``, changes (B, m, T), each of them alone."""
        rows, few = _changed_rows(changes)
        inverse, reached = self.products.inverse[0], self.products.reached[0]
        ahead, among = self._forms(self.error.covariance, self.products.covariant, rows, few)
        ahead_reach, among_reach = self._forms(self.error.reach, self.products.reaching, rows, few)
        among = among + torch.diag_embed(self._noise_change(rows, few))
        touched = inverse[:, rows].movedim(0, 1)  # (B, m, r): G⁻¹E
        low = torch.cat([touched, inverse @ ahead.mT], -1)  # G⁻¹U with U = [E, Fᵀ]
        inner = low.gather(1, rows[:, :, None].expand(-1, -1, low.shape[2]))  # Eᵀ G⁻¹ U
        bridge = torch.cat([inner, ahead @ low], 1) + _middle(among)
        turned = inner.mT @ (ahead_reach @ low)
        moved = low.mT @ (reached @ low) + turned + turned.mT + inner.mT @ among_reach @ inner
        gained = 2 * (ahead_reach * touched.mT).sum((1, 2))
        gained = gained + (among_reach * inner[..., : rows.shape[1]]).sum((1, 2))
        lost = torch.linalg.solve(bridge, moved).diagonal(dim1=1, dim2=2).sum(1)
        return self.error.variance - (self.products.error_removed[0] + gained - lost)

    def _forms(self, form: Tensor, half: Tensor, rows: Tensor, changes: Tensor) -> tuple[Tensor, Tensor]:
        """(B, r, m) form between changed and present weights, (B, r, r) between changed and changed ones."""
        near = half[:, 0, rows]  # (m, B, r, T)
        ahead = torch.einsum("mbrt,brt->brm", near, changes)
        pairs = form[rows[:, :, None], :, rows[:, None, :], :]  # (B, r, r, T, T)
        return ahead, torch.einsum("brt,brstu,bsu->brs", changes, pairs, changes)

    def _noise_change(self, rows: Tensor, changes: Tensor) -> Tensor:
        """(B, r) change of the shot noise of the changed measurements."""
        mean = self.error.mean
        before = (self.weights * mean).sum(-1)[rows]
        after = before + (changes * mean[rows]).sum(-1)
        return self.error.shot * (after.clamp_min(0) - before.clamp_min(0))


def _changed_rows(changes: Tensor) -> tuple[Tensor, Tensor]:
    """(B, r) rows that change, filled up with others, and (B, r, T) what they change by."""
    touched = (changes != 0).any(-1)
    count = max(1, int(touched.sum(1).max()))
    rows = touched.to(torch.uint8).sort(dim=1, descending=True, stable=True).indices[:, :count]
    return rows, changes.gather(1, rows[:, :, None].expand(-1, -1, changes.shape[2]))


def _middle(among: Tensor) -> Tensor:
    """Inverse of ``[[H, 1], [1, 0]]``: ``[[0, 1], [1, -H]]``."""
    one = torch.eye(among.shape[1], dtype=among.dtype).expand_as(among)
    return torch.cat([torch.cat([torch.zeros_like(among), one], 2), torch.cat([one, -among], 2)], 1)
