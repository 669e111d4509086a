"""Arrays as arguments: a tensor, or what becomes one."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import torch
from pydantic import BeforeValidator
from torch import Tensor


def as_tensor(values: Any) -> Tensor:
    """A tensor as it is; arrays and nested lists of numbers as one, real numbers in the default precision.

    Raises:
        ValueError: no numbers, or rows of unequal length.
    """
    if isinstance(values, Tensor):
        return values
    try:
        array = np.array(values)
    except ValueError:
        raise ValueError("rows of equal length") from None
    if array.dtype.kind not in "buif" or not array.ndim:
        raise ValueError("an array of numbers")
    tensor = torch.from_numpy(array)
    return tensor.to(torch.get_default_dtype()) if tensor.is_floating_point() else tensor


Array = Annotated[Tensor, BeforeValidator(as_tensor), "an array of numbers"]
"""A tensor, of an array or nested lists too."""
