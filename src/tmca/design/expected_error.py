"""Expected error of the best linear estimate as a function of the code alone, with its derivative.

With the code's weights A, the prior covariance S of a block and its valid pixels J, the error of a block is
``tr S_JJ - tr G⁻¹ M`` with ``G = A S Aᵀ + noise`` and ``M = A S_·J S_J· Aᵀ``. Both G and M are quadratic in the weights
with coefficients that depend on neither code nor noise: the covariances of the pixels that the taps bring together.
They are kept, so that a code costs a few thousandths of what its whole posterior does. Of a tiled code every pixel of
one period is judged with its neighbours around.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.errors import SettingError, check_shape
from tmca.operators.blocks import BlockModel
from tmca.operators.taps import Taps
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.gaussian_posterior import noise_variance
from tmca.priors.mixture import GaussianMixturePrior
from tmca.sensor import Noise

_ROWS, _JUDGED, _SQUARE = 4, 26, 9
_MOST_ENTRIES = 9000
"""Measurements times taps of a block: two matrices of that side, in double precision, are 1.3 GB."""


@dataclass(frozen=True)
class BlockMse:
    """Mean squared error over the valid pixels of blocks, for m measurements of T taps each in each of R buckets.

    All buckets of a pixel see the same pixels of the scene, so that what is kept of the prior is that of one bucket.

    Args:
        model: geometry of the blocks, and R.
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
        pixels = model.for_buckets(1).pixels()
        flat, shape = pixels.flatten(), (*pixels.shape, *pixels.shape)
        rows = prior.rows(flat, torch.float64)
        middle = model.in_valid(rows)
        reach = (middle @ middle.mT) / middle.shape[1]
        variance = float(model.in_valid(prior.variance).mean())
        mean = prior.mean.reshape(-1).double()[pixels]
        return cls(model, rows[:, flat].reshape(shape), reach.reshape(shape), mean, variance, read_noise, shot)

    @property
    def device(self) -> torch.device:
        """Where errors are computed; codes may lie on another device."""
        return self.covariance.device

    def to(self, device: torch.device) -> BlockMse:
        """The same blocks on another device."""
        moved = {name: getattr(self, name).to(device) for name in ("covariance", "reach", "mean")}
        return replace(self, **moved)

    def under(self, read_noise: float, shot: float) -> BlockMse:
        """The same blocks under another noise.

        Raises:
            SettingError: negative noise.
        """
        Noise(read_noise, shot)  # refuses a negative one
        return replace(self, read_noise=read_noise, shot=shot)

    def for_buckets(self, buckets: int) -> BlockMse:
        """The same blocks before a sensor with another number of buckets a pixel."""
        return replace(self, model=self.model.for_buckets(buckets))

    @property
    def means(self) -> Tensor:
        """(R·m, T) prior mean of the pixels under the taps of every measurement."""
        return self.mean.repeat(self.model.buckets, 1)

    def __call__(self, windows: Tensor) -> Tensor:
        """(P,) mean squared errors of blocks under code windows (P, taps, h, w), in squared irradiance; differentiable.

        ``tmca.priors.expected_mse`` of the same windows gives the same.
        """
        errors: Tensor = _Error.apply(self.weights(windows), self)
        return errors

    def weights(self, windows: Tensor) -> Tensor:
        """(P, R·m, T) weights, float64 on ``device``, of the pixels under the taps of every measurement."""
        return self.model.complete(windows.to(self.device, torch.float64)).flatten(2).mT


