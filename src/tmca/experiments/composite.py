"""Spectral cubes as colour pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

RGB_WAVELENGTHS = (650e-9, 550e-9, 480e-9)
"""Bands shown as red, green and blue, metres (thesis section 4.2)."""


def rgb_bands(wavelengths: Sequence[float]) -> tuple[int, int, int]:
    """Indices of the bands nearest to 650, 550 and 480 nm."""
    axis = np.asarray(wavelengths)
    red, green, blue = (int(np.abs(axis - w).argmin()) for w in RGB_WAVELENGTHS)
    return red, green, blue


def white_level(cube: np.ndarray, wavelengths: Sequence[float]) -> float:
    """Irradiance shown as white: the 99.5 % quantile of the three bands."""
    level = float(np.quantile(cube[list(rgb_bands(wavelengths))], 0.995))
    return level if level > 0 else 1.0


def rgb_composite(cube: np.ndarray, wavelengths: Sequence[float], white: float | None = None) -> np.ndarray:
    """(L, H, W) cube → (H, W, 3) picture in [0, 1], gamma 2.2.

    Args:
        cube: relative irradiance.
        wavelengths: (L,) metres.
        white: irradiance shown as white; pass the truth's ``white_level`` to compare estimates.
    """
    level = white_level(cube, wavelengths) if white is None else white
    picture = np.clip(cube[list(rgb_bands(wavelengths))] / level, 0, 1) ** (1 / 2.2)
    return np.moveaxis(picture, 0, -1)
