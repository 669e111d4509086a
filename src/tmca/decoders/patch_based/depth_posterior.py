"""Depth from the probability of every plane: the median, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.optics import DepthPlanes


@dataclass(frozen=True)
class DepthPosterior:
    """What is known of depth, pixel by pixel.

    Args:
        metres: (B, 1, H, W) median of depth, the estimate of least expected absolute error.
        plane: (B, 1, H, W) index of the plane that is in its bin.
        confidence: (B, 1, H, W) probability of that plane and its neighbours.
        shares: (B, D, H, W) probability of every plane.
    """

    metres: Tensor
    plane: Tensor
    confidence: Tensor
    shares: Tensor

    @classmethod
    def of(cls, log_probability: Tensor, planes: DepthPlanes) -> DepthPosterior:
        """From the log-probability (B, D, H, W) of every plane, up to a constant.

        Within the bin of a plane all inverse depths are taken as equally likely; nothing is nearer than the nearest
        plane or farther than the farthest.
        """
        inverse, shares = planes.inverse.to(log_probability), log_probability.softmax(1)
        total = shares.cumsum(1)
        plane = (total >= 0.5 * total[:, -1:]).to(torch.uint8).argmax(1, keepdim=True)
        own = shares.gather(1, plane)
        into = 1 - (total.gather(1, plane) - 0.5) / own  # share of the bin that is farther than the median
        place = (inverse[plane] + (into.clamp(0, 1) - 0.5) * planes.step).clamp(float(inverse[0]), float(inverse[-1]))
        around = (torch.arange(planes.count, device=plane.device)[:, None, None] - plane).abs() <= 1
        return cls(1 / place, plane, (shares * around).sum(1, keepdim=True), shares)
