"""Spatial-angular network of the light field (Guo et al. 2020), plain or with steps on the exact operator."""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, pixel_shuffle, relu, softplus

from tmca.decoders.nets.network import (
    LEVEL_REACH,
    RESIDUAL,
    TILE,
    Network,
    code_maps,
    data_step,
    gathered,
    local_level,
    noise_maps,
    settings_of,
    silence,
)
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator
from tmca.sensor import Noise

_FIRST_ERROR = -3.0  # softplus: 0.05, a first guess of the error of an estimate relative to the local level
_MOST = 1_500_000_000  # bytes that the features of a tile may take


class AngularConv(nn.Conv3d):
    """3×3 convolution over the grid of views, pixel by pixel, dark around the grid.

    Views lie in the batch as spatial convolutions want them, in memory (B, V, U, H, W, C): the same numbers read as a
    volume (V, U, H·W) need no transposition, and a kernel of 3×3×1 on it is the angular convolution.

    Args:
        inputs: channels.
        outputs: channels.
        views: (V, U).
    """

    def __init__(self, inputs: int, outputs: int, views: tuple[int, int]) -> None:
        super().__init__(inputs, outputs, (3, 3, 1), padding=(1, 1, 0))
        self.views = views

    def forward(self, x: Tensor) -> Tensor:
        """(B·V·U, C, H, W) → (B·V·U, C', H, W), channels last in memory."""
        height, width = x.shape[2:]
        views = x.permute(0, 2, 3, 1).reshape(-1, *self.views, height * width, x.shape[1])
        features = self._alone(views) if len(views) == 1 else super().forward(views.permute(0, 4, 1, 2, 3))
        return features.permute(0, 2, 3, 4, 1).reshape(len(x), height, width, -1).permute(0, 3, 1, 2)

    def _alone(self, views: Tensor) -> Tensor:
        """(1, V, U, P, C) → (1, C', V, U, P): a batch of one has no fast 3-D convolution, but a dilated 2-D one."""
        columns, pixels = views.shape[2:4]
        strip = views.flatten(2, 3).permute(0, 3, 1, 2)
        features = conv2d(strip, self.weight[..., 0], self.bias, padding=(1, pixels), dilation=(1, pixels))
        return features.unflatten(3, (columns, pixels))


class SpatialAngularBlock(nn.Module):
    """A 3×3 convolution within each view, then one over the views at each pixel, each followed by a ReLU."""

    def __init__(self, inputs: int, width: int, views: tuple[int, int]) -> None:
        super().__init__()
        self.spatial = nn.Conv2d(inputs, width, 3, padding=1)
        self.angular = AngularConv(width, width, views)

    def forward(self, x: Tensor) -> Tensor:
        return relu(self.angular(relu(self.spatial(x), inplace=True)), inplace=True)


class SpatialAngularBody(nn.Module):
    """(B, V·U, inputs, H, W) → (B, V·U, H, W), any H and W, zero before it is trained.

    Every block sees the features of all blocks before it, the last convolution those of all (dense connections).

    Args:
        inputs: channels of each view.
        views: (V, U).
        width: channels that each block makes.
        blocks: number of blocks.
        gather: pixels gathered into channels along each axis at the entrance.
    """

    def __init__(self, inputs: int, views: tuple[int, int], width: int, blocks: int, gather: int) -> None:
        super().__init__()
        self.gather = gather
        self.reach = gather * (blocks + 2) + gather - 1
        self.enter = nn.Conv2d(inputs * gather**2, width, 3, padding=1)
        self.blocks = nn.ModuleList(SpatialAngularBlock(width * (i + 1), width, views) for i in range(blocks))
        self.leave = nn.Conv2d(width * (blocks + 1), gather**2, 3, padding=1)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d | nn.Conv3d) and not layer.weight.is_meta:  # else the signal fades
                nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
        silence(self.leave)

    def forward(self, x: Tensor) -> Tensor:
        batch, views, _, height, width = x.shape
        features = relu(self.enter(gathered(x.flatten(0, 1), self.gather, self.gather)), inplace=True)
        for block in self.blocks:
            features = torch.cat((features, block(features)), dim=1)
        pictures = pixel_shuffle(self.leave(features), self.gather)[..., :height, :width]
        return pictures.reshape(batch, views, height, width)


