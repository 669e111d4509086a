"""U-Nets of residual blocks on gathered pixels: plain, or with a few unrolled steps on the exact operator."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import pixel_shuffle, softplus

from tmca.decoders.nets.network import (
    LEVEL_REACH,
    RESIDUAL,
    Network,
    code_maps,
    data_step,
    gathered,
    local_level,
    noise_maps,
    settings_of,
    silence,
)
from tmca.errors import SettingError, check_range
from tmca.operators import TapOperator
from tmca.sensor import Noise

_FIRST_SHIFT = -3.0  # softplus: 0.05


class ResidualBlock(nn.Module):
    """``x + conv(gelu(conv(x)))``, 3×3; no normalisation, so that every pixel depends on its neighbours only."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = nn.Conv2d(width, width, 3, padding=1), nn.Conv2d(width, width, 3, padding=1)
        if not self.second.weight.is_meta:  # else they come from a file
            nn.init.normal_(self.second.weight, std=1e-3)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.second(nn.functional.gelu(self.first(x)))


class ConvolutionalBody(nn.Module):
    """(B, inputs, H, W) → (B, outputs, H, W), any H and W, zero before it is trained if ``silent``.

    Pixels are gathered ``gather`` × ``gather`` into channels at the entrance, which makes dense convolutions fast;
    every further level halves the size.

    Args:
        inputs: channels.
        outputs: channels.
        widths: channels of each level, finest first.
        blocks: residual blocks on each level, each way.
        gather: pixels gathered along each axis.
        silent: the last layer starts at zero.

    Raises:
        SettingError: no level, or sizes below 1.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        widths: tuple[int, ...] = (48, 64),
        blocks: int = 2,
        gather: int = 2,
        silent: bool = True,
    ) -> None:
        super().__init__()
        if not widths or min(*widths, blocks, gather, 1) < 1:
            raise SettingError("widths", f"{widths}, {blocks} blocks, gather {gather}", "numbers of at least 1")
        self.gather, self.multiple = gather, gather * 2 ** (len(widths) - 1)
        self.reach = _reach(len(widths), blocks, gather)
        self.enter = nn.Conv2d(inputs * gather**2, widths[0], 3, padding=1)
        stack = [nn.Sequential(*(ResidualBlock(width) for _ in range(blocks))) for width in widths]
        self.descent = nn.ModuleList(stack)
        pairs = list(pairwise(widths))
        self.down = nn.ModuleList(nn.Conv2d(a, b, 2, stride=2) for a, b in pairs)
        self.up = nn.ModuleList(nn.ConvTranspose2d(b, a, 2, stride=2) for a, b in pairs)
        self.ascent = nn.ModuleList(nn.Sequential(*(ResidualBlock(a) for _ in range(blocks))) for a, _ in pairs)
        self.leave = nn.Conv2d(widths[0], outputs * gather**2, 3, padding=1)
        if silent:
            silence(self.leave)

    def forward(self, x: Tensor) -> Tensor:
        return self.ascend(*self.descend(x), size=(x.shape[2], x.shape[3]))

    def descend(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The coarsest level, and that of every finer one, for the way up."""
        x = self.enter(gathered(x, self.gather, self.multiple))
        finer_levels: list[Tensor] = []
        for level, down in zip(self.descent, self.down, strict=False):
            finer_levels.append(level(x))
            x = down(finer_levels[-1])
        return self.descent[-1](x), finer_levels

    def ascend(self, x: Tensor, finer_levels: list[Tensor], size: tuple[int, int]) -> Tensor:
        """(B, outputs, H, W) of what ``descend`` returned."""
        for level, up, finer in zip(reversed(self.ascent), reversed(self.up), reversed(finer_levels), strict=True):
            x = level(up(x) + finer)
        return pixel_shuffle(self.leave(x), self.gather)[..., : size[0], : size[1]]


def _reach(levels: int, blocks: int, gather: int) -> int:
    """Pixels that a body sees to each side: its convolutions at each level's scale, and the alignment of the scales."""
    both_ways = sum(2 * blocks * (2 if level < levels - 1 else 1) * gather * 2**level for level in range(levels))
    return both_ways + 2 * gather + 2 * gather * 2 ** (levels - 1)


class UNet(Network):
    """A U-Net from a first estimate to the scene (thesis 4.2; Ronneberger et al. 2015).

    The thesis' decoder is ``start="adjoint", codes=False, noise_aware=False``; how wide and deep it is, the thesis
    does not say. From the LMMSE or the pseudo-inverse the network learns the difference to it.

    Args:
        bands: L.
        start: first estimate, ``"adjoint"``, ``"dagger"``, ``"tikhonov"`` or ``"lmmse"``.
        codes: also give the code of every band to the network.
        buckets: R of a sensor pixel, whose codes it is all given.
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
        buckets: int = 1,
    ) -> None:
        super().__init__(settings_of(locals()))
        self.codes, self.noise_aware, self.residual = codes, noise_aware, start != "adjoint"
        inputs = bands * (1 + codes * buckets) + 2 * noise_aware
        self.body = ConvolutionalBody(inputs, bands, tuple(widths), blocks, gather, silent=self.residual)
        self.reach, self.multiple = self.body.reach + LEVEL_REACH, self.body.multiple

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        self.check(start)
        level = local_level(start) if self.noise_aware else torch.ones_like(start[:, :1])
        seen = [start / level]
        if self.codes:
            seen.append(code_maps(operator).flatten(0, 1).expand(len(start), -1, -1, -1))
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
        buckets: R of a sensor pixel.

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
        buckets: int = 1,
    ) -> None:
        super().__init__(settings_of(locals()))
        check_range("stages", stages, 1)
        self.shift = nn.Parameter(torch.full((stages,), _FIRST_SHIFT))
        sizes, count = ((2 + buckets) * bands + 2, bands, tuple(widths), blocks, gather), 1 if shared else stages
        proximal = [ConvolutionalBody(*sizes) for _ in range(count)]
        self.proximal = nn.ModuleList(proximal)
        self.reach, self.multiple = stages * proximal[0].reach + LEVEL_REACH, proximal[0].multiple

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        self.check(start)
        level = local_level(start)
        codes = code_maps(operator).flatten(0, 1).expand(len(start), -1, -1, -1)
        given = (codes, noise_maps(noise, level))
        floor, estimate = noise.variance(snapshot.detach()), start
        for stage, shift in enumerate(softplus(self.shift)):
            change = data_step(snapshot, operator, estimate, shift + floor)
            proximal = self.proximal[stage % len(self.proximal)]
            seen = torch.cat((estimate / level, change / level, *given), dim=1)
            estimate = estimate + RESIDUAL * level * proximal(seen).to(estimate.dtype)
        return estimate
