"""A decoder whose codes, optics and noise are fixed, in operations that exporters know."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tmca.decoders.networks.neural import Weights
from tmca.decoders.networks.start import NEED_PRIOR, first_estimate
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.operators.gram import gram_diagonal, gram_neighbour
from tmca.sensor import Noise


class FixedOperator(TapOperator):
    """A tap operator written in plain operations that exporters know; its numbers are those of its parent."""

    energy: Tensor

    def __init__(self, operator: TapOperator) -> None:
        super().__init__(operator.taps)
        self.register_buffer("energy", gram_diagonal(operator.taps), persistent=False)

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W) → (B, 1, H, W')."""
        taps, columns = self.taps, self.code.shape[2]
        total = scene.new_zeros(scene.shape[0], scene.shape[2], taps.snapshot_width)
        for code, channel, offset in zip(self.code, taps.channels, taps.offsets, strict=True):
            room = (offset, taps.snapshot_width - columns - offset)
            total = total + nn.functional.pad(scene[:, channel] * code, room)
        return total[:, None]

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W)."""
        columns = self.code.shape[2]
        return torch.stack(
            [
                snapshot[:, 0, :, offset : offset + columns] * code
                for code, offset in zip(self.code, self.taps.offsets, strict=True)
            ],
            dim=1,
        )

    def gram_solve(self, snapshot: Tensor, shift: float | Tensor = 0.0) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot``."""
        diagonal: Tensor = self.energy + shift
        return torch.where(diagonal > 0, snapshot / diagonal.clamp_min(torch.finfo(diagonal.dtype).tiny), 0.0)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """Least-norm scene."""
        return self.A_adjoint(self.gram_solve(snapshot, 0.0))


class CameraDecoder(nn.Module):
    """Snapshot (1, 1, H, W') → scene (1, L, H, W) behind fixed codes.

    Args:
        weights: of a network that starts from ``adjoint``, ``dagger`` or ``tikhonov``.
        operator: of the camera.
        noise: of its sensor.

    Raises:
        SettingError: a network that starts from a prior, or a dispersion by parts of pixels.
    """

    def __init__(self, weights: Weights, operator: TapOperator, noise: Noise) -> None:
        super().__init__()
        if weights.network.start in NEED_PRIOR:
            wanted = "one that starts from adjoint, dagger or tikhonov, which are formulas"
            raise SettingError(
                "weights", f"a network that starts from {weights.network.start}", wanted,
                "train it with --set decoder='{kind: unrolled, start: tikhonov}'",
            )  # fmt: skip
        taps = operator.taps
        if gram_neighbour(taps) is not None or taps.channels != tuple(range(taps.scene_channels)):
            raise SettingError("dispersion", "parts of pixels", "whole pixels for an exported decoder")
        self.network, self.operator, self.noise = weights.network, FixedOperator(operator), noise

    def forward(self, snapshot: Tensor) -> Tensor:
        """(1, 1, H, W') → (1, L, H, W), nothing below zero, as `tmca reconstruct`."""
        start = first_estimate(self.network.start, snapshot, self.operator, self.noise)
        return self.network(snapshot, self.operator, self.noise, start).clamp_min(0)
