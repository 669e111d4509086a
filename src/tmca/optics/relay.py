"""Point spread of the relay optics between mask and sensor."""

from __future__ import annotations

from math import inf
from numbers import Real

import torch
from torch import Tensor

from tmca.errors import SettingError


def gaussian_spread(sigma: float | list[float], bands: int, radius: int | None = None) -> Tensor:
    """Gaussian blur of unit energy, one per band.

    Args:
        sigma: standard deviation in pixels, one value or one per band; 0 is a perfect relay.
        bands: number of bands L.
        radius: half width of the kernel, pixels; 3 standard deviations if None.

    Returns:
        (L, 2·radius+1, 2·radius+1).

    Raises:
        SettingError: negative sigma or a wrong number of them.
    """
    try:
        sigmas = [float(sigma)] * bands if isinstance(sigma, Real) else [float(s) for s in sigma]  # type: ignore[union-attr]
    except (TypeError, ValueError):
        sigmas = []
    if len(sigmas) != bands or not all(0 <= s < inf for s in sigmas):
        raise SettingError("relay blur", str(sigma), f"one or {bands} standard deviations ≥ 0, in pixels")
    reach = radius if radius is not None else max(1, round(3 * max(sigmas)))
    axis = torch.arange(-reach, reach + 1, dtype=torch.float64)
    kernels = []
    for s in sigmas:
        line = torch.exp(-(axis**2) / (2 * s**2)) if s > 0 else (axis == 0).double()
        square = torch.outer(line, line)
        kernels.append(square / square.sum())
    return torch.stack(kernels).to(torch.get_default_dtype())
