"""How noisy a single capture is, from itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_DARKEST = 0.2


def dark_noise(capture: NDArray[np.floating]) -> float:
    """Standard deviation of the noise where a capture (H, W) is darkest, in the capture's numbers.

    Differences of neighbours along x over the darkest fifth of all pixels, by their median absolute value (1.4826 of it
    is the standard deviation of a normal distribution); slow light cancels, the noise does so by √2.
    """
    from scipy.ndimage import uniform_filter

    values = np.asarray(capture, dtype=np.float64)
    level = uniform_filter(values, 9)
    dark = (level <= np.quantile(level, _DARKEST))[:, 1:]
    steps = np.abs(np.diff(values, axis=1))[dark]
    return float(1.4826 * np.median(steps) / np.sqrt(2))
