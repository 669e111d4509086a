"""The posterior of scene blocks under a Gaussian prior, given what they explain of a snapshot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from tmca.operators.blocks import BlockModel, MeasurementCovariance, Smoothing, displacement_pays
from tmca.priors.derivatives import BlockProducts, DisplacedSignal, Signal
from tmca.priors.folded import FoldedFactors
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.statistics import lower_factor, lower_inverse
from tmca.sensor import Noise

_MOST_ROW_BYTES, _AT_ONCE, _SOLVED_AT_ONCE = 2**30, 32, 32
"""Of covariances of taps with pixels that are stored; without them, measurements for which they are made together, and
blocks that are solved together, about as many as a processor's cache has room for."""
NOISE_FLOOR = 1e-9
"""Variance of every measurement, squared snapshot units: G stays invertible without noise and without light."""


@dataclass(frozen=True)
class BlockPosterior:
    """What the measurements of P blocks say about their n pixels, by ``x̂ = μ + S Aᵀ G⁻¹ (y - A μ)``.

    Args:
        solver: the prior in the precision of the heavy products.
        weights: (P, T, R·h, columns) of the T taps of a bucket.
        factor: (P, m, m) lower Cholesky factor of G = A S Aᵀ + noise; float64.
        expected: (P, m) expected measurements A μ.
        known: `cross`, where it is there already.
    """

    solver: GaussianSolver
    weights: Tensor
    factor: Tensor
    expected: Tensor
    known: Tensor | None = None

    @cached_property
    def cross(self) -> Tensor:
        """(m, P, n) covariance A S of measurements with pixels."""
        return self.solver.cross(self.weights) if self.known is None else self.known

    @cached_property
    def cross_valid(self) -> Tensor:
        """(m, P, valid) the same of the valid columns."""
        model = self.solver.model
        if self.known is None:
            return model.cross_covariance(self.weights, self.solver.valid_rows)
        return model.in_valid(self.known)

    def estimate(self, block: int, measured: Tensor) -> Tensor:
        """(N, n) linear minimum-mean-square-error estimate of one block from measurements (N, m)."""
        return self._estimates([block], [measured])[0]

    def _estimates(self, blocks: Sequence[int], measured: Sequence[Tensor]) -> list[Tensor]:
        solver = self.solver
        solved = [self._solved(block, values) for block, values in zip(blocks, measured, strict=True)]
        counts = [len(part) for part in solved]
        if self.known is not None:
            away = BlockProducts.apply(self.known, torch.cat(solved), blocks, counts)
            return [solver.mean + part for part in away.split(counts)]
        seen = torch.tensor(blocks).repeat_interleave(torch.tensor(counts))
        away = solver.smoothing(solver.model.spread(self.weights[seen], torch.cat(solved)))
        return [solver.mean + part for part in away.split(counts)]

    def _solved(self, block: int, measured: Tensor) -> Tensor:
        """(N, m) G⁻¹ (y - A μ) of one block."""
        away = (measured - self._expected[block]).double()
        return torch.cholesky_solve(away.mT, self._factor(block)).mT.to(self.solver.dtype)

    def _factor(self, block: int) -> Tensor:
        """(m, m) of one block."""
        return self._factors[block]

    def log_evidence(self, block: int, measured: Tensor) -> Tensor:
        """(N,) log probability density of measurements (N, m) of one block, up to what depends on m alone."""
        factor = self._factor(block)
        white = torch.linalg.solve_triangular(factor, (measured - self._expected[block]).double().mT, upper=False)
        return -factor.diagonal().log().sum() - white.square().sum(0) / 2

    def linear(self, block: int) -> tuple[Tensor, Tensor, Tensor]:
        """Of one block: the matrix (n, m) that measurements are multiplied by, the estimate (n,) where they are zero,
        and the variance (n,) of its error."""
        cross, expected = self.cross[:, block], self.expected[block]
        exact = torch.cholesky_inverse(self._factor(block)) @ cross.double()
        dark = self.solver.mean - (expected.double() @ exact).to(cross.dtype)
        gain = exact.to(cross.dtype)
        return gain.mT, dark, (self.solver.variance - (cross * gain).sum(0)).clamp(min=0)

    @cached_property
    def _factors(self) -> Sequence[Tensor]:
        """Factors of the blocks, unbound at once: the derivative of an index would fill a tensor of all for each."""
        return self.factor.unbind(0)

    @cached_property
    def _expected(self) -> Sequence[Tensor]:
        """Expected measurements, likewise."""
        return self.expected.unbind(0)

    @cached_property
    def _cross(self) -> Sequence[Tensor]:
        """Covariances with pixels, likewise."""
        return self.cross.unbind(1)

    def error_variance(self) -> Tensor:
        """(P, n) posterior variance of every pixel, the same whatever is measured."""
        explained = [explained_variance(self._factor(block), cross) for block, cross in enumerate(self._cross)]
        return (self.solver.variance - torch.stack(explained)).clamp(min=0)

    def valid_variance(self, block: int) -> Tensor:
        """(valid,) the same of one block's valid columns."""
        before = self.solver.model.in_valid(self.solver.variance)
        return (before - explained_variance(self._factor(block), self.cross_valid[:, block])).clamp(min=0)

    def moments(
        self, blocks: Sequence[int], measured: Sequence[Tensor], with_variance: bool
    ) -> list[tuple[Tensor, Tensor | None]]:
        """Estimates (N, n) of some blocks from measurements (N, m) of each and, if asked for, variances (N, valid) of
        their valid columns."""
        pairs = zip(blocks, self._estimates(blocks, measured), strict=True)
        return [
            (one, self.valid_variance(block).expand(len(one), -1) if with_variance else None) for block, one in pairs
        ]


