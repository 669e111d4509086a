"""The posterior of blocks under a Gaussian mixture, given what they explain of a snapshot.

Nothing of a component depends on the snapshot but its mean and how likely it is. For one snapshot the likely ones are
made; for many all are made once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import groupby
from operator import itemgetter

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.operators.blocks import BlockModel
from tmca.priors.gaussian_posterior import GaussianSolver, noise_variance, sufficient_precision
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.statistics import lower_factor, lower_inverse
from tmca.sensor import Noise

_NEGLIGIBLE, _NOTHING, _RARE = 1e-2, 1e-6, 1e-4
"""Components less probable add nothing worth their time to the variance of equal blocks, to the mean, and to what lies
between the components of one."""
_BEHIND, _CANDIDATES, _GLANCE_ROWS = 10.0, 8, 2
"""A quick look at some of a block's rows rules out components this far (in log probability) behind the best one, and
keeps no more than this number for each measurement."""
_AT_ONCE = 2**16
"""Entries of the covariances of kinds that are decomposed at once: they stay in a processor's cache."""


@dataclass(frozen=True)
class Components:
    """Some components of a mixture, ordered, as the measurements of one block see them.

    Component c makes measurements y white as ``scale_c · (B y - offset_c)``, with a matrix B that components may share.

    Args:
        index: (M,) kind · gains + gain.
        matrices: of (m, m), B.
        matrix: (M,) which of them; equal ones are consecutive.
        scale, offset: (M, m).
        log_scale: (M,) log of the prior probability less half of the covariance's log determinant, float64.
    """

    index: Tensor
    matrices: Sequence[Tensor]
    matrix: Tensor
    scale: Tensor
    offset: Tensor
    log_scale: Tensor

    def some(self, places: Tensor) -> Components:
        """Those at some places, in order."""
        parts = self.matrix[places], self.scale[places], self.offset[places], self.log_scale[places]
        return Components(self.index[places], self.matrices, *parts)

    def shares(self, measured: Tensor) -> tuple[Tensor, Tensor]:
        """(M, N) log of the joint density of component and measurements (N, m), and (M, m, N) white residuals."""
        used, counts = (part.tolist() for part in self.matrix.unique_consecutive(return_counts=True))
        seen, every = measured.mT.to(self.scale.dtype), zip(used, self.offset.split(counts), strict=True)
        away = torch.cat([self.matrices[which] @ seen - offset[..., None] for which, offset in every])
        white = self.scale[..., None] * away
        return self.log_scale[:, None] - 0.5 * white.square().sum(1, dtype=torch.float64), white


@dataclass(frozen=True)
class Kept:
    """What is known of all components of blocks.

    Args:
        glances: seen through a few rows.
        whole: seen through all measurements.
        within: of each block (K·G, valid) variance within the components, or nothing.
    """

    glances: list[Components]
    whole: list[Components]
    within: list[Tensor]


@dataclass(frozen=True)
class Pairs:
    """What one measurement says under one component, for each pair whose share counts.

    Args:
        component, measurement, share: (Q,).
        light: (Q,) gain.
        pulled: (Q, m) that the covariance of measurements with pixels under the base is multiplied by.
        tilt: (Q, d) what is added inside the subspace.
    """

    component: Tensor
    measurement: Tensor
    share: Tensor
    light: Tensor
    pulled: Tensor
    tilt: Tensor

    def some(self, chosen: Tensor) -> Pairs:
        """Those of a mask."""
        return Pairs(*(getattr(self, part.name)[chosen] for part in fields(self)))

    def mean(self, values: Tensor, count: int) -> Tensor:
        """(count, ...) sums of values (Q, ...) of the pairs by their shares."""
        weighted = self.share.reshape(-1, *[1] * (values.ndim - 1)) * values
        return values.new_zeros(count, *values.shape[1:]).index_add(0, self.measurement, weighted)


