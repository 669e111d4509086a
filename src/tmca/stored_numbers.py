"""Numbers in files: real ones, finite in the single precision in which most is computed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tmca.attributes import REMEDY
from tmca.errors import DataError


def finite_numbers(
    stored: NDArray[Any], where: object, name: str, dtype: DTypeLike = np.float32, remedy: str = REMEDY
) -> NDArray[Any]:
    """A copy of an array of a file, in a type; see `check_finite`."""
    check_finite(stored, where, name, remedy)
    return np.array(stored, dtype=dtype)


def check_finite(stored: NDArray[Any], where: object, name: str, remedy: str = REMEDY) -> None:
    """Raise DataError unless an array holds real numbers that are finite in single precision, whatever its own is.

    Args:
        stored: as a library reads it.
        where: the file, for the message.
        name: of the array, such as ``variable mean``.
        remedy: what to do about it.
    """
    if stored.dtype.kind not in "buif":
        raise DataError(where, f"{name} of type {stored.dtype}", "real numbers", remedy)
    with np.errstate(over="ignore"):
        finite = np.isfinite(stored.astype(np.float32, copy=False)).all()
    if not finite:
        raise DataError(where, f"{name} with values that are not finite in single precision", "finite numbers", remedy)
