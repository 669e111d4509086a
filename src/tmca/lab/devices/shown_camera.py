"""A camera with other codes in the place of its own, and while one slot of them is shown."""

from __future__ import annotations

import copy
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera
from tmca.errors import DeviceError
from tmca.lab.devices.sources import Planes
from tmca.optics import ZernikeHeights
from tmca.optics.zernike import noll


def showing(camera: Any, codes: Planes) -> Any:
    """The camera with the codes of an export in the place of its own.

    Raises:
        DeviceError: codes of another size.
    """
    found = _sharing(camera)
    if isinstance(camera, CodedCamera):
        own = dict(zip(("aperture", "shutter"), camera.codes(), strict=True))
        shown = {name: codes.planes.get(name, plane) for name, plane in own.items()}
        if codes.slots != camera.slots:  # one slot after the other, none of them masked
            shown["shutter"], found.slots = torch.ones_like(own["shutter"][:1]).expand(codes.slots, -1, -1), codes.slots
        for name, plane in shown.items():
            if plane.shape[1:] != own[name].shape[1:]:
                wanted = f"the camera's {tuple(own[name].shape)}"
                raise DeviceError("simulated bench", f"{name} of {tuple(plane.shape)}", wanted, "export them for it")
        found.multiplexed, found._fixed = _Shown(shown["aperture"], shown["shutter"]), None
    elif codes.modes:
        size, modes = camera.spread.heights.size, [noll(int(index)) for index in codes.modes["noll"]]
        found.spread, found._kept = _sharing(camera.spread), None
        found.spread.heights = ZernikeHeights(codes.modes["coefficients"], modes, size)
    return found


def _sharing(module: Any) -> Any:
    """A module of the same parts; others can take their place without a change of the first."""
    found = copy.copy(module)
    found._modules, found._buffers = dict(module._modules), dict(module._buffers)
    return found


def of_one_slot(camera: Any, slot: int, share: int) -> Any:
    """The camera while one slot, the ``share``-th part of an exposure, is shown, its shutter open.

    A slot of an equal exposure lasts the K-th part of it: the sensor collects a K-th of the light, and what it reads is
    K-fold, so that snapshots of all slots, masked, average to that of the exposure, shot and read noise as they are.
    """
    found = _sharing(camera)
    found.sensor = sub_exposed(camera, share)
    found.slots, found.exposure = 1, "equal"
    if isinstance(camera, CodedCamera):
        found.multiplexed, found._fixed = _OneSlot(camera.multiplexed, slot), None
        return found
    found.shutter, found._kept = _Open(camera.shutter), None
    found.spread = _sharing(camera.spread)
    found.spread.heights = _OneMap(camera.spread.heights, slot)
    return found


class _Shown(nn.Module):
    """Fixed patterns of both planes."""

    learnable = False
    aperture: Tensor
    shutter: Tensor

    def __init__(self, aperture: Tensor, shutter: Tensor) -> None:
        super().__init__()
        self.register_buffer("aperture", aperture)
        self.register_buffer("shutter", shutter)

    def forward(self) -> tuple[Tensor, Tensor]:
        return self.aperture, self.shutter


class _OneSlot(nn.Module):
    """(aperture, open shutter) of one slot."""

    learnable = False

    def __init__(self, codes: nn.Module, slot: int) -> None:
        super().__init__()
        self.codes, self.slot = codes, slot

    def forward(self) -> tuple[Tensor, Tensor]:
        aperture, shutter = self.codes()
        return aperture[self.slot : self.slot + 1], torch.ones_like(shutter[:1])


class _Open(nn.Module):
    """An open shutter in the place of a coded one."""

    period = None

    def __init__(self, plane: nn.Module) -> None:
        super().__init__()
        self.plane = plane

    def forward(self) -> Tensor:
        return torch.ones_like(self.plane()[:1])

    def part(self, rows: slice, columns: slice) -> Tensor:
        return self()[:, rows, columns]


class _OneMap(nn.Module):
    """The height map of one slot."""

    def __init__(self, heights: nn.Module, slot: int) -> None:
        super().__init__()
        self.heights, self.slot, self.size = heights, slot, heights.size

    def forward(self) -> Tensor:
        found: Tensor = self.heights()[self.slot : self.slot + 1]
        return found


def sub_exposed(camera: Any, share: int) -> nn.Module:
    """The camera's sensor in one of the ``share`` exposures that emulate a coded one."""
    return camera.sensor if camera.exposure == "per-slot" else _SubExposure(camera.sensor, share)


class _SubExposure(nn.Module):
    """A sensor that is exposed for a share of the time and read with as much more gain."""

    def __init__(self, sensor: nn.Module, share: int) -> None:
        super().__init__()
        self.sensor, self.share = sensor, share

    def forward(self, irradiance: Tensor, full_scale: float, generator: Any = None, exposures: int = 1) -> Tensor:
        found: Tensor = self.sensor(irradiance / self.share, full_scale, generator, exposures)
        return found * self.share
