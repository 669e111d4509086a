"""An estimate and its truth as float64 arrays of one shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, check_choice, check_shape

Array = NDArray[np.float64]
Reduction = Literal["mean", "none"]
CUBE = ("B", "L", "H", "W")


def pair(estimate: Any, truth: Any, axes: Sequence[Any] = CUBE, optional: int = 1) -> tuple[Array, Array]:
    """Both with all axes, of which the first ``optional`` may be missing.

    Raises:
        ShapeError: the shapes differ, or are not those of the axes.
    """
    x, y = as_float64(estimate), as_float64(truth)
    check_shape("estimate", x, y.shape, "crop, resample or transpose one of them: metrics never broadcast")
    missing = len(axes) - x.ndim
    if 0 < missing <= optional:
        x, y = (values.reshape((1,) * missing + values.shape) for values in (x, y))
    check_shape("estimate, truth", x, axes)
    return x, y


def as_float64(values: Any) -> Array:
    """A float64 array from a torch tensor, a labelled array or anything numpy reads.

    Labelled arrays are first brought to the order ``(..., wavelength, y, x)``.
    """
    if hasattr(values, "dims") and hasattr(values, "transpose"):
        last = [name for name in ("wavelength", "y", "x") if name in values.dims]
        values = values.transpose(..., *last).values
    elif hasattr(values, "detach"):
        values = values.detach().cpu().double().numpy()
    array = np.asarray(values)
    if np.iscomplexobj(array) or array.dtype.kind not in "fiub":
        raise SettingError("metric", f"values of type {array.dtype}", "real numbers", "pass an intensity")
    return array.astype(np.float64, copy=False)


def reduced(per_image: Array, reduction: Reduction) -> Any:
    """The mean over the batch as a python float, or the array ``(B,)`` itself for ``"none"``."""
    check_choice("reduction", reduction, ("mean", "none"))
    return per_image if reduction == "none" else float(per_image.mean())
