"""Expected error of tiled codes where scenes follow a Gaussian mixture instead of one Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.design.block_mse import BlockMse
from tmca.design.tile import TileMse, even_shifts
from tmca.errors import SettingError, ShapeError
from tmca.priors.blocks import BlockModel
from tmca.priors.mixture import GaussianMixturePrior


@dataclass(frozen=True)
class MixtureTileMse:
    """Mean squared error of a tiled code under a Gaussian mixture, by an estimator that is told each block's component.

    No estimator that has to guess the component does better: a lower bound, near where components are told apart
    easily. Serves wherever a ``TileMse`` does, but for flips.

    Args:
        parts: error of every component that counts.
        weights: (parts,) what each counts for: probability times squared gain.
        model: geometry of the blocks.
    """

    parts: tuple[TileMse, ...]
    weights: tuple[float, ...]
    model: BlockModel

    @classmethod
    def of(
        cls, prior: GaussianMixturePrior, model: BlockModel, read_noise: float, shot: float, *, least: float = 1e-3
    ) -> MixtureTileMse:
        """Under noise in snapshot units; components that are less probable than ``least`` do not count.

        A component at gain g is the same one at gain 1 under noise smaller by g, its error larger by g².

        Raises:
            ShapeError: a prior of other blocks.
            SettingError: negative noise, or no component that counts.
        """
        if prior.block != model.block:
            raise ShapeError(
                "mixture prior", f"blocks {prior.block}", f"{model.block}, those that designs are judged on"
            )
        share, found = prior.weights / prior.weights.sum(), []
        for kind in range(len(prior.means)):
            counted = (share[kind] >= least).nonzero().flatten().tolist()
            if not counted:
                continue
            first = float(prior.gains[0])
            own = BlockMse.of(prior.component(kind), model)
            for index in counted:
                gain = float(prior.gains[index]) / first
                part = TileMse(own.under(read_noise / gain, shot / gain))
                found.append((part, float(share[kind, index]) * gain**2))
        if not found:
            raise SettingError("least", str(least), f"at most {float(share.max()):.2g}, the largest probability")
        total = float(share[share >= least].sum())
        return cls(tuple(part for part, _ in found), tuple(weight / total for _, weight in found), model)

    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """Scalar, in squared irradiance, of one period (taps, rows, columns) of a code; differentiable."""
        pairs = zip(self.weights, self.parts, strict=True)
        return torch.stack([weight * part(code, shift) for weight, part in pairs]).sum()

    @torch.no_grad()
    def whole(self, camera: CodedCamera, shifts: int = 4) -> float:
        """The error of a camera of one period, mean over shifts of the blocks that share it out evenly."""
        code = camera.taps().code
        return float(torch.stack([self(code, shift) for shift in even_shifts(self.model, shifts)]).mean())