class SpatialAngular(Network):
    """The light field from a first estimate, by alternating spatial and angular convolutions.

    With ``stages=0`` it is the plain sub-network that the thesis takes as its deep decoder (3.2): one body adds to the
    first estimate what it has learned; it is told neither codes nor noise. With stages, each one first does
    ``x ← x + Aᵀ(A Aᵀ + R/τ²)⁻¹(y - A x)`` on the exact operator, closed because ``A Aᵀ`` is diagonal, then adds what
    its body makes of x, of how each view differs from their mean, of that step, of each view's code and of the noise,
    all relative to the local brightness. R is the noise variance of each sensor pixel and τ the error of x, a learned
    share of the brightness. The same step closes the chain: without noise the estimate explains the snapshot.

    The thesis says of its decoder only "the deep spatial-angular convolutional sub-network of (Guo et al., 2020)".
    Assumed here: number of blocks and width as below, 3×3 kernels, ReLU, start from ``"dagger"`` (the adjoint, which it
    does not name either, is too bright by ``A Aᵀ``), and pixels gathered, which makes dense convolutions fast.

    Args:
        bands: L = V·U, the number of views.
        views: (V, U), rows and columns of the grid; if None, a square one.
        start: first estimate, ``"adjoint"``, ``"dagger"``, ``"tikhonov"`` or ``"lmmse"``.
        stages: steps on the operator, each with a body; 0 for the plain sub-network.
        shared: all stages share one body.
        width: channels that each block makes for each view.
        blocks: spatial-angular blocks of a body.
        gather: pixels gathered along each axis at the entrance.
        buckets: R of a sensor pixel.

    Raises:
        SettingError: views that do not make up ``bands``, or sizes below 1.
    """

    kind = "spatial-angular"

    def __init__(
        self,
        *,
        bands: int = 25,
        views: Sequence[int] | None = None,
        start: str = "lmmse",
        stages: int = 1,
        shared: bool = False,
        width: int = 48,
        blocks: int = 4,
        gather: int = 4,
        buckets: int = 1,
    ) -> None:
        super().__init__(settings_of(locals()))
        self.views = grid_of_views(bands, views)
        self.settings["views"] = list(self.views)
        if stages < 0 or min(width, blocks, gather) < 1:
            found = f"{stages} stages, width {width}, {blocks} blocks, gather {gather}"
            raise SettingError("size", found, "no stage or more, all else at least 1")
        self.stages, self.codes = stages, stages > 0
        inputs, count = (5 + buckets, 1 if shared else stages) if stages else (1, 1)
        bodies = [SpatialAngularBody(inputs, self.views, width, blocks, gather) for _ in range(count)]
        self.bodies = nn.ModuleList(bodies)
        if stages:
            self.error = nn.Parameter(torch.full((stages + 1,), _FIRST_ERROR))
        self.reach = max(1, stages) * bodies[0].reach + (LEVEL_REACH if stages else 0)
        self.multiple = gather
        self.tile = max(64, min(TILE, isqrt(_MOST // (4 * bands * width * (blocks + 4) // gather**2 + 1))))

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        self.check(start)
        if not self.stages:
            return start + RESIDUAL * self.bodies[0](start[:, :, None]).to(start.dtype)
        if snapshot.shape[-1] != start.shape[-1]:
            found = f"a snapshot of {snapshot.shape[-1]} columns"
            raise ShapeError("network", found, f"{start.shape[-1]}, as many as the views have")
        level = local_level(start)
        sigmas = noise_maps(noise, level)[:, :, None].expand(-1, -1, self.bands, -1, -1)
        maps = (*(code.expand(start.shape) for code in code_maps(operator)), *sigmas.unbind(1))
        floor, estimate = noise.variance(snapshot.detach()) / level.square(), start
        for stage in range(self.stages):
            change = data_step(snapshot, operator, estimate, floor / softplus(self.error[stage]).square())
            estimate = estimate + change
            parallax = estimate - estimate.mean(1, keepdim=True)
            fine = (parallax / (RESIDUAL * level), change / (RESIDUAL * level))
            seen = torch.stack((estimate / level, *fine, *maps), dim=2)
            learned = self.bodies[stage % len(self.bodies)](seen)
            estimate = estimate + RESIDUAL * level * learned.to(estimate.dtype)
        return estimate + data_step(snapshot, operator, estimate, floor / softplus(self.error[-1]).square())


def grid_of_views(bands: int, views: Sequence[int] | None) -> tuple[int, int]:
    """(V, U) of so many views, square unless it is given.

    Raises:
        SettingError: views that do not make up ``bands``.
    """
    rows, columns = (isqrt(bands), isqrt(bands)) if views is None else (int(n) for n in views)
    if rows * columns != bands or rows < 1:
        found = f"{rows}×{columns} for {bands} channels"
        raise SettingError("views", found, "(V, U) with V·U channels", "name views where the grid is not square")
    return rows, columns
