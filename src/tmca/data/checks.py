"""Pixels that are no irradiance, and the divisor that turns counts into relative irradiance."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.known import find_known
from tmca.data.formats.stored import Stored
from tmca.errors import DataError, SettingError

Negative = Literal["error", "clip", "keep"]
MAXIMUM = "maximum"
"""Where the divisor of floats above 1 comes from, if nothing else is known."""


def check_pixels(cube: NDArray[np.float32], where: object, negative: Negative = "error") -> None:
    """Refuse a cube with NaN, infinite or negative pixels; with ``negative="clip"`` set the negative ones to
    0.

    Args:
        cube: ``(L, H, W)``, changed in place when clipping.
        where: the file, for the message.
        negative: ``"error"``, ``"clip"``, or ``"keep"`` (reconstructions may have negative pixels).

    Raises:
        DataError: with how many there are and the first position, counted from 0.
        SettingError: an unknown ``negative``.
    """
    if negative not in ("error", "clip", "keep"):
        raise SettingError("negative", repr(negative), "'error', 'clip' or 'keep'")
    for name, bad in (("NaN", np.isnan), ("infinite", np.isinf)):
        _refuse(cube, bad(cube), where, name, "mask or repair them first")
    if negative == "error":
        _refuse(
            cube,
            cube < 0,
            where,
            "negative",
            'set them to 0 in the file, or read it with negative="clip" (--negative clip)',
        )
    elif negative == "clip":
        np.maximum(cube, 0, out=cube)


def _refuse(cube: NDArray[np.float32], bad: NDArray[np.bool_], where: object, name: str, remedy: str) -> None:
    count = int(np.count_nonzero(bad))
    if count:
        band, y, x = (int(i) for i in np.unravel_index(int(bad.argmax()), bad.shape))
        first = f"band {band}, y {y}, x {x} ({cube[band, y, x]:g})"
        found = f"{count} {name} pixel{'s' if count > 1 else ''}, the first at {first}"
        raise DataError(where, found, "finite values from 0 up", remedy)


def divisor(stored: Stored, axis: int, scale: float | None, bands: NDArray[Any] | None) -> tuple[float, str]:
    """What the stored values are divided by to become relative irradiance, and where that comes from.

    ``scale`` if given; what the file states; a known set's full scale (ICVL's 12 bits); an integer type's
    maximum; for floats the maximum of the whole cube if it is above 1, else 1.

    Args:
        stored: the array in its file.
        axis: its spectral axis.
        scale: the user's divisor, or None.
        bands: the float pixels if they are all loaded already, else None and they are read band by band.

    Raises:
        SettingError: a ``scale`` that is not a positive number.
    """
    if scale is not None:
        if not np.isfinite(scale) or scale <= 0:
            raise SettingError("scale", repr(scale), "a number above 0")
        return float(scale), "argument"
    if stored.full_scale is not None:
        return stored.full_scale, "file"
    known = find_known(stored.name, stored.shape[axis])
    top = None
    if known is not None and known.full_scale is not None:
        top = _maximum(stored, axis, bands)
        if 1 < top <= known.full_scale:
            return known.full_scale, known.label
    if stored.dtype.kind in "iu":
        return float(np.iinfo(stored.dtype).max), "integer type"
    if stored.dtype.kind == "b":
        return 1.0, "file"
    top = _maximum(stored, axis, bands) if top is None else top
    return (top, MAXIMUM) if top > 1 else (1.0, "file")


def _maximum(stored: Stored, axis: int, bands: NDArray[Any] | None) -> float:
    """The largest finite value of the whole array, read band by band unless it is in memory."""
    if bands is not None:
        return _finite_maximum(bands)
    return max(_finite_maximum(stored.plane(axis, i)) for i in range(stored.shape[axis]))


def _finite_maximum(values: NDArray[Any]) -> float:
    values = values.astype(np.float32, copy=False)
    top = float(values.max())
    if np.isfinite(top):
        return top
    return float(np.max(values, initial=0.0, where=np.isfinite(values)))
