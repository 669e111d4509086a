"""Light that passes a mask where it is closed, from captures of an open and a dark pattern."""

from __future__ import annotations

import numpy as np

from tmca.lab.calibration.arrays import Array


def closed_light(dark: Array, light: Array, lit: np.ndarray) -> tuple[float, float]:
    """Light of the dark pattern over that of the open one: ``1/contrast ratio``, and its standard deviation.

    The share that leaves the least absolute deviations ``|dark - share · light|`` over lit pixels: the median of their
    ratios, weighted by the light. Unlike a mean it stays where hot pixels, or noise cut off at zero, have one side
    only. Stray light that does not pass the mask cannot be told from light that does.

    Args:
        dark, light: (H, W) captures of the dark and the open pattern, linear, without the sensor's own dark.
        lit: (H, W) pixels that count.

    Returns:
        The share, below 0 where there is more noise than light, and its standard deviation from the pixels' scatter.
    """
    seen, whole = dark[lit], light[lit]
    order = np.argsort(seen / whole)
    below = np.cumsum(whole[order])
    middle = order[np.searchsorted(below, below[-1] / 2)]
    share = float(seen[middle] / whole[middle])
    scatter = 1.4826 * float(np.median(np.abs(seen - share * whole)))
    # a median varies by the root of π/2 more than a mean
    return share, float(np.sqrt(np.pi / 2)) * scatter / float(np.sqrt(whole @ whole))
