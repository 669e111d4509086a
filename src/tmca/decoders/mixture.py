"""Patch decoder with a Gaussian-mixture prior: the mean of the linear estimates, each by its probability."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, overload

import torch
from torch import Tensor

from tmca.decoders.blending import decode_blocks
from tmca.decoders.lmmse import chosen_stride
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockModel
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.mixture_posterior import MixtureSolver


@dataclass(frozen=True)
class PatchMixture:
    """The minimum-mean-square-error estimate under a mixture of Gaussians, on overlapping blocks, blended.

    Args:
        prior: Gaussian-mixture prior of the blocks (L, h, w).
        stride: rows and columns from block to block; None takes half the block's height and all its judged columns.
        dtype: of the heavy products; None takes float32 where the noise allows it, float64 where it is next to none.
        progress: called with the share of the work done.
    """

    prior: GaussianMixturePrior
    stride: tuple[int, int] | None = None
    dtype: torch.dtype | None = None
    progress: Callable[[float], None] | None = None

    @overload
    def __call__(
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float = ...,
        shot: float = ...,
        uncertainty: Literal[False] = ...,
    ) -> Tensor: ...

    @overload
    def __call__(
        self, snapshot: Tensor, taps: Taps, read_noise: float, shot: float, uncertainty: Literal[True]
    ) -> tuple[Tensor, Tensor]: ...

    def __call__(
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float = 0.0,
        shot: float = 0.0,
        uncertainty: bool = False,
    ) -> Tensor | tuple[Tensor, Tensor]:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W'), and with ``uncertainty`` their standard deviation.

        Args:
            read_noise: standard deviation, in snapshot units.
            shot: variance of the shot noise per snapshot unit (full scale / full well).

        Raises:
            ShapeError: the snapshot does not fit the taps, or the prior's bands or block do not.
            SettingError: negative noise, a stride below 1, or a snapshot that is not finite.
        """
        model = BlockModel.of(taps, self.prior.block)
        solver = MixtureSolver(self.prior, model, read_noise, shot, self.dtype)
        estimate, deviation = decode_blocks(
            solver, model, snapshot, taps, chosen_stride(model, self.stride), uncertainty, self.progress
        )
        return estimate if deviation is None else (estimate, deviation)
