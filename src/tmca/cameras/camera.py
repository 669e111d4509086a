"""What every camera has: a scene's size, K slots of one exposure, and a sensor that records."""

from __future__ import annotations

import copy
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from tmca.cameras.checks import checked_size, choice
from tmca.operators import EXPOSURES
from tmca.sensor import Noise, Sensor


class Camera(nn.Module):
    """K slots of one exposure before a sensor.

    Args:
        size: (H, W) of the scene, pixels.
        slots: number of time slots K.
        exposure: ``"equal"`` or ``"per-slot"``.
        sensor: ideal if None.

    Raises:
        SettingError: an impossible size, number of slots or exposure.
    """

    kind: ClassVar[str]
    channel: ClassVar[str]

    def __init__(self, size: tuple[int, int], slots: int, exposure: str, sensor: Sensor | None) -> None:
        super().__init__()
        self.size, self.slots = checked_size(size), slots
        self.exposure = choice("exposure", exposure, EXPOSURES)
        self.sensor = sensor or Sensor()

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(C, H, W')."""
        raise TypeError(f"{type(self).__name__} defines no snapshot_shape")

    @property
    def white(self) -> float:
        """Level of a white scene with everything open in one exposure time, snapshot units."""
        raise TypeError(f"{type(self).__name__} defines no white")

    @property
    def full_scale(self) -> float:
        """Level of a white scene with everything open, snapshot units: ``white``, K times that per slot."""
        return self.white * self.exposures

    @property
    def noise(self) -> Noise:
        """Read and shot noise in snapshot units."""
        return self.sensor.noise(self.white, self.exposures)

    def record(self, irradiance: Tensor, generator: torch.Generator | int | None = None) -> Tensor:
        """What the sensor makes of exact irradiance of any shape: noise, saturation, converter."""
        return self.sensor(irradiance, self.white, generator, self.exposures)

    @property
    def exposures(self) -> int:
        """Exposure times that are accumulated: K per slot."""
        return self.slots if self.exposure == "per-slot" else 1


def sharing(module: Any) -> Any:
    """A module of the same parts; others can take their place without a change of the first."""
    found = copy.copy(module)
    found._modules, found._buffers = dict(module._modules), dict(module._buffers)
    return found
