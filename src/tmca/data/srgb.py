"""The curve of sRGB (IEC 61966-2-1): stored values to relative irradiance and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def decoded(stored: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear values in [0, 1] of sRGB values in [0, 1], any shape."""
    curved = ((np.maximum(stored, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(stored <= 0.04045, stored / 12.92, curved).astype(np.float32)


def encoded(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """sRGB values in [0, 1] of linear values in [0, 1], any shape."""
    curved = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curved).astype(np.float32)
