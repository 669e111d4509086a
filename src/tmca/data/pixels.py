"""The curve of sRGB (IEC 61966-2-1): stored values to relative irradiance and back."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError


def decoded(stored: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear values in [0, 1] of sRGB values in [0, 1], any shape."""
    curved = ((np.maximum(stored, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(stored <= 0.04045, stored / 12.92, curved).astype(np.float32)


def encoded(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """sRGB values in [0, 1] of linear values in [0, 1], any shape."""
    curved = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curved).astype(np.float32)


_Value = TypeVar("_Value", bound=np.generic)


def centre_crop(shape: tuple[int, int], size: tuple[int, int] | None) -> tuple[slice, slice]:
    """The largest centred window of ``shape`` with the proportions of ``size``; all of it for None.

    Raises:
        SettingError: ``size`` is not two positive integers within ``shape``.
    """
    height, width = shape
    if size is None:
        return slice(0, height), slice(0, width)
    if len(size) != 2 or not (1 <= size[0] <= height and 1 <= size[1] <= width):
        raise SettingError(
            "size", f"{tuple(size)}", f"(H, W) within {height} × {width}", "photographs are never enlarged"
        )
    rows = min(height, round(width * size[0] / size[1]))
    columns = min(width, round(height * size[1] / size[0]))
    top, left = (height - rows) // 2, (width - columns) // 2
    return slice(top, top + rows), slice(left, left + columns)


def area_average(images: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """``(C, H, W)`` reduced to ``(C, *size)``: each new pixel is the mean over the area it covers."""
    rows, columns = (area_weights(n, m) for n, m in zip(images.shape[1:], size, strict=True))
    return np.ascontiguousarray(rows @ images @ columns.T)


def area_weights(old: int, new: int) -> NDArray[np.float32]:
    """``(new, old)`` shares of the old pixels in each new one; rows sum to 1."""
    edges = np.arange(new + 1) * (old / new)
    starts = np.arange(old)
    overlap = np.minimum(edges[1:, None], starts + 1) - np.maximum(edges[:-1, None], starts)
    return (np.maximum(overlap, 0) * (new / old)).astype(np.float32)


def nearest(image: NDArray[_Value], size: tuple[int, int]) -> NDArray[_Value]:
    """``(H, W)`` sampled at the centres of the new pixels: depths across an edge are never mixed."""
    rows, columns = (((np.arange(m) + 0.5) * n / m).astype(int) for n, m in zip(image.shape, size, strict=True))
    return image[np.ix_(rows, columns)]
