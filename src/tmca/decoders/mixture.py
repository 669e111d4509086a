"""Patch decoder with a Gaussian-mixture prior: the mean of the linear estimates, each by its probability."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.decoders.blending import Estimate, decode_blocks
from tmca.decoders.lmmse import chosen_stride
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockModel
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.mixture_posterior import MixtureSolver


@dataclass(frozen=True)
class MixtureLMMSE:
    """The minimum-mean-square-error estimate under a mixture of Gaussians, on overlapping blocks, blended.

    Args:
        prior: Gaussian-mixture prior of the blocks (L, h, w).
        stride: rows and columns from block to block; None takes two thirds of its rows and its judged columns.
        dtype: of the heavy products; None takes float32 where the noise allows it, float64 where it is next to none.
    """

    prior: GaussianMixturePrior
    stride: tuple[int, int] | None = None
    dtype: torch.dtype | None = None

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
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W').

        Args:
            read_noise: standard deviation, in snapshot units.
            shot: variance of the shot noise per snapshot unit (full scale / full well).
            uncertainty: also return the standard deviation of every entry.
            progress: told the share that is done.

        Raises:
            ShapeError: the snapshot does not fit the taps, or the prior's bands or block do not.
            SettingError: negative noise, a stride below 1, or a snapshot that is not finite.
        """
        model = BlockModel.of(taps, self.prior.block)
        solver = MixtureSolver(self.prior, model, read_noise, shot, self.dtype)
        stride = chosen_stride(model, self.stride)
        return decode_blocks(solver, model, snapshot, taps, stride, uncertainty, progress)
