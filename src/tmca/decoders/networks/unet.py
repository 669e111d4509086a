"""U-Net decoders: the thesis' own (from Φᵀy, codes not given), and one that is told what is known."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from tmca.decoders.networks.convolutions import ConvolutionalBody
from tmca.decoders.networks.network import LEVEL_REACH, RESIDUAL, Network, code_maps, local_level, noise_maps
from tmca.operators import TapOperator
from tmca.sensor import Noise


class UNet(Network):
    """A U-Net from a first estimate to the scene (thesis 4.2; Ronneberger et al. 2015).

    The thesis' decoder is ``start="adjoint", codes=False, noise_aware=False``; how wide and deep it is, the thesis
    does not say. From the LMMSE or the pseudo-inverse the network learns the difference to it.

    Args:
        bands: L.
        start: first estimate, ``"adjoint"``, ``"dagger"``, ``"tikhonov"`` or ``"lmmse"``.
        codes: also give the code of every band to the network.
        noise_aware: also give the noise, and work on values relative to the local brightness.
        widths: channels of each level, finest first.
        blocks: residual blocks on each level.
        gather: pixels gathered along each axis at the entrance.
    """

    kind = "unet"

    def __init__(
        self,
        *,
        bands: int = 12,
        start: str = "lmmse",
        codes: bool = True,
        noise_aware: bool = True,
        widths: Sequence[int] = (64, 96, 128),
        blocks: int = 2,
        gather: int = 2,
    ) -> None:
        super().__init__(bands, start)
        self.codes, self.noise_aware, self.residual = codes, noise_aware, start != "adjoint"
        self.settings = {
            "bands": bands, "start": start, "codes": codes, "noise_aware": noise_aware, "widths": list(widths),
            "blocks": blocks, "gather": gather,
        }  # fmt: skip
        inputs = bands * (1 + codes) + 2 * noise_aware
        self.body = ConvolutionalBody(inputs, bands, tuple(widths), blocks, gather, silent=self.residual)
        self.reach, self.multiple = self.body.reach + LEVEL_REACH, self.body.multiple

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        """(B, 1, H, W') and the first estimate (B, L, H, W) → (B, L, H, W)."""
        self.check(start)
        level = local_level(start) if self.noise_aware else torch.ones_like(start[:, :1])
        known = [start / level]
        if self.codes:
            known.append(code_maps(operator).expand(start.shape))
        if self.noise_aware:
            known.append(noise_maps(noise, level))
        found = (RESIDUAL if self.residual else 1.0) * level * self.body(torch.cat(known, dim=1)).to(start.dtype)
        return start + found if self.residual else found
