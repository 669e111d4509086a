"""Reading an estimate and its truth into two float64 arrays of the same shape."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError, ShapeError

Array = NDArray[np.float64]
Reduction = Literal["mean", "none"]


def cube_pair(estimate: Any, truth: Any) -> tuple[Array, Array]:
    """Both cubes as ``(B, L, H, W)``; accepts ``(L, H, W)`` too.

    Labelled arrays are first brought to the order ``(..., wavelength, y, x)``.

    Raises:
        ShapeError: the shapes differ, or are not those of cubes.
    """
    first, second = as_float64(estimate), as_float64(truth)
    require_same_shape(first, second)
    if first.ndim not in (3, 4) or 0 in first.shape:
        raise ShapeError(
            "estimate, truth",
            f"shape {first.shape}",
            "(B, L, H, W) or (L, H, W), none of them 0",
            "add or select axes until the last three are bands, rows and columns",
        )
    return (first, second) if first.ndim == 4 else (first[None], second[None])


def require_same_shape(estimate: Array, truth: Array) -> None:
    """Raise ShapeError, naming both shapes, unless they agree."""
    if estimate.shape != truth.shape:
        raise ShapeError(
            "estimate",
            f"shape {estimate.shape}",
            f"the truth's {truth.shape}",
            "crop, resample or transpose one of them: metrics never broadcast",
        )


def as_float64(values: Any) -> Array:
    """A float64 array from a torch tensor, a labelled array or anything numpy reads."""
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
    if reduction == "none":
        return per_image
    if reduction == "mean":
        return float(per_image.mean())
    raise SettingError("reduction", repr(reduction), "'mean' or 'none'")
