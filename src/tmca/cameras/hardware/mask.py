"""A phase mask whose heights are not quite known, behind optics with an aberration."""

from __future__ import annotations

from math import pi

import torch
from torch import Tensor, nn

from tmca.optics.zernike import noll, zernike_modes

_ABERRATIONS = range(4, 16)
"""Noll's numbers of the modes of a drawn wavefront: defocus to the fourth order, no piston and no tilt."""


class ImperfectHeights(nn.Module):
    """Height maps of a device whose scale is not the one that is known.

    Args:
        heights: (K, H, W) metres.
        error: share by which all differ.
    """

    def __init__(self, heights: nn.Module, error: float) -> None:
        super().__init__()
        self.heights, self.error, self.size = heights, error, heights.size

    def forward(self) -> Tensor:
        """(K, H, W) metres."""
        found: Tensor = self.heights() * (1 + self.error)
        return found


def aberration(rms: float, size: tuple[int, int], seed: int) -> Tensor:
    """(H, W) metres of path, drawn, of this root mean square over the pupil."""
    modes = zernike_modes([noll(index) for index in _ABERRATIONS], size).double()
    drawn = torch.randn(len(modes), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.tensordot(rms * drawn / drawn.norm(), modes, 1)


def aberrated(waves: Tensor, path: Tensor, wavelengths: tuple[float, ...]) -> Tensor:
    """Fields (D, L, H, W) after a path (H, W) in metres."""
    turns = path.to(waves.device) / torch.tensor(wavelengths, dtype=path.dtype, device=waves.device)[:, None, None]
    return waves * torch.polar(torch.ones_like(turns), 2 * pi * turns).to(waves)