@dataclass(frozen=True)
class FoldedPosterior(BlockPosterior):
    """The same to be held for long, without covariances with pixels; ``folded`` in the place of ``factor``, which is
    empty."""

    folded: FoldedFactors = field(kw_only=True)

    @classmethod
    def room(cls, solver: GaussianSolver, count: int) -> FoldedPosterior:
        """Room for so many blocks: posteriors that are held one by one would leave holes in memory."""
        model, empty = solver.model, solver.mean.new_empty
        weights = empty(count, len(model.offsets), model.buckets * model.block[1], model.columns)
        folded = FoldedFactors.room(count, model.measurements)
        return cls(solver, weights, empty(0), empty(count, model.measurements), folded=folded)

    @staticmethod
    def bytes_of(solver: GaussianSolver, count: int) -> int:
        """That the room for so many blocks takes."""
        model = solver.model
        beside = count * model.measurements * (len(model.offsets) + 1) * solver.dtype.itemsize
        return FoldedFactors.bytes_of(count, model.measurements) + beside

    def part(self, blocks: slice) -> FoldedPosterior:
        """Of some of the blocks, or a part of the room, without a copy."""
        folded = self.folded.part(blocks)
        return FoldedPosterior(self.solver, self.weights[blocks], self.factor, self.expected[blocks], folded=folded)

    def fill(self, posterior: BlockPosterior) -> FoldedPosterior:
        """The room, which has as many places, with a copy of a posterior."""
        self.weights.copy_(posterior.weights)
        self.expected.copy_(posterior.expected)
        self.folded.fill(posterior.factor)
        return self

    def _solved(self, block: int, measured: Tensor) -> Tensor:
        return self.folded.solve(block, (measured - self._expected[block]).double()).to(self.solver.dtype)

    def _factor(self, block: int) -> Tensor:
        return self.folded.whole(block)


def explained_variance(factor: Tensor, cross: Tensor) -> Tensor:
    """(n,) variance that measurements remove: their covariance has the factor (m, m), that with pixels is (m, n)."""
    inverse = lower_inverse(factor.to(cross.dtype))
    explained, start = cross.new_zeros(cross.shape[1:]), 0
    for rows in inverse.chunk(4):  # zero above the diagonal
        end = start + len(rows)
        explained = explained + (rows[:, :end] @ cross[:end]).square_().sum(0)
        start = end
    return explained