@dataclass(frozen=True)
class MixturePosterior:
    """What the measurements of P blocks say, by the components that they make likely.

    Args:
        solver: the prior in the precision of the heavy products.
        cross: (m, P, n) covariance A S of measurements with pixels under the base.
        signal: (P, m, m) covariance A S Aᵀ of measurements under the base.
        inside: (P, m, d) A U.
        centre: (P, m) expected measurements A μ of the base.
        kept: what is held for the next measurements.
    """

    solver: MixtureSolver
    cross: Tensor
    signal: Tensor
    inside: Tensor
    centre: Tensor
    kept: Kept | None = None

    def keeping(self, variance: bool = True) -> MixturePosterior:
        """The same, with what is known of all components made once, their variances too if asked for."""
        every, blocks = self.solver.every, range(len(self.signal))
        whole = [self.components(block, every, together=True) for block in blocks]
        looks = [self.components(block, every, self.solver.glance, together=True) for block in blocks]
        within = [self._within(block, whole[block]) for block in blocks] if variance else []
        return replace(self, kept=Kept(looks, whole, within))

    def moments(
        self, blocks: Sequence[int], measured: Sequence[Tensor], with_variance: bool
    ) -> list[tuple[Tensor, Tensor | None]]:
        """As of `tmca.priors.gaussian_posterior.BlockPosterior`."""
        return [self._moments(block, one, with_variance) for block, one in zip(blocks, measured, strict=True)]

    def _moments(self, block: int, measured: Tensor, with_variance: bool) -> tuple[Tensor, Tensor | None]:
        needed = self._needed(block, measured)
        likely = self.kept.whole[block].some(needed) if self.kept else self.components(block, needed)
        logs, white = likely.shares(measured)
        share = torch.softmax(logs, 0)
        pairs = self._pairs(block, likely, share, white)
        estimate = self._mean(block, pairs, len(measured))
        if not with_variance:
            return estimate, None
        return estimate, self._variance(block, likely, share, pairs, estimate)

    def components(
        self, block: int, index: Tensor, some: slice | Tensor = slice(None), *, together: bool = False
    ) -> Components:
        """Components of one block, ordered, seen through ``some`` of its measurements.

        Those of a kind share a matrix if made ``together``, where noise is the same for all measurements and gains.
        Where rounding in single precision is above the noise, all have what it may hide added, alike. It hides most
        where codes repeat within the dispersion, and a kind of scene is far from the base.
        """
        rounding = torch.finfo(torch.float32).eps * self.signal.shape[-1] ** 0.5
        for hidden in (0.0, rounding, 10 * rounding):
            try:
                return self._components(block, index, some, together, hidden)
            except SettingError:
                continue
        return self._components(block, index, some, together, 100 * rounding)

    def _components(self, block: int, index: Tensor, some: slice | Tensor, together: bool, hidden: float) -> Components:
        """The same with variances above the noise by ``hidden``, as a share of the mean variance of a kind."""
        s, prior = self.solver, self.solver.prior
        kinds, levels = index // s.levels, index % s.levels
        inside, base = self.inside[block, some], self.signal[block, some][:, some].double()
        expected = prior.gains[levels, None] * (self.centre[block, some] + s.means[kinds] @ inside.mT).double()
        light, noise = prior.gains[levels].square()[:, None], noise_variance(expected, s.noise)
        used, place = kinds.unique_consecutive(return_inverse=True)
        whiten = _whitened_together if together and s.sharing > 1 else _whitened
        matrices: list[Tensor] = []
        parts = []
        for some_kinds in torch.arange(len(used)).to(used).split(max(1, _AT_ONCE // len(base) ** 2)):
            kept = torch.isin(place, some_kinds)
            changes, scales = s.changes[used[some_kinds]], prior.scales[used[some_kinds], None, None]
            whole = scales * base + (inside @ changes @ inside.mT).double()
            kind = place[kept] - some_kinds[0]
            raised = noise[kept] + hidden * light[kept] * whole.diagonal(dim1=1, dim2=2).mean(1)[kind, None]
            own, which, *part = whiten(whole, kind, light[kept], raised, expected[kept])
            parts.append((which + len(matrices), *part))
            matrices += [one.to(s.dtype, copy=True) for one in own]
        which, scale, offset, logs = (torch.cat(part) for part in zip(*parts, strict=True))
        log_scale = prior.weights[kinds, levels].log() - logs
        return Components(index, matrices, which, scale.to(s.dtype), offset.to(s.dtype), log_scale)

    def _glance(self, block: int) -> Components:
        """All components of one block, seen through a few rows."""
        s = self.solver
        return self.kept.glances[block] if self.kept else self.components(block, s.every, s.glance)

    def _needed(self, block: int, measured: Tensor) -> Tensor:
        """Indices of the components that a few rows of the measurements (N, m) do not rule out."""
        every = self.solver.every
        if len(every) == 1:
            return every
        logs, _ = self._glance(block).shares(measured[:, self.solver.glance])
        best = logs.topk(min(_CANDIDATES, len(logs)), dim=0)
        return every[best.indices[best.values > best.values[0] - _BEHIND].unique()]

    def _pairs(self, block: int, likely: Components, share: Tensor, white: Tensor) -> Pairs:
        """The pairs of components and measurements whose shares (M, N) count, of white residuals (M, m, N)."""
        s = self.solver
        some, of = (share > _NOTHING).nonzero(as_tuple=True)  # few components matter to each of the N
        kinds, light = likely.index[some] // s.levels, s.prior.gains[likely.index[some] % s.levels].to(s.dtype)
        solved = _multiplied(likely.scale[some] * white[some, :, of], likely.matrices, likely.matrix[some])
        pulled = light.square()[:, None] * solved
        tilt = _multiplied(pulled @ self.inside[block], s.changes, kinds) + light[:, None] * s.means[kinds]
        pulled = s.prior.scales[kinds, None].to(s.dtype) * pulled
        return Pairs(some, of, share[some, of].to(s.dtype), light, pulled, tilt)

    def _mean(self, block: int, pairs: Pairs, count: int) -> Tensor:
        """(count, n) mean of the components' estimates."""
        s, parts = self.solver, [pairs.mean(part, count) for part in (pairs.pulled, pairs.tilt, pairs.light)]
        return parts[0] @ self.cross[:, block] + parts[1] @ s.basis.mT + parts[2][:, None] * s.centre

    def _variance(self, block: int, likely: Components, share: Tensor, pairs: Pairs, estimate: Tensor) -> Tensor:
        """(N, valid) variance within the components plus that between them."""
        s, cross = self.solver, self.solver.model.in_valid(self.cross[:, block])
        counts = share.amax(1) > _NEGLIGIBLE
        probable, those = share[counts].to(s.dtype), likely.some(counts.nonzero()[:, 0])
        known = self.kept.within[block] if self.kept and self.kept.within else None
        within = self._within(block, those) if known is None else known[those.index]
        pairs = pairs.some(counts[pairs.component] & (pairs.share > _RARE))
        alone = pairs.pulled @ cross + pairs.tilt @ s.valid_basis + pairs.light[:, None] * s.valid_centre
        away = alone - s.model.in_valid(estimate)[pairs.measurement]
        return (probable.mT @ within + pairs.mean(away.square(), len(estimate))) / probable.sum(0)[:, None]

    def _within(self, block: int, likely: Components) -> Tensor:
        """(M, valid) posterior variance of some components."""
        s, cross = self.solver, self.solver.model.in_valid(self.cross[:, block])
        used, counts = (part.tolist() for part in likely.matrix.unique_consecutive(return_counts=True))
        squares = s.prior.gains[likely.index % s.levels, None].to(s.dtype).square()
        kinds = [int(part[0]) for part in (likely.index // s.levels).split(counts)]
        every = zip(used, squares.split(counts), likely.scale.square().split(counts), strict=True)
        parts = []
        for kind, members in groupby(zip(kinds, every, strict=True), key=itemgetter(0)):
            inside, scale = self.inside[block] @ s.changes[kind], float(s.prior.scales[kind])
            seen = torch.addmm(cross, inside, s.valid_basis, beta=scale)
            for _, (which, square, scales) in members:
                explained = scales @ (likely.matrices[which] @ seen).square_()
                parts.append((square * s.before[kind] - square.square() * explained).clamp(min=0))
        return torch.cat(parts)


Whitened = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]
"""Matrices, which of them a component has, its scale, its offset, and half of its log determinant."""


def _whitened(whole: Tensor, kind: Tensor, light: Tensor, noise: Tensor, expected: Tensor) -> Whitened:
    """Of components, by the factors of their covariances.

    Args:
        whole: (K, m, m) covariance of measurements of every kind at a gain of one, without noise.
        kind: (M,) of a component.
        light: (M, 1) square of its gain.
        noise, expected: (M, m).
    """
    factors = lower_factor(light[..., None] * whole[kind] + torch.diag_embed(noise))
    matrices, logs = lower_inverse(factors), factors.diagonal(dim1=1, dim2=2).log().sum(1)
    which = torch.arange(len(kind)).to(kind)
    return matrices, which, torch.ones_like(noise), (matrices @ expected[..., None])[..., 0], logs


def _whitened_together(whole: Tensor, kind: Tensor, light: Tensor, noise: Tensor, expected: Tensor) -> Whitened:
    """The same with one matrix for each kind, where noise has one variance."""
    values, vectors = torch.linalg.eigh(whole)
    spread = light * values[kind] + noise
    if not bool((spread > 0).all()):
        return _whitened(whole, kind, light, noise, expected)
    matrices = vectors.mT
    return matrices, kind, spread.rsqrt(), (matrices[kind] @ expected[..., None])[..., 0], spread.log().sum(1) / 2


def _multiplied(rows: Tensor, matrices: Sequence[Tensor] | Tensor, which: Tensor) -> Tensor:
    """(Q, k) rows (Q, j), each by its matrix (j, k); those with the same are consecutive."""
    used, counts = (part.tolist() for part in which.unique_consecutive(return_counts=True))
    return torch.cat([part @ matrices[one] for part, one in zip(rows.split(counts), used, strict=True)])


class MixtureSolver:
    """The posteriors of blocks under one prior, camera and noise; arguments as in `GaussianSolver`."""

    def __init__(
        self, prior: GaussianMixturePrior, model: BlockModel, noise: Noise, dtype: torch.dtype | None = None
    ) -> None:
        self.prior, self.model, self.noise = prior, model, noise
        self.dtype = dtype or sufficient_precision(prior.base, model, noise)
        self.every, self.levels = torch.arange(prior.weights.numel()).to(prior.weights.device), len(prior.gains)
        self.sharing = 1 if noise.shot else self.levels
        """Components of a kind that have the same eigenvectors: all, where noise has one variance."""
        self.centre, self.basis = prior.base.mean.reshape(-1).to(self.dtype), prior.basis.to(self.dtype)
        self.means, self.changes = prior.means.to(self.dtype), prior.changes.to(self.dtype)
        tilts = torch.stack([((self.basis @ change) * self.basis).sum(1) for change in self.changes])
        outside = prior.scales[:, None].to(self.dtype) * prior.decoupled.diagonal().to(self.dtype)
        self.before = model.in_valid(outside + tilts)
        """(K, valid) variance of a kind."""
        self.rows = prior.decoupled.to(self.dtype)[model.pixels()]
        self.valid_basis, self.valid_centre = model.in_valid(self.basis.mT), model.in_valid(self.centre)
        self.glance = _glance(model)

    def posterior(self, windows: Tensor, estimates: float | None = None, variance: bool = False) -> MixturePosterior:
        """The posterior of blocks under code windows (P, taps, h, w), computed in one way, whatever is asked for."""
        model, weights = self.model, self.model.complete(windows.to(self.dtype))
        cross = model.cross_covariance(weights, self.rows)
        signal = model.measure(weights, cross).transpose(0, 1)
        inside = model.measure(weights, self.basis.mT[:, None].expand(-1, len(windows), -1)).permute(1, 2, 0)
        centre = model.measure(weights, self.centre.expand(len(windows), -1))
        return MixturePosterior(self, cross, signal, inside.contiguous(), centre)

    def at_once(self, code: Tensor, memory: int, estimates: float, variance: bool) -> int:
        """How many blocks are solved together within so many bytes."""
        return max(1, memory // (self.model.measurements * len(self.centre) * self.dtype.itemsize))

    def kept_bytes(self, blocks: int) -> int:
        """That are held of so many blocks by `MixturePosterior.keeping`."""
        every, m, looks = len(self.every), self.model.measurements, len(self.glance)
        (n, d), valid = self.basis.shape, len(self.valid_centre)
        components = (every // self.sharing) * (m**2 + looks**2) + every * (2 * (m + looks) + valid)
        return blocks * (m * (n + m + d + 1) + components) * self.dtype.itemsize

    def typical_variance(self, windows: Tensor) -> Tensor:
        """(n,) posterior variance of each pixel under the base, averaged over code windows."""
        return GaussianSolver(self.prior.base, self.model, self.noise, self.dtype).typical_variance(windows)


def _glance(model: BlockModel) -> Tensor:
    """Indices of the measurements of a few rows of a block, evenly through its height, in every bucket."""
    rows = model.block[1]
    count = min(_GLANCE_ROWS, rows)
    chosen = torch.tensor(
        [r * rows + (2 * i + 1) * rows // (2 * count) for r in range(model.buckets) for i in range(count)]
    )
    return (chosen[:, None] * model.columns + torch.arange(model.columns)).flatten()
