"""Depth planes: evenly spaced in inverse depth, and which plane every pixel belongs to (thesis eq. 29, errata)."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import torch
from torch import Tensor

from tmca.errors import SettingError, check_range, check_shape

ROUNDING = 1e-6
"""By how much of itself a depth may be beyond the range: what single precision makes of its ends."""


@dataclass(frozen=True)
class DepthPlanes:
    """D planes from far to near, evenly spaced in inverse depth.

    Args:
        near, far: nearest and farthest plane, metres; ``far`` may be ``inf``.
        count: D ≥ 1; one plane is the one in the middle.

    Raises:
        SettingError: planes that are not in front of the camera, or none.
    """

    near: float
    far: float
    count: int

    def __post_init__(self) -> None:
        if not 0 < self.near < self.far or not isfinite(self.near):
            raise SettingError("depth", f"{self.near:g} to {self.far:g} m", "0 < near < far")
        check_range("depth planes", self.count, 1, whole=True)

    @property
    def step(self) -> float:
        """Distance of planes in inverse metres: a depth bin."""
        return (1 / self.near - 1 / self.far) / max(1, self.count - 1)

    @property
    def inverse(self) -> Tensor:
        """(D,) inverse metres, from far to near, float64."""
        low, high = 1 / self.far, 1 / self.near
        if self.count == 1:
            return torch.tensor([(low + high) / 2], dtype=torch.float64)
        return torch.linspace(low, high, self.count, dtype=torch.float64)

    @property
    def metres(self) -> Tensor:
        """(D,) from far to near, float64; the first may be infinite."""
        return 1 / self.inverse

    def share_of(self, depth: Tensor) -> Tensor:
        """Inverse depth as a share of the range: 0 at the farthest plane, 1 at the nearest, not clamped."""
        return (1 / depth - 1 / self.far) / (1 / self.near - 1 / self.far)

    def depth_of(self, share: Tensor) -> Tensor:
        """Metres of a share of the range."""
        return 1 / (1 / self.far + share * (1 / self.near - 1 / self.far))

    def within(self, depth: Tensor) -> Tensor:
        """Where depth is a number in the design range, rounding apart; boolean, shape of ``depth``."""
        inside = (depth >= self.near * (1 - ROUNDING)) & (depth <= self.far * (1 + ROUNDING))
        return torch.isfinite(depth) & inside

    def nearest(self, depth: Tensor) -> Tensor:
        """Index of the plane nearest in inverse depth, int64, beyond the range that of its end; of what is no depth
        (not finite, zero, negative) 0."""
        place = (1 / depth.double() - 1 / self.far) / self.step if self.count > 1 else torch.zeros_like(depth).double()
        place = torch.where(torch.isfinite(depth) & (depth > 0), place, torch.zeros_like(place))
        return place.clamp(0, self.count - 1).round().long()

    def weights(self, depth: Tensor) -> Tensor:
        """ω (B, D, H, W) of depth (B, 1, H, W) in metres: one in the plane of every pixel, zero in the others.

        Raises:
            ShapeError: another shape.
        """
        check_shape("depth", depth, ("B", 1, "H", "W"))
        planes = torch.arange(self.count, device=depth.device)[None, :, None, None]
        return (self.nearest(depth) == planes).to(torch.float32)
