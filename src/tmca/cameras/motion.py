"""Scenes that move within the exposure."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.errors import SettingError


def moving_scene(scene: Tensor, displacement: tuple[float, float], slots: int) -> Tensor:
    """(L, H, W) → (K, L, H, W): the scene displaced evenly over the exposure, itself in the middle; bilinear, its edge
    continued.

    Args:
        scene: (L, H, W).
        displacement: rows and columns from the beginning to the end of the exposure, pixels.
        slots: K; each slot shows the scene at the slot's own middle.

    Raises:
        SettingError: a displacement as large as the scene.
    """
    height, width = scene.shape[1:]
    if abs(displacement[0]) >= height or abs(displacement[1]) >= width:
        raise SettingError(
            "motion", f"{displacement[0]:g},{displacement[1]:g}", f"less than the scene's {height}×{width}"
        )
    times = (torch.arange(slots, dtype=torch.float64) + 0.5) / slots - 0.5
    theta = torch.zeros(slots, 2, 3, dtype=scene.dtype)
    theta[:, 0, 0] = theta[:, 1, 1] = 1
    theta[:, 0, 2] = (-2 * displacement[1] * times / width).to(scene.dtype)
    theta[:, 1, 2] = (-2 * displacement[0] * times / height).to(scene.dtype)
    grid = torch.nn.functional.affine_grid(theta, [slots, 1, height, width], align_corners=False)
    stack = scene.expand(slots, -1, -1, -1)
    return torch.nn.functional.grid_sample(stack, grid, padding_mode="border", align_corners=False)
