"""Depth maps of the rendered scenes: measured by stereo for one, staged for the others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tmca.data.depth_maps import disparity_to_depth
from tmca.data.formats.calibration import MOTORCYCLE


def motorcycle_depth() -> NDArray[np.float32]:
    """Measured depth ``(500, 741)`` in metres, ``Z = f B / (d + Δcx)``; unknown disparities give ``nan``.

    Source: Middlebury Stereo 2014 (Scharstein et al.), calibration as given with scikit-image's copy.
    """
    import skimage.data

    return disparity_to_depth(skimage.data.stereo_motorcycle()[2], *MOTORCYCLE[:3]).astype(np.float32)


def staged_depth(
    rgb: NDArray[np.float32], labels: NDArray[np.intp], near: float, far: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """A plausible depth map ``(H, W)`` in metres from ``near`` to ``far``.

    Each region is a tilted plane, the lower in the picture the nearer, at its own distance, with a faint
    relief that follows the brightness. It is drawn, not measured: it has the edges and slopes of real depth,
    but tells nothing about the place that was photographed.

    Args:
        rgb: ``(H, W, 3)``.
        labels: ``(H, W)``, coarse regions numbered from 0.
        near, far: the range of depth in metres; both are reached.
        rng: draws distances and tilts.
    """
    from scipy.ndimage import gaussian_filter

    height, width = labels.shape
    rows, columns = (axis / size for axis, size in zip(np.mgrid[:height, :width], (height, width), strict=True))
    count = int(labels.max()) + 1
    area = np.bincount(labels.ravel(), minlength=count)
    row, column = (np.bincount(labels.ravel(), axis.ravel(), count) / area for axis in (rows, columns))
    level = 0.5 * row + 0.2 * rng.random(count)
    tilt = rng.normal((0.35, 0.0), (0.15, 0.15), size=(count, 2))
    relief = gaussian_filter(rgb.mean(axis=-1), 2)
    nearness = level[labels] + 0.1 * (relief - relief.mean())
    nearness += tilt[labels, 0] * (rows - row[labels]) + tilt[labels, 1] * (columns - column[labels])
    nearness = (nearness - nearness.min()) / np.ptp(nearness)
    inverse = 1 / far + nearness * (1 / near - 1 / far)
    return (1 / inverse).astype(np.float32)
