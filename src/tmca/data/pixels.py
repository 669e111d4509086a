"""Pixels: the curve of sRGB (IEC 61966-2-1), windows and smaller pictures, values that cannot be used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError


def decoded(stored: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear values in [0, 1] of sRGB values in [0, 1], any shape."""
    curved = ((np.maximum(stored, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(stored <= 0.04045, stored / 12.92, curved).astype(np.float32)


def encoded(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """sRGB values in [0, 1] of linear values in [0, 1], any shape."""
    curved = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curved).astype(np.float32)


_Value = TypeVar("_Value", bound=np.generic)


def refuse_pixels(
    values: NDArray[Any], bad: NDArray[np.bool_], where: object, kind: str, axes: Sequence[str], remedy: str
) -> None:
    """Raises DataError where any pixel is bad, with their number and the place of the first, counted from 0.

    Args:
        values: any shape.
        bad: of the same shape.
        where: the file.
        kind: what they are.
        axes: names of the leading axes.
        remedy: what can be done.
    """
    count = int(np.count_nonzero(bad))
    if count:
        place = np.unravel_index(int(bad.argmax()), bad.shape)
        first = ", ".join(f"{axis} {index}" for axis, index in zip(axes, place, strict=False))
        found = f"{count} {kind} pixel{'s' if count > 1 else ''}, the first at {first} ({values[place]:g})"
        raise DataError(where, found, "finite values from 0 up", remedy)


def refuse_not_finite(values: NDArray[Any], where: object, axes: Sequence[str]) -> None:
    """Raises DataError where values are NaN or infinite; arguments as in `refuse_pixels`."""
    for kind, bad in (("NaN", np.isnan), ("infinite", np.isinf)):
        refuse_pixels(values, bad(values), where, kind, axes, "mask or repair them first")


def wrong_size(where: object, what: str, size: Sequence[int], expected: Sequence[int], other: str) -> DataError:
    """The error for ``what`` of (H, W) pixels that is not as large as another picture."""
    found, wanted = (f"{height}×{width}" for height, width in (size, expected))
    remedy = "crop or replace one of them"
    return DataError(where, f"{what} of {found} pixels", f"{wanted} (height × width) as {other}", remedy)


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
    (height, width), channels = images.shape[1:], len(images)
    if height % size[0] == 0 and width % size[1] == 0:
        blocks = images.reshape(channels, size[0], height // size[0], size[1], width // size[1])
        return np.asarray(blocks.mean(axis=(2, 4), dtype=np.float32), dtype=np.float32)
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
