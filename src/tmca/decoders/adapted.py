"""Patch LMMSE whose prior is learned from the snapshot at hand: empirical Bayes by expectation–maximisation."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from tmca.decoders.blending import Estimate, blend_weights, check_snapshot, spread_out
from tmca.decoders.lmmse import PatchLMMSE
from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.adaptation import error_moments, refitted
from tmca.priors.blocks import BlockGrid, BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.posterior import GaussianSolver

ITERATIONS = 4
_LEAST_READ_NOISE = 5e-4  # snapshot units: while the prior is still unknown, single precision is enough above it


class AdaptedLMMSE:
    """The patch LMMSE under the Gaussian prior that fits the scene behind each snapshot.

    A given prior makes the first estimate. Then the prior's mean and stationary covariance are refitted to estimate and
    remaining uncertainty, and the scene is estimated anew, ``iterations`` times: the scene's own spatial and spectral
    statistics take the place of those of other scenes. The estimate is no longer linear in the snapshot.

    Args:
        prior: stationary, to start from.
        iterations: how often the prior is refitted; 0 is the patch LMMSE.

    Raises:
        SettingError: a negative number, or a prior that is not stationary.
    """

    def __init__(self, prior: GaussianPrior, iterations: int = ITERATIONS) -> None:
        if iterations < 0:
            raise SettingError("iterations", f"{iterations}", "a number ≥ 0")
        self.prior, self.iterations = prior, iterations

    def __call__(
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float = 0.0,
        shot: float = 0.0,
        *,
        uncertainty: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> Estimate:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W'), each under a prior of its own.

        Args:
            snapshot: in snapshot units.
            taps: of the camera.
            read_noise: standard deviation, in snapshot units.
            shot: variance of the shot noise per snapshot unit (full scale / full well).
            uncertainty: also return the standard deviation of every entry under the fitted prior.
            progress: told the share that is done.

        Raises:
            ShapeError: the snapshot does not fit the taps, or is smaller than the prior's block.
            SettingError: negative noise, or a snapshot that is not finite.
        """
        check_snapshot(snapshot, taps)
        found = []
        for place, one in enumerate(snapshot.split(1)):
            told = self._told(progress, place, len(snapshot))
            prior = self.fit(one, taps, read_noise, shot, told)
            last = partial(told, self.iterations)
            found.append(PatchLMMSE(prior)(one, taps, read_noise, shot, uncertainty=uncertainty, progress=last))
        deviations = [one.deviation for one in found if one.deviation is not None]
        return Estimate(torch.cat([one.estimate for one in found]), torch.cat(deviations) if deviations else None)

    def fit(
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float,
        shot: float,
        progress: Callable[[int, float], None] | None = None,
    ) -> GaussianPrior:
        """The prior of the scene behind one snapshot (1, 1, H, W'); ``progress`` is told (iteration, share of it)."""
        prior, told = self.prior, progress or self._told(None, 0, 1)
        read = max(read_noise, _LEAST_READ_NOISE)
        for step in range(self.iterations):
            decoder = PatchLMMSE(prior, stride=_coarse(prior, taps), dtype=torch.float32)
            found = decoder(snapshot, taps, read, shot, scatter=True, progress=partial(told, step))
            assert found.scatter is not None
            unknown = _unknown(prior, taps, read, shot, float(found.scatter.mean()))
            prior = refitted(prior, found.estimate[0].clamp_min(0), unknown)
        return prior

    def _told(self, progress: Callable[[float], None] | None, place: int, count: int) -> Callable[[int, float], None]:
        """Turn (iteration, share of it) for one of several snapshots into the share of all."""
        each = self.iterations + 1
        return lambda step, share: progress((place * each + step + share) / (count * each)) if progress else None


def _coarse(prior: GaussianPrior, taps: Taps) -> tuple[int, int]:
    """Rows and columns between blocks whose judged columns just meet."""
    first, last = BlockModel.of(taps, prior.block).judged
    return prior.block[1], last - first


def _unknown(prior: GaussianPrior, taps: Taps, read_noise: float, shot: float, scatter: float) -> Tensor:
    """Moments of the blended estimate's error: those of some blocks all over the frame, brought to its size.

    The blend errs less than single blocks, by just the variance of what they say of the same pixel (``scatter``).
    """
    model = BlockModel.of(taps, prior.block)
    grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), _coarse(prior, taps))
    windows = grid.code_windows(grid.pad_code(taps.code.detach()), spread_out(grid.positions))
    posterior = GaussianSolver(prior, model, read_noise, shot, torch.float32).posterior(windows)
    moments, single = error_moments(prior, posterior), posterior.error_variance().mean(0)
    blended = (blend_weights(single) * single).mean() - scatter
    return moments * (blended / moments[:, :, 0, 0].diagonal().mean()).clamp_min(0)