@dataclass(frozen=True)
class Products:
    """What the weights (P, R·m, T) of blocks make of a ``BlockMse``.

    Args:
        covariant: (R·m, P, m, T) covariance of every measurement with the pixels under the taps of every other.
        reaching: the same of the valid products.
        inverse: (P, R·m, R·m) G⁻¹.
        reached: (P, R·m, R·m) M.
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
        expected = (weights * error.means).sum(-1)
        noise = noise_variance(expected, Noise(error.read_noise, error.shot))
        factor = torch.linalg.cholesky(spread + torch.diag_embed(noise))
        return cls(covariant, reaching, torch.cholesky_inverse(factor), reached)

    @property
    def error_removed(self) -> Tensor:
        """(P,) tr G⁻¹ M."""
        return (self.inverse * self.reached).sum((1, 2))

    @property
    def sandwiched(self) -> Tensor:
        """(P, R·m, R·m) G⁻¹ M G⁻¹."""
        return self.inverse @ self.reached @ self.inverse


def quadratic(form: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Quadratic form (m, T, m, T) of weights (P, R·m, T): half applied (R·m, P, m, T) and wholly (P, R·m, R·m)."""
    measurements, taps = form.shape[:2]
    every = weights.unflatten(1, (-1, measurements))  # (P, R, m, T)
    buckets = every.shape[1]
    half = form.new_empty(buckets, measurements, len(weights), measurements * taps)
    for bucket, part in enumerate(half):
        torch.bmm(every[:, bucket].transpose(0, 1), form.reshape(measurements, taps, -1), out=part)
    half = half.flatten(0, 1).unflatten(-1, (measurements, taps))
    return half, torch.einsum("ipjt,prjt->pirj", half, every).flatten(2)


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
    """(P, R·m, T) derivative of every block's error in its weights."""
    sandwiched, means, rows = products.sandwiched, error.means, (error.model.buckets, -1)
    added = torch.einsum("prij,jpit->prit", sandwiched.unflatten(1, rows), products.covariant)
    removed = torch.einsum("prij,jpit->prit", products.inverse.unflatten(1, rows), products.reaching)
    bright = (weights * means).sum(-1) > 0
    noise = error.shot * (sandwiched.diagonal(dim1=1, dim2=2) * bright)[..., None] * means
    return 2 * (added - removed).flatten(1, 2) + noise


@dataclass(frozen=True)
class MixtureMse:
    """Expected error of blocks under a Gaussian mixture, of an estimator that is told each block's component.

    No estimator that has to guess the component does better: a lower bound, near where components are told apart
    easily. Serves wherever a ``BlockMse`` does, but for flips.

    Args:
        parts: error of every component that counts.
        weights: (parts,) what each counts for: probability times squared gain.
    """

    parts: tuple[BlockMse, ...]
    weights: tuple[float, ...]

    @classmethod
    def of(
        cls, prior: GaussianMixturePrior, model: BlockModel, read_noise: float, shot: float, *, least: float = 1e-3
    ) -> MixtureMse:
        """Under noise in snapshot units; components that are less probable than ``least`` do not count.

        A component at gain g is the same one at gain 1 under noise smaller by g, its error larger by g².

        Raises:
            ShapeError: a prior of other blocks.
            SettingError: negative noise, or no component that counts.
        """
        check_shape("mixture prior", prior.block, model.block, "learn it on the blocks that designs are judged on")
        share = prior.weights / prior.weights.sum()
        if not bool((share >= least).any()):
            raise SettingError("least", str(least), f"at most {float(share.max()):.2g}, the largest probability")
        total = float(share[share >= least].sum())
        parts, weights = list[BlockMse](), list[float]()
        for kind, probabilities in enumerate(share):
            if not bool((probabilities >= least).any()):
                continue
            error = BlockMse.of(prior.component(kind), model)
            for index in (probabilities >= least).nonzero().flatten().tolist():
                gain = float(prior.gains[index]) / float(prior.gains[0])
                parts.append(error.under(read_noise / gain, shot / gain))
                weights.append(float(probabilities[index]) * gain**2 / total)
        return cls(tuple(parts), tuple(weights))

    @property
    def model(self) -> BlockModel:
        """Geometry of the blocks."""
        return self.parts[0].model

    @property
    def device(self) -> torch.device:
        """See ``BlockMse``."""
        return self.parts[0].device

    def for_buckets(self, buckets: int) -> MixtureMse:
        """See ``BlockMse``."""
        return replace(self, parts=tuple(part.for_buckets(buckets) for part in self.parts))

    def __call__(self, windows: Tensor) -> Tensor:
        """(P,) mean squared errors, as of ``BlockMse``."""
        return torch.stack([w * part(windows) for w, part in zip(self.weights, self.parts, strict=True)]).sum(0)


