"""What every network of a collapsed camera is, what networks share, and the maps that they see."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, pad, pixel_unshuffle

from tmca.errors import check_choice, check_range, check_shape
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
    """A network that turns a snapshot (B, 1, H, W'), its operator, the noise and a first estimate into the scene.

    A first estimate and the scene are (B, L, H, W), any H and W. Subclasses take keyword arguments only, all JSON
    values.

    Args:
        settings: a subclass's arguments, among them ``bands``, L, and ``start``, the first estimate that it wants, see
            ``first_estimate``.

    Raises:
        SettingError: another start, or no band.

    ``reach`` is the distance in pixels beyond which nothing of the input changes an output pixel, ``multiple`` the
    step by which a window may be moved without changing what the network computes, ``tile`` the side in pixels of
    what should pass at once to keep the memory bounded.
    """

    kind: ClassVar[str]
    any_bands: ClassVar[bool] = False
    """Whether it serves cameras of any bands, codes and buckets, once ``at`` has told it the wavelengths."""

    def __init__(self, settings: dict[str, Any]) -> None:
        super().__init__()
        check_choice("start", settings["start"], STARTS)
        check_range("bands", settings["bands"], 1)
        self.settings, self.bands, self.start = settings, int(settings["bands"]), str(settings["start"])
        self.reach, self.multiple, self.tile = 0, 1, TILE

    def check(self, start: Tensor) -> None:
        """Raises ShapeError unless the first estimate has this network's bands."""
        check_shape("network", start, ("B", self.bands, "H", "W"))

    def outputs(self, *given: Any) -> tuple[Tensor, ...]:
        """The scene (B, L, H, W) and, of a network that predicts it, its standard deviation."""
        return (self(*given),)


def settings_of(arguments: dict[str, Any]) -> dict[str, Any]:
    """The settings of a network as JSON values, from the ``locals()`` with which its constructor begins."""
    given = {name: value for name, value in arguments.items() if name not in ("self", "__class__")}
    return {name: list(value) if isinstance(value, (list, tuple)) else value for name, value in given.items()}


def gathered(x: Tensor, gather: int, multiple: int) -> Tensor:
    """Pixels of (B, C, H, W) gathered into channels, last in memory; edges are repeated up to a multiple of pixels."""
    extra = (-x.shape[2] % multiple, -x.shape[3] % multiple)
    x = pad(x, (0, extra[1], 0, extra[0]), mode="replicate") if any(extra) else x
    return pixel_unshuffle(x, gather).contiguous(memory_format=torch.channels_last)


def silence(layer: nn.Conv2d) -> None:
    """Let a layer start at zero."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)


def code_maps(operator: TapOperator) -> Tensor:
    """(R, L, H, W) code of every bucket and band as it weighs the scene, fractional taps summed."""
    taps = operator.taps
    channels = taps.of_bucket(taps.channels)
    return torch.stack([sum_by_channel(code, channels, taps.scene_channels) for code in taps.bucket_code])


def local_level(start: Tensor) -> Tensor:
    """(B, 1, H, W) brightness of the scene around every pixel: mean over bands and a square neighbourhood.

    Networks work on values divided by it, so that dark and bright scenes look alike and only their relative noise
    differs; being local, it is the same for a patch and for the whole image.
    """
    mean = start.detach().mean(1, keepdim=True).clamp_min(0)
    for side in ((_SIDE, 1), (1, _SIDE)):  # a square at once takes seventeen times as long
        around = (side[0] // 2, side[1] // 2)
        mean = avg_pool2d(mean, side, 1, around, count_include_pad=False)
    return mean.clamp_min(_DARKEST)


def noise_maps(noise: Noise, level: Tensor) -> Tensor:
    """(B, 2, H, W) standard deviations of read and shot noise relative to the local level."""
    shot = torch.full_like(level, noise.shot).div(level).sqrt()
    return _NOISE_UNIT * torch.cat((noise.read / level, shot), dim=1)


def data_step(snapshot: Tensor, operator: TapOperator, estimate: Tensor, shift: Tensor) -> Tensor:
    """``Aᵀ(A Aᵀ + shift)⁻¹(y - A x)``, in full precision."""
    with torch.autocast(snapshot.device.type, enabled=False):
        return operator.A_adjoint(operator.gram_solve(snapshot - operator.A(estimate), shift))
