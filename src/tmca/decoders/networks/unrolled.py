"""Unrolled network: a few steps of a proximal method on the exact operator, its proximal maps learned."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import softplus

from tmca.decoders.networks.convolutions import ConvolutionalBody
from tmca.decoders.networks.network import LEVEL_REACH, RESIDUAL, Network, code_maps, local_level, noise_maps
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.sensor import Noise

_FIRST_SHIFT = -3.0  # softplus: 0.05


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
