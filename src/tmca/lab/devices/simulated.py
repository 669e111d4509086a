"""A bench that is computed: a scene, the camera as it really is, and its sensor's digital numbers."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tmca.cameras import Camera, CodedCamera
from tmca.cameras.hardware import Hardware, imperfect
from tmca.errors import SettingError
from tmca.lab.devices.export import Export
from tmca.lab.devices.protocol import DeviceError
from tmca.lab.devices.reading import read_export
from tmca.lab.devices.sources import Planes
from tmca.optics import ZernikeHeights
from tmca.optics.zernike import noll


class SimulatedBench:
    """A bench with a scene before it.

    Args:
        camera: as it is known; it images the codes that are loaded.
        scene: what the camera takes: (1, L, H, W), or light field, or cube and depth.
        hardware: faults that nobody is told of.
        bits: of the digital numbers.
        black: digital number of no light.
        seed: of noise and faults.
        stops_after: frames after which it does not answer any more; never without.

    Raises:
        SettingError: bits or black level that leave no range.
    """

    def __init__(
        self,
        camera: Camera,
        scene: Sequence[Tensor],
        *,
        hardware: Hardware | None = None,
        bits: int = 16,
        black: int = 256,
        seed: int = 0,
        stops_after: int | None = None,
    ) -> None:
        if not (1 <= bits <= 16 and 0 <= black < 2**bits - 1):
            raise SettingError(
                "simulated bench", f"{bits} bits, black at {black}", "up to 16 bits, black below its top"
            )
        self.known, self.hardware = camera, hardware or Hardware()
        self.camera = imperfect(camera, self.hardware, seed)
        self.scene, self.black, self.seed, self.left = tuple(scene), black, seed, stops_after
        self.saturation = float(2**bits - 1)
        self.loaded, self.taken = False, 0
        self.shown: int | None = None

    @property
    def gain(self) -> float:
        """Snapshot units of a digital number."""
        return self.known.full_scale / (self.saturation - self.black)

    def load(self, export: Export) -> None:
        """See ``Device``; from then on it images what was exported, a mirror's own terms among it."""
        codes = read_export(export.folder)
        if codes.slots != self.known.slots:
            raise DeviceError("simulated bench", f"{codes.slots} slots", f"the camera's {self.known.slots}")
        self.camera = imperfect(showing(self.known, codes), self.hardware, self.seed)
        self.loaded = True

    def show(self, slot: int | None) -> None:
        """See ``Device``."""
        if not self.loaded:
            raise DeviceError("simulated bench", "no patterns", "those of an export", "load one first")
        if slot is not None and not 0 <= slot < self.camera.slots:
            raise DeviceError("simulated bench", f"slot {slot}", f"0 to {self.camera.slots - 1}")
        self.shown = slot

    def capture(self, whole: bool = False) -> NDArray[np.integer]:
        """See ``Device``."""
        if self.left is not None and self.taken >= self.left:
            raise DeviceError("simulated bench", f"no answer after {self.taken} frames", "a frame", "run it again")
        self.taken += 1
        camera = self.camera if whole else None if self.shown is None else of_one_slot(self.camera, self.shown)
        with torch.no_grad():
            light = self._dark() if camera is None else camera(*self.scene, self._noise())
        numbers = (self.black + light / self.gain).round().clamp(0, self.saturation)[0]
        found = numbers.numpy().astype(np.uint16)
        return found[0] if len(found) == 1 else found

    def _noise(self) -> torch.Generator:
        return torch.Generator().manual_seed(1000 * self.seed + self.taken)

    def _dark(self) -> Tensor:
        return self.camera.record(torch.zeros(1, *self.camera.snapshot_shape), self._noise())


def showing(camera: Any, codes: Planes) -> Any:
    """The camera with the codes of an export in the place of its own.

    Raises:
        DeviceError: codes of another size.
    """
    found = _sharing(camera)
    if isinstance(camera, CodedCamera):
        own = dict(zip(("aperture", "shutter"), camera.codes(), strict=True))
        shown = {name: codes.planes.get(name, plane) for name, plane in own.items()}
        for name, plane in shown.items():
            if plane.shape != own[name].shape:
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


def of_one_slot(camera: Any, slot: int) -> Any:
    """The camera while one slot is shown, its shutter open, in the units of a whole exposure."""
    found = _sharing(camera)
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
