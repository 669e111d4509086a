"""Networks on cubes: the U-Net, the thesis' own among them, and a few unrolled steps on the exact operator."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import softplus

from tmca.decoders.nets.convolutions import ConvolutionalBody
from tmca.decoders.nets.network import LEVEL_REACH, RESIDUAL, Network, code_maps, local_level, noise_maps
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.sensor import Noise

_FIRST_SHIFT = -3.0  # softplus: 0.05


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
        seen = [start / level]
        if self.codes:
            seen.append(code_maps(operator).expand(start.shape))
        if self.noise_aware:
            seen.append(noise_maps(noise, level))
        estimate = (RESIDUAL if self.residual else 1.0) * level * self.body(torch.cat(seen, dim=1)).to(start.dtype)
        return start + estimate if self.residual else estimate


class Unrolled(Network):
    """Stages of ``z = x + Aᵀ(A Aᵀ + μ I)⁻¹(y - A x)`` and ``x ← x + prox(x, z - x, code, noise)``, μ > 0 learned.

    The data step is the closed one of half-quadratic splitting; μ is the noise variance of each sensor pixel plus a
    learned positive shift. Before training the network returns its first estimate.

    Args:
        bands: L.
        start: first estimate, ``"adjoint"``, ``"dagger"``, ``"tikhonov"`` or ``"lmmse"``.
        stages: number of data steps; in the same minutes on one core two learn more than three do.
        shared: all stages share one proximal network.
        widths: channels of each level of a proximal network, finest first.
        blocks: residual blocks on each level.
        gather: pixels gathered along each axis at the entrance.

    Raises:
        SettingError: no stage.
    """

    kind = "unrolled"

    def __init__(
        self,
        *,
        bands: int = 12,
        start: str = "lmmse",
        stages: int = 2,
        shared: bool = False,
        widths: Sequence[int] = (48, 64),
        blocks: int = 2,
        gather: int = 2,
    ) -> None:
        super().__init__(bands, start)
        if stages < 1:
            raise SettingError("stages", str(stages), "at least 1")
        self.settings = {
            "bands": bands, "start": start, "stages": stages, "shared": shared, "widths": list(widths),
            "blocks": blocks, "gather": gather,
        }  # fmt: skip
        self.shift = nn.Parameter(torch.full((stages,), _FIRST_SHIFT))
        inputs = 3 * bands + 2
        proximal = [
            ConvolutionalBody(inputs, bands, tuple(widths), blocks, gather) for _ in range(1 if shared else stages)
        ]
        self.proximal = nn.ModuleList(proximal)
        self.reach, self.multiple = stages * proximal[0].reach + LEVEL_REACH, proximal[0].multiple

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        """(B, 1, H, W') and the first estimate (B, L, H, W) → (B, L, H, W)."""
        self.check(start)
        level = local_level(start)
        given = (code_maps(operator).expand(start.shape), noise_maps(noise, level))
        floor, estimate = noise.variance(snapshot.detach()), start
        for stage, shift in enumerate(softplus(self.shift)):
            with torch.autocast(snapshot.device.type, enabled=False):
                misfit = snapshot - operator.A(estimate)
                change = operator.A_adjoint(operator.gram_solve(misfit, shift + floor))
            proximal = self.proximal[stage % len(self.proximal)]
            seen = torch.cat((estimate / level, change / level, *given), dim=1)
            estimate = estimate + RESIDUAL * level * proximal(seen).to(estimate.dtype)
        return estimate
