"""The posterior of scene blocks under a Gaussian-mixture prior."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.priors.blocks import BlockModel
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.posterior import GaussianSolver, explained_variance, noise_variance, sufficient_precision
from tmca.sensor import Noise

# Components less probable than this add nothing to the variance worth their time.
NEGLIGIBLE = 1e-2
# … and to the mean.
NOTHING = 1e-6
# A quick look at some of a block's rows rules out components this far (in log probability) behind the best one, and
# keeps no more than this number for each measurement.
BEHIND, CANDIDATES = 10.0, 8
GLANCE_ROWS = 2


@dataclass(frozen=True)
class Components:
    """Likely components of one block: index of kind and gain, and factors of their measurement covariance.

    Args:
        kinds: (M,) index of the kind.
        gains: (M,) brightness, float64.
        factors: (M, m, m) lower Cholesky factors, float64.
        expected: (M, m) expected measurements, float64.
        log_weights: (M,) log of the prior probability.
    """

    kinds: Tensor
    gains: Tensor
    factors: Tensor
    expected: Tensor
    log_weights: Tensor

    def shares(self, measured: Tensor) -> tuple[Tensor, Tensor]:
        """(M, N) log of the joint density of component and measurements (N, m), and (M, N, m) the solved residuals."""
        residual = (measured.double() - self.expected[:, None]).mT
        white = torch.linalg.solve_triangular(self.factors, residual, upper=False)
        half_log_det = self.factors.diagonal(dim1=1, dim2=2).log().sum(1)
        logs = (self.log_weights - half_log_det)[:, None] - 0.5 * white.square().sum(1)
        return logs, torch.linalg.solve_triangular(self.factors.mT, white, upper=True).mT


@dataclass(frozen=True)
class MixturePosterior:
    """What the measurements of P blocks say, by the components that they make likely.

    Args:
        solver: the prior in the precision of the heavy products.
        cross: (m, P, n) covariance A S of measurements with pixels under the base.
        signal: (P, m, m) covariance A S Aᵀ of measurements under the base.
        inside: (P, m, d) A U.
        centre: (P, m) expected measurements A μ of the base.
    """

    solver: MixtureSolver
    cross: Tensor
    signal: Tensor
    inside: Tensor
    centre: Tensor

    def moments(self, block: int, measured: Tensor, with_variance: bool) -> tuple[Tensor, Tensor | None]:
        """Estimate (N, n) of one block and, if asked for, the variance (N, valid) of its valid columns."""
        likely = self.components(block, *self._likely(block, measured))
        logs, solved = likely.shares(measured)
        share = torch.softmax(logs, 0)
        estimate = self._mean(block, likely, share, solved)
        if not with_variance:
            return estimate, None
        return estimate, self._variance(block, likely, share, solved, estimate)

    def components(self, block: int, kinds: Tensor, levels: Tensor, some: slice | Tensor = slice(None)) -> Components:
        """Components (kinds, levels) of one block, seen through ``some`` of its measurements."""
        s, prior = self.solver, self.solver.prior
        inside, gains = self.inside[block, some], prior.gains[levels]
        used, place = kinds.unique(return_inverse=True)
        base = self.signal[block, some][:, some]
        whole = prior.scales[used, None, None] * base.double() + (inside @ s.changes[used] @ inside.mT).double()
        expected = gains[:, None] * (self.centre[block, some] + s.means[kinds] @ inside.mT).double()
        noise = noise_variance(expected, s.noise)
        factors = torch.linalg.cholesky(gains[:, None, None] ** 2 * whole[place] + torch.diag_embed(noise))
        return Components(kinds, gains, factors, expected, prior.weights[kinds, levels].log())

    def _likely(self, block: int, measured: Tensor) -> tuple[Tensor, Tensor]:
        """Kinds and gain levels that a few rows of the measurements (N, m) do not rule out."""
        prior, some = self.solver.prior, self.solver.glance
        kinds, levels = prior.weights.shape
        every = torch.cartesian_prod(torch.arange(kinds), torch.arange(levels)).reshape(-1, 2)
        if len(every) == 1:
            return every[:, 0], every[:, 1]
        logs, _ = self.components(block, every[:, 0], every[:, 1], some).shares(measured[:, some])
        best = logs.topk(min(CANDIDATES, len(logs)), dim=0)
        keep = best.indices[best.values > best.values[0] - BEHIND].unique()
        return every[keep, 0], every[keep, 1]

    def _mean(self, block: int, likely: Components, share: Tensor, solved: Tensor) -> Tensor:
        """(N, n) mean of the component estimates by shares (M, N); ``solved`` (M, N, m) is G⁻¹(y - A μ)."""
        s = self.solver
        some, of = (share > NOTHING).nonzero(as_tuple=True)  # few components matter to each of the N
        kinds, light = likely.kinds[some], share[some, of] * likely.gains[some]
        pulled = (light * likely.gains[some])[:, None] * solved[some, of]
        inside, tilt = pulled.to(s.dtype) @ self.inside[block], light[:, None].to(s.dtype) * s.means[kinds]
        for kind in kinds.unique():
            members = (kinds == kind).nonzero()[:, 0]
            tilt = tilt.index_add(0, members, inside[members] @ s.changes[kind])

        def gathered(values: Tensor) -> Tensor:
            """Sum over the components of each measurement."""
            return values.new_zeros(share.shape[1], *values.shape[1:]).index_add(0, of, values)

        whole = gathered(s.prior.scales[kinds, None] * pulled).to(s.dtype) @ self.cross[:, block]
        return whole + gathered(tilt) @ s.basis.mT + gathered(light)[:, None].to(s.dtype) * s.centre

    def _variance(self, block: int, likely: Components, share: Tensor, solved: Tensor, estimate: Tensor) -> Tensor:
        """(N, valid) variance within the components plus that between them."""
        pick = self.solver.model.in_judged
        total, weight = torch.zeros_like(pick(estimate)), torch.zeros_like(estimate[:, :1])
        for index in (share.amax(1) > NEGLIGIBLE).nonzero()[:, 0].tolist():
            probability = share[index].to(estimate.dtype)[:, None]
            alone = torch.zeros_like(share)
            alone[index] = 1
            away = pick(self._mean(block, likely, alone, solved) - estimate)
            total += probability * (self._within(block, likely, index) + away.square())
            weight += probability
        return total / weight

    def _within(self, block: int, likely: Components, index: int) -> Tensor:
        """(valid,) posterior variance of one component."""
        s, kind = self.solver, int(likely.kinds[index])
        scale, square = float(s.prior.scales[kind]), float(likely.gains[index]) ** 2
        cross = scale * s.model.in_judged(self.cross[:, block]) + self.inside[block] @ s.changes[kind] @ s.judged_basis
        before = s.model.in_judged(scale * s.variance + s.tilts[kind])
        return (square * before - square**2 * explained_variance(likely.factors[index], cross)).clamp(min=0)


class MixtureSolver:
    """The posteriors of blocks of one mixture prior under one camera and noise.

    Args:
        prior: of the blocks.
        model: geometry of the camera's taps on the blocks.
        noise: of the sensor.
        dtype: of the heavy products; None takes float32 where the noise allows it.
    """

    def __init__(
        self, prior: GaussianMixturePrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None
    ) -> None:
        self.prior, self.model, self.noise = prior, model, noise
        self.dtype = dtype or sufficient_precision(prior.base, model, noise)
        self.centre, self.basis = prior.base.mean.reshape(-1).to(self.dtype), prior.basis.to(self.dtype)
        self.means, self.changes = prior.means.to(self.dtype), prior.changes.to(self.dtype)
        self.variance = prior.decoupled.diagonal().to(self.dtype)
        self.tilts = torch.stack([((self.basis @ change) * self.basis).sum(1) for change in self.changes])
        self.rows = prior.decoupled.to(self.dtype)[model.pixels()]
        self.judged_basis = model.in_judged(self.basis.mT)
        self.glance = glance(model)

    def posterior(self, windows: Tensor) -> MixturePosterior:
        """The posterior of blocks under code windows (P, taps, h, w)."""
        model, weights = self.model, self.model.complete(windows.to(self.dtype))
        cross = model.cross_covariance(weights, self.rows)
        signal = model.measure(weights, cross).transpose(0, 1)
        inside = model.measure(weights, self.basis.mT[:, None].expand(-1, len(windows), -1)).permute(1, 2, 0)
        centre = model.measure(weights, self.centre.expand(len(windows), -1))
        return MixturePosterior(self, cross, signal, inside.contiguous(), centre)

    def typical_variance(self, windows: Tensor) -> Tensor:
        """(n,) posterior variance of each pixel under the base, averaged over code windows."""
        return GaussianSolver(self.prior.base, self.model, self.noise, self.dtype).typical_variance(windows)


def glance(model: BlockModel) -> Tensor:
    """Indices of the measurements of a few rows of a block, evenly through its height."""
    rows = model.block[1]
    count = min(GLANCE_ROWS, rows)
    chosen = torch.tensor([(2 * i + 1) * rows // (2 * count) for i in range(count)])
    return (chosen[:, None] * model.columns + torch.arange(model.columns)).flatten()
