"""Where a mask lies on the pixels of the scene: an affine map about the middle, as numbers that a search can move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

NAMES = ("down", "right", "rotation", "scale", "stretch", "shear", "light", "blur")
"""Coordinates of a search: the first six move the edge of the frame by so many pixels, light is a logarithm, blur the
share of the mask's pixels that is spread over their neighbours."""
_ROOM, _BLUR = 12, (0.25, 0.5, 0.25)


@dataclass(frozen=True)
class MaskPlacement:
    """How the mask of a camera lies on the scene: ``frame = middle + matrix · (mask − middle) + shift``, rows first.

    Args:
        shift: (down, right), pixels.
        matrix: (2, 2), rows and columns of the frame by those of the mask.
        light: of the mask's open pixels times the brightness of the scene, 1 as camera and prior expect. A bright scene
            cannot be told from much light: estimates are not scaled by it.
        blur: variance along each axis of what blurs the mask, pixels².
    """

    shift: tuple[float, float]
    matrix: tuple[tuple[float, float], tuple[float, float]]
    light: float = 1.0
    blur: float = 0.0

    @classmethod
    def of(cls, vector: np.ndarray, size: tuple[int, int]) -> MaskPlacement:
        """That of a vector of ``NAMES`` for a frame (H, W)."""
        linear = np.linalg.inv(_inverse(torch.as_tensor(vector, dtype=torch.float64), size).numpy())
        rows = [(float(one), float(other)) for one, other in linear]
        shift, light, blur = (float(vector[0]), float(vector[1])), math.exp(float(vector[6])), float(vector[7]) / 2
        return cls(shift, (rows[0], rows[1]), light, blur)

    @property
    def rotation(self) -> float:
        """Degrees, from rows towards columns."""
        (a, b), (c, d) = self.matrix
        return math.degrees(math.atan2(c - b, a + d))

    @cached_property
    def strain(self) -> np.ndarray:
        """(2, 2) symmetric part of the matrix, the rotation taken away: scales along y and x, and shear."""
        angle = math.radians(self.rotation)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        return np.asarray(turn.T @ np.array(self.matrix))

    def described(self) -> dict[str, Any]:
        """The same as plain numbers: shift (pixels), rotation (degrees), scales along y and x, shear, light, blur (the
        standard deviation, pixels)."""
        (along_y, shear), (_, along_x) = self.strain.tolist()
        return {
            "shift": self.shift, "rotation": self.rotation, "scale": (along_y, along_x), "shear": shear,
            "light": self.light, "blur": math.sqrt(self.blur),
        }  # fmt: skip

    def __str__(self) -> str:
        (down, right), strain = self.shift, self.strain
        return (
            f"{down:+.3f} px down, {right:+.3f} px right, turned by {self.rotation:+.4f}°, "
            f"{strain[0, 0]:.5f} × {strain[1, 1]:.5f} as large, shear {strain[0, 1]:+.5f}, "
            f"blurred by {math.sqrt(self.blur):.2f} px, {self.light:.3f} times as bright as the prior"
        )


def _inverse(vector: Tensor, size: tuple[int, int]) -> Tensor:
    """(2, 2) from the frame to the mask."""
    turn, scale, stretch, shear = vector[2:6] / (max(size) / 2)
    rows = (torch.stack([1 - scale - stretch, turn - shear]), torch.stack([-turn - shear, 1 - scale + stretch]))
    return torch.stack(rows)


def seen_from(vector: Tensor, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """(H, W) rows and columns of the mask that the pixels of a frame see; differentiable in the vector."""
    axes = [torch.arange(side, dtype=vector.dtype) - (side - 1) / 2 for side in size]
    down, right = torch.meshgrid(*axes, indexing="ij")
    away = torch.stack([down - vector[0], right - vector[1]])
    rows, columns = torch.tensordot(_inverse(vector, size), away, 1)
    return rows + (size[0] - 1) / 2, columns + (size[1] - 1) / 2


class SmoothPlanes:
    """Planes (K, H, W) as cubic splines, sharp and blurred by (1, 2, 1)/4 along each axis; the nearest pixel beyond.

    Args:
        planes: of a mask, in [0, 1].
    """

    def __init__(self, planes: Tensor) -> None:
        from scipy.ndimage import convolve1d, spline_filter

        wide = np.pad(planes.numpy(force=True).astype(np.float64), ((0, 0), (_ROOM,) * 2, (_ROOM,) * 2), mode="edge")
        sharp = np.stack([spline_filter(one, mode="mirror") for one in wide])
        blurred = convolve1d(convolve1d(sharp, _BLUR, 1), _BLUR, 2)
        self.sharp, self.change = (torch.from_numpy(one).to(planes.dtype) for one in (sharp, blurred - sharp))

    def __call__(self, rows: Tensor, columns: Tensor, blur: Tensor | float = 0.0) -> Tensor:
        """(K, …) values at rows and columns (…), in [0, 1]; ``blur`` is the share of the blurred ones."""
        coefficients = self.sharp + blur * self.change
        width = self.sharp.shape[2]
        (row, along_y), (column, along_x) = (
            _weights((place + _ROOM).clamp(1, side - 3))
            for place, side in zip((rows, columns), coefficients.shape[1:], strict=True)
        )
        flat, total = coefficients.flatten(1), torch.zeros(())
        for down, outer in enumerate(along_y):
            line = (row + down) * width + column
            total = total + outer * sum(inner * flat[:, line + right] for right, inner in enumerate(along_x))
        return total.clamp(0, 1)


def _weights(places: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Index of the first of four coefficients at some places, and the weights of cubic splines."""
    first = places.detach().floor()
    after = places - first
    before = 1 - after
    weights = [
        before**3 / 6,
        (4 - 3 * after**2 * (2 - after)) / 6,
        (4 - 3 * before**2 * (2 - before)) / 6,
        after**3 / 6,
    ]
    return first.long() - 1, weights
