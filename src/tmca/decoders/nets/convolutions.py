"""The convolutional body that the networks share: a U-Net of residual blocks on pixels gathered two by two."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import pad, pixel_shuffle, pixel_unshuffle

from tmca.errors import SettingError


class ResidualBlock(nn.Module):
    """``x + conv(gelu(conv(x)))``, 3×3; no normalisation, so that every pixel depends on its neighbours only."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = nn.Conv2d(width, width, 3, padding=1), nn.Conv2d(width, width, 3, padding=1)
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
            nn.init.zeros_(self.leave.weight)
            nn.init.zeros_(self.leave.bias)  # type: ignore[arg-type]

    def forward(self, x: Tensor) -> Tensor:
        return self.ascend(*self.descend(x), size=(x.shape[2], x.shape[3]))

    def descend(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The coarsest level, and that of every finer one, for the way up."""
        extra = (-x.shape[2] % self.multiple, -x.shape[3] % self.multiple)
        x = pad(x, (0, extra[1], 0, extra[0]), mode="replicate") if any(extra) else x
        x = self.enter(pixel_unshuffle(x, self.gather).contiguous(memory_format=torch.channels_last))
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


class TwoHeadedBody(nn.Module):
    """A `ConvolutionalBody` with a second way up: (B, inputs, H, W) → two pictures from one encoder.

    Args:
        inputs: channels.
        outputs: channels of the first and the second picture.
        widths, blocks, gather: see `ConvolutionalBody`.
    """

    def __init__(
        self, inputs: int, outputs: tuple[int, int], widths: tuple[int, ...], blocks: int = 2, gather: int = 2
    ) -> None:
        super().__init__()
        self.first = ConvolutionalBody(inputs, outputs[0], widths, blocks, gather)
        self.second = ConvolutionalBody(inputs, outputs[1], widths, blocks, gather)
        del self.second.enter, self.second.descent, self.second.down
        self.reach, self.multiple = self.first.reach, self.first.multiple

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        coarse, finer_levels = self.first.descend(x)
        size = (int(x.shape[2]), int(x.shape[3]))
        return self.first.ascend(coarse, finer_levels, size), self.second.ascend(coarse, finer_levels, size)


def _reach(levels: int, blocks: int, gather: int) -> int:
    """Pixels that a body sees to each side: its convolutions at each level's scale, and the alignment of the scales."""
    both_ways = sum(2 * blocks * (2 if level < levels - 1 else 1) * gather * 2**level for level in range(levels))
    return both_ways + 2 * gather + 2 * gather * 2 ** (levels - 1)
