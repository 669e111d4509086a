"""What decoders by patch priors share: one posterior per block, overlapping blocks blended."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from tmca.decoders.patch_based.blending import Estimate, Solver, decode_blocks
from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.mixture import GaussianMixturePrior


class PatchDecoder:
    """Decode snapshots of any collapsed camera under a prior of blocks; subclasses say how a block is solved.

    Args:
        prior: of the blocks (L, h, w).
        stride: rows and columns from block to block; None takes two thirds of its rows, and its judged columns but
            no more than two thirds of all, so that blocks overlap; for tiled codes the next smaller divisors of the
            period, so that blocks under the same part of the tile share their matrices.
        dtype: of the heavy products; None takes float32 where the noise allows it, float64 where it is next to none.
    """

    def __init__(
        self,
        prior: GaussianPrior | GaussianMixturePrior,
        stride: tuple[int, int] | None = None,
        dtype: torch.dtype | None = None,
    ) -> None:
        self.prior, self.stride, self.dtype = prior, stride, dtype

    def __call__(
        self,
        snapshot: Tensor,
        taps: Taps,
        read_noise: float = 0.0,
        shot: float = 0.0,
        *,
        uncertainty: bool = False,
        differentiable: bool = False,
        scatter: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> Estimate:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W').

        Args:
            snapshot: in snapshot units.
            taps: of the camera.
            read_noise: standard deviation, in snapshot units.
            shot: variance of the shot noise per snapshot unit (full scale / full well).
            uncertainty: also return the standard deviation of every entry.
            differentiable: let gradients reach the code and the snapshot.
            scatter: also return the variance of what overlapping blocks say.
            progress: told the share that is done.

        Raises:
            ShapeError: the snapshot does not fit the taps, or the prior's bands or block do not.
            SettingError: negative noise, a stride below 1, or a snapshot that is not finite.
        """
        self.prior = self.prior.to(taps.code.device)
        model = BlockModel.of(taps, self.prior.block)
        solver = self.solver(model, read_noise, shot)
        stride = self._stride(model, taps.code)
        return decode_blocks(
            solver, model, snapshot, taps, stride, uncertainty, progress, differentiable=differentiable, scatter=scatter
        )

    def solver(self, model: BlockModel, read_noise: float, shot: float) -> Solver:
        """The posteriors of blocks under this decoder's prior."""
        raise TypeError(f"{type(self).__name__} defines no solver")

    def _stride(self, model: BlockModel, code: Tensor) -> tuple[int, int]:
        if self.stride is None:
            first, last = model.judged
            rows, columns = _two_thirds(model.block[1]), min(last - first, _two_thirds(model.block[2]))
            return _dividing(rows, _period(code.detach(), 1)), _dividing(columns, _period(code.detach(), 2))
        rows, columns = self.stride
        if rows < 1 or columns < 1:
            raise SettingError("stride", f"{self.stride}", "rows and columns ≥ 1")
        return min(rows, model.block[1]), columns


def _two_thirds(length: int) -> int:
    return max(1, 2 * length // 3)


def _dividing(most: int, period: int | None) -> int:
    """The largest step, from half of ``most`` to it, that divides a period or is a multiple of it."""
    steps = range(-(-most // 2), most + 1)
    return max((step for step in steps if period and 0 in (period % step, step % period)), default=most)


def _period(code: Tensor, axis: int) -> int | None:
    """Smallest step along an axis under which the code repeats itself at least twice."""
    length = code.shape[axis]
    for step in range(1, length // 2 + 1):
        early, late = code.narrow(axis, 0, length - step), code.narrow(axis, step, length - step)
        if torch.equal(early[:, :1], late[:, :1]) and torch.equal(early, late):
            return step
    return None
