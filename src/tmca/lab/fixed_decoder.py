"""A decoder whose codes, optics and noise are fixed, in operations that exporters know."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tmca.decoders import Weights, first_estimate
from tmca.decoders.nets.network import NEED_PRIOR
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.sensor import Noise


class FixedOperator(TapOperator):
    """A tap operator of one tap per channel in operations that exporters know; its numbers are its parent's.

    Channel by channel, which is fast in torch.
    """

    energy: Tensor

    def __init__(self, operator: TapOperator) -> None:
        super().__init__(operator.taps)
        self.register_buffer("energy", operator.taps.gram_diagonal()[0], persistent=False)

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W) → (B, 1, H, W')."""
        total = scene.new_zeros(scene.shape[0], scene.shape[2], self.snapshot_shape[2])
        for channel, code, offset in zip(scene.unbind(1), self.code, self.taps.offsets, strict=True):
            total[..., offset : offset + code.shape[1]].addcmul_(channel, code)
        return total[:, None]

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W)."""
        codes = zip(self.code, self.taps.offsets, strict=True)
        seen = [snapshot[:, 0, :, offset : offset + code.shape[1]] * code for code, offset in codes]
        return torch.stack(seen, dim=1)

    def gram_solve(self, snapshot: Tensor, shift: float | Tensor = 0.0, **iteration: object) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot``."""
        diagonal: Tensor = self.energy + shift
        return torch.where(diagonal > 0, snapshot / diagonal.clamp_min(torch.finfo(diagonal.dtype).tiny), 0.0)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """Least-norm scene."""
        return self.A_adjoint(self.gram_solve(snapshot, 0.0))


class LookedUpOperator(FixedOperator):
    """The same in few operations, however many its channels: ONNX's optimiser takes the square of their number.

    Columns are looked up; those beyond a channel in one of zeros.
    """

    seen: Tensor
    laid: Tensor

    def __init__(self, operator: TapOperator) -> None:
        super().__init__(operator)
        taps, columns = operator.taps, operator.taps.code.shape[2]
        offsets = torch.tensor(taps.offsets)[:, None]
        before = torch.arange(taps.snapshot_width) - offsets
        padded = torch.where((before >= 0) & (before < columns), before, columns)
        channel = torch.arange(len(taps.offsets))[:, None]
        seen, laid = offsets + torch.arange(columns), channel * (columns + 1) + padded
        self.register_buffer("seen", seen.flatten().to(taps.code.device), persistent=False)
        self.register_buffer("laid", laid.flatten().to(taps.code.device), persistent=False)

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W) → (B, 1, H, W')."""
        rows = nn.functional.pad((scene * self.code).transpose(1, 2), (0, 1)).flatten(2)
        return rows.index_select(2, self.laid).unflatten(2, (-1, self.snapshot_shape[2])).sum(2)[:, None]

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W)."""
        columns = snapshot[:, 0].index_select(2, self.seen)
        return columns.unflatten(2, (-1, self.code.shape[2])).transpose(1, 2) * self.code


class CameraDecoder(nn.Module):
    """Snapshot (1, 1, H, W') → scene (1, L, H, W) behind fixed codes.

    Args:
        weights: of a network that starts from ``adjoint``, ``dagger`` or ``tikhonov``.
        operator: of the camera.
        noise: of its sensor.
        kind: the form that the operator takes.

    Raises:
        SettingError: a network that starts from a prior, or a dispersion by parts of pixels.
    """

    def __init__(
        self, weights: Weights, operator: TapOperator, noise: Noise, kind: type[FixedOperator] = FixedOperator
    ) -> None:
        super().__init__()
        if weights.network.start in NEED_PRIOR:
            wanted = "one that starts from adjoint, dagger or tikhonov, which are formulas"
            raise SettingError(
                "weights", f"a network that starts from {weights.network.start}", wanted,
                "train it with --set decoder='{kind: unrolled, start: tikhonov}'",
            )  # fmt: skip
        taps = operator.taps
        if taps.gram_neighbour() is not None or taps.channels != tuple(range(taps.scene_channels)):
            raise SettingError("dispersion", "parts of pixels", "whole pixels for an exported decoder")
        self.network, self.operator, self.noise = weights.network, kind(operator), noise

    def forward(self, snapshot: Tensor) -> Tensor:
        """(1, 1, H, W') → (1, L, H, W), nothing below zero, as `tmca reconstruct`."""
        start = first_estimate(self.network.start, snapshot, self.operator, self.noise)
        return self.network(snapshot, self.operator, self.noise, start).clamp_min(0)