class GaussianSolver:
    """The posteriors of blocks under one prior, camera and noise.

    Args:
        prior: of the blocks.
        model: geometry of the camera's taps on the blocks.
        noise: of the sensor.
        dtype: of the heavy products; None takes float32 where the noise allows it.
    """

    def __init__(self, prior: GaussianPrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None) -> None:
        self.prior, self.model, self.noise = prior, model, noise
        self.dtype = dtype or sufficient_precision(prior, model, noise)
        self.mean = prior.mean.reshape(-1).to(self.dtype)
        self.variance = prior.variance.to(self.dtype)

    @cached_property
    def covariance(self) -> MeasurementCovariance:
        """Of measurements, under a stationary prior."""
        return MeasurementCovariance(self.prior.displaced.to(self.dtype), self.model)

    @cached_property
    def smoothing(self) -> Smoothing:
        """Products with the covariance of a stationary prior."""
        return Smoothing(self.prior.displaced.to(self.dtype))

    @cached_property
    def rows(self) -> Tensor:
        """(m, T, n) covariance of the pixels that taps bring to measurements with all pixels."""
        return self.prior.rows(self.model.pixels(), self.dtype)

    @property
    def _rows_fit(self) -> bool:
        return self.model.pixels().numel() * self.mean.numel() * self.dtype.itemsize <= _MOST_ROW_BYTES

    def cross(self, weights: Tensor) -> Tensor:
        """(m, P, n) covariance A S of the measurements of blocks, whose taps have these weights, with their pixels."""
        if not self.prior.stationary or self._rows_fit:
            return self.model.cross_covariance(weights, self.rows)
        made = weights.new_empty(self.model.measurements, len(weights), len(self.mean))
        pixels = self.model.pixels()
        for start in range(0, len(pixels), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            made[some] = self.model.cross_covariance(weights, self.prior.rows(pixels[some], self.dtype), some)
        return made

    @cached_property
    def valid_rows(self) -> Tensor:
        """(m, T, valid) the same with those of the valid columns."""
        if "rows" in vars(self):
            return self.model.in_valid(self.rows)
        return self.prior.rows(self.model.pixels(), self.dtype, slice(*self.model.valid))

    def drop_rows(self) -> None:
        """Free the rows, up to a gigabyte that is made again where it is asked for."""
        for name in ("rows", "valid_rows"):
            vars(self).pop(name, None)

    def posterior(self, windows: Tensor, estimates: float | None = None, variance: bool = False) -> BlockPosterior:
        """The posterior of blocks under code windows (P, taps, h, w); differentiable in the windows.

        Args:
            estimates: of each block that will be asked for, which decides how they are computed; 0 for the evidence
                alone, None where covariances with pixels are asked for.
            variance: of valid columns will be asked for.
        """
        weights = self.model.complete(windows.to(self.dtype))
        expected = self.model.measure(weights, self.mean.expand(len(windows), -1))
        if estimates is not None and self.by_displacement(weights, estimates, variance):
            cross, signal = None, DisplacedSignal.apply(weights, self.covariance)
        else:
            cross = self.cross(weights)
            signal = Signal.apply(weights, cross, self.model)
        measured = signal.to(torch.float64, copy=True)
        measured.diagonal(dim1=1, dim2=2).add_(noise_variance(expected, self.noise))
        return BlockPosterior(self, weights, lower_factor(measured), expected, cross)

    def by_displacement(self, code: Tensor, estimates: float, variance: bool) -> bool:
        """Whether blocks under a code are solved without covariances with pixels; arguments as in `posterior`."""
        learned = code.requires_grad and estimates > 0
        if learned or not self.displaceable(code):
            return False
        return not self._rows_fit or displacement_pays(self.model, estimates, variance)

    def displaceable(self, code: Tensor) -> bool:
        """Whether blocks under a code can be solved so."""
        return self.prior.stationary and code.device.type == "cpu"

    def at_once(self, code: Tensor, memory: int, estimates: float, variance: bool) -> int:
        """How many blocks are solved together within so many bytes; arguments as in `posterior`."""
        m, size = self.model.measurements, self.dtype.itemsize
        if not self.by_displacement(code, estimates, variance):
            return max(1, memory // (m * self.mean.numel() * size))
        seen = variance * self.model.in_valid(self.mean).numel() * size
        return max(1, min(_SOLVED_AT_ONCE, memory // (m * (seen + 4 * m * torch.float64.itemsize))))

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
