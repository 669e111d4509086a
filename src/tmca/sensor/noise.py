"""Random and digital steps of a sensor, each with a derivative that training can use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tmca.errors import SettingError


@dataclass(frozen=True)
class Noise:
    """What a decoder has to know of a sensor's noise: variance ``read² + shot · snapshot`` per pixel.

    Args:
        read: standard deviation of the signal-independent part, snapshot units.
        shot: variance per unit of snapshot, full scale / full well.

    Raises:
        SettingError: a negative number.
    """

    read: float = 0.0
    shot: float = 0.0

    def __post_init__(self) -> None:
        if not (self.read >= 0 and self.shot >= 0):
            raise SettingError("noise", f"read noise {self.read}, shot {self.shot}", "numbers ≥ 0")

    def variance(self, snapshot: Tensor) -> Tensor:
        """Variance of every pixel of a snapshot, snapshot units squared."""
        return self.read**2 + self.shot * snapshot.clamp_min(0)


class _Poisson(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, electrons: Tensor, generator: torch.Generator | None) -> Tensor:
        mean = electrons.clamp_min(0)
        drawn = torch.poisson(mean, generator)
        ctx.save_for_backward(mean, drawn)
        return drawn

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        # pathwise derivative of mean + sqrt(mean)·z at the drawn z
        mean, drawn = ctx.saved_tensors
        return grads[0] * (1 + (drawn - mean) / (2 * mean.clamp_min(1.0))), None


def shot_noise(electrons: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Poisson counts of expected ``electrons``; the derivative is that of the Gaussian of equal mean and variance."""
    return _Poisson.apply(electrons, generator)


class _Round(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        return values.round()

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        return grads[0]


def quantise(values: Tensor, low: float, high: float, bits: int) -> Tensor:
    """Nearest of 2^bits evenly spaced levels from ``low`` to ``high``; passes gradients straight through inside."""
    step = (high - low) / (2**bits - 1)
    return _Round.apply((values.clamp(low, high) - low) / step) * step + low
