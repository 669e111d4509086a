"""What every neural decoder of a collapsed camera is, and how one is built from its settings."""

from __future__ import annotations

import inspect
from math import lcm
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from tmca.decoders.networks.start import STARTS
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator, sum_by_channel
from tmca.sensor import Noise

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

    kind: str

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


def seen_by_tile(network: Any, begin: int, end: int, length: int, period: int = 1) -> tuple[int, int]:
    """First and last (exclusive) row or column that a tile from ``begin`` to ``end`` needs of ``length`` ones.

    ``network`` says its ``reach`` and ``multiple``; the first is also a multiple of ``period``, that of the codes.
    """
    margin, step = -(-network.reach // network.multiple) * network.multiple, lcm(network.multiple, period)
    return max(0, (begin - margin) // step * step), min(length, end + margin)


def build_network(kind: str, **settings: Any) -> Network:
    """A network by name: ``"unet"``, ``"unrolled"`` or ``"spatial-angular"``.

    Args:
        kind: which one.
        settings: its keyword arguments.

    Raises:
        SettingError: unknown kind or argument.
    """
    from tmca.decoders.networks.spatial_angular import SpatialAngular
    from tmca.decoders.networks.unet import UNet
    from tmca.decoders.networks.unrolled import Unrolled

    kinds: dict[str, type[Network]] = {"unet": UNet, "unrolled": Unrolled, "spatial-angular": SpatialAngular}
    if not isinstance(kind, str) or kind not in kinds:
        raise SettingError("decoder", repr(kind), f"one of {', '.join(kinds)}")
    known = [name for name in inspect.signature(kinds[kind]).parameters if name != "self"]
    unknown = [name for name in settings if name not in known]
    if unknown:
        raise SettingError(f"decoder {kind}", ", ".join(unknown), f"some of {', '.join(known)}")
    try:
        return kinds[kind](**settings)
    except SettingError:
        raise
    except (TypeError, ValueError, RuntimeError, ZeroDivisionError) as error:
        raise SettingError(f"decoder {kind}", str(settings), "numbers that make a network", str(error)) from None