def design_model(taps: Taps, rows: int = _ROWS) -> BlockModel:
    """The block model of a camera's taps for designs: blocks as small as it allows, so that a search takes seconds.

    For 12 bands at one pixel per band it is 4×48: on real cubes codes found on it are as good under 12×36 blocks as
    codes found on 8×48 in four times the time. Where nothing is displaced, as behind the mask of a light-field camera,
    it is 9×9 or what fits.

    Raises:
        SettingError: a dispersion so wide, or so many bands, that no block fits the memory.
    """
    span = max(taps.offsets) - min(taps.offsets)
    if span == 0:
        side = min(_SQUARE, max(1, int((_MOST_ENTRIES / len(taps.offsets)) ** 0.5)))
        return BlockModel.of(taps, (taps.scene_channels, side, side))
    for height in range(rows, 0, -1):
        for width in (_JUDGED, _JUDGED // 2, 6):
            model = BlockModel.of(taps, (taps.scene_channels, height, 2 * span + width))
            if model.measurements * len(model.offsets) <= _MOST_ENTRIES:
                return model
    text, remedy = f"{len(taps.offsets)} taps over {span} pixels", "design with fewer bands or a smaller dispersion"
    raise SettingError("bands", text, "blocks of 1.3 GB at most", remedy)


def phases(model: BlockModel, period: tuple[int, int], shift: tuple[int, int] = (0, 0)) -> list[tuple[int, int]]:
    """Corners (top, left) of blocks whose valid columns cover one period, moved by ``shift``."""
    first, last = model.valid
    rows, columns = range(0, period[0], model.block[1]), range(0, period[1], last - first)
    return [(top + shift[0], left - first + shift[1]) for top in rows for left in columns]


def _even_shifts(model: BlockModel, count: int) -> list[tuple[int, int]]:
    """Shifts (rows, columns) that share out a block evenly."""
    first, last = model.valid
    return [(i * model.block[1] // count, i * (last - first) // count) for i in range(count)]


def even_places(model: BlockModel, period: tuple[int, int], count: int) -> list[tuple[int, int]]:
    """Corners of the blocks of all even shifts over one period."""
    return [place for shift in _even_shifts(model, count) for place in phases(model, period, shift)]


def count_places(model: BlockModel, period: tuple[int, int], count: int) -> int:
    """How many corners ``even_places`` gives, without a list of them."""
    first, last = model.valid
    return count * ceil(period[0] / model.block[1]) * ceil(period[1] / (last - first))


def windows(code: Tensor, block: tuple[int, int, int], places: list[tuple[int, int]]) -> Tensor:
    """(P, taps, h, w) windows of a code (taps, period rows, period columns) that repeats itself for ever."""
    (_, h, w), (_, height, width) = block, code.shape
    top, left = torch.tensor(places, device=code.device).unbind(1)
    rows = (top[:, None] + torch.arange(h, device=code.device)) % height
    columns = (left[:, None] + torch.arange(w, device=code.device)) % width
    return code[:, rows[:, :, None], columns[:, None, :]].transpose(0, 1)


@dataclass(frozen=True)
class TileMse:
    """Expected mean squared error of one period of a tiled code, in squared irradiance.

    Args:
        error: of single blocks.
        most: blocks whose error is computed at once.
    """

    error: BlockMse | MixtureMse
    most: int = 16

    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """Scalar of one period (taps, rows, columns), judged on blocks moved by ``shift`` (rows, columns);
        differentiable."""
        places = phases(self.error.model, (code.shape[1], code.shape[2]), shift)
        total = torch.zeros((), dtype=torch.float64, device=self.error.device)
        for start in range(0, len(places), self.most):
            total = total + self.error(windows(code, self.error.model.block, places[start : start + self.most])).sum()
        return total / len(places)

    def for_buckets(self, buckets: int) -> TileMse:
        """See ``BlockMse``."""
        return replace(self, error=self.error.for_buckets(buckets))

    @torch.no_grad()
    def whole(self, camera: CodedCamera, shifts: int = 4) -> float:
        """The error of a camera of one period, mean over shifts of the blocks that share it out evenly."""
        code, tile = camera.taps().code, self.for_buckets(camera.buckets)
        return float(torch.stack([tile(code, shift) for shift in _even_shifts(self.error.model, shifts)]).mean())
