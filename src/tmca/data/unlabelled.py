"""Arrays without labels as cubes and light fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.cubes import label
from tmca.data.in_memory import even_bands
from tmca.data.light_fields import label_light_field
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr


def of_array(values: Any, where: str = "scene") -> xr.DataArray:
    """A cube (L, H, W), or a light field (V, U, H, W) or with three colours first, of an array without labels.

    An axis of one in front is the batch. Bands are taken as evenly spaced, 400 to 700 nm, which is said.

    Raises:
        DataError, ShapeError: an array of other axes.
    """
    array = np.asarray(values.numpy(force=True) if hasattr(values, "numpy") else values)
    array = array[0] if array.ndim > 3 and len(array) == 1 else array
    if array.ndim == 3:
        return label(array, even_bands(len(array), where))
    if array.ndim not in (4, 5):
        expected = "(L, H, W) of a cube, or (V, U, H, W) of a light field"
        raise DataError(where, f"an array of shape {array.shape}", expected, "label it with tmca.data.label")
    return label_light_field(array)
