"""What every network of a collapsed camera is, and the maps that it sees."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator, sum_by_channel
from tmca.sensor import Noise

STARTS = ("adjoint", "dagger", "tikhonov", "lmmse", "mixture")
"""First estimates from which networks start."""
NEED_PRIOR = ("lmmse", "mixture")
_NOISE_UNIT = 3.0  # brings relative noise to the size of the other inputs
RESIDUAL = 0.1
"""Size of what a network adds to an estimate, relative to the local level: first steps then do no harm."""
_SIDE = 33  # pixels, of the neighbourhood that says how bright the scene is
LEVEL_REACH = _SIDE // 2
TILE = 512
"""Pixels: rows of a scene that pass a network at once, as a rule."""
_DARKEST = 0.01  # relative irradiance


class Network(nn.Module):
    """A network that turns a snapshot, its operator and a first estimate into the scene.

    Subclasses take keyword arguments only, all JSON values, and keep them in ``settings``.

    Args:
        bands: L.
        start: first estimate it wants, see ``first_estimate``.

    ``reach`` is the distance in pixels beyond which nothing of the input changes an output pixel, ``multiple`` the
    step by which a window may be moved without changing what the network computes, ``tile`` the side in pixels of
    what should pass at once to keep the memory bounded.
    """

    kind: ClassVar[str]

    def __init__(self, bands: int, start: str) -> None:
        super().__init__()
        if start not in STARTS:
            raise SettingError("start", repr(start), f"one of {', '.join(STARTS)}")
        if bands < 1:
            raise SettingError("bands", str(bands), "at least 1")
        self.bands, self.start = bands, start
        self.reach, self.multiple, self.tile = 0, 1, TILE
        self.settings: dict[str, Any] = {}

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        """(B, 1, H, W') and the first estimate (B, L, H, W) → (B, L, H, W); any H and W."""
        raise TypeError(f"{type(self).__name__} defines no forward")

    def check(self, start: Tensor) -> None:
        """Raises ShapeError unless the first estimate has this network's bands."""
        if start.ndim != 4 or start.shape[1] != self.bands:
            raise ShapeError("network", f"an estimate of shape {tuple(start.shape)}", f"(batch, {self.bands}, H, W)")


def code_maps(operator: TapOperator) -> Tensor:
    """(1, L, H, W) code of every band as it weighs the scene, fractional taps summed."""
    taps = operator.taps
    return sum_by_channel(taps.code, taps.channels, taps.scene_channels)[None]


def local_level(start: Tensor) -> Tensor:
    """(B, 1, H, W) brightness of the scene around every pixel: mean over bands and a square neighbourhood.

    Networks work on values divided by it, so that dark and bright scenes look alike and only their relative noise
    differs; being local, it is the same for a patch and for the whole image.
    """
    mean = start.detach().mean(1, keepdim=True).clamp_min(0)
    return avg_pool2d(mean, _SIDE, 1, _SIDE // 2, count_include_pad=False).clamp_min(_DARKEST)


def noise_maps(noise: Noise, level: Tensor) -> Tensor:
    """(B, 2, H, W) standard deviations of read and shot noise relative to the local level."""
    shot = torch.full_like(level, noise.shot).div(level).sqrt()
    return _NOISE_UNIT * torch.cat((noise.read / level, shot), dim=1)
