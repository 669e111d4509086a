"""What the fits of several steps share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.lab.frames import Array


def fit_std(fit: Any, left: Array | None = None) -> Array:
    """(n,) standard deviations of the n numbers of a `scipy.optimize.least_squares`, from its Jacobian.

    Args:
        fit: the result.
        left: residuals that count as noise; all of them without. NaN where there are no more than numbers.
    """
    left = fit.fun if left is None else left
    freedom = left.size - fit.x.size
    variance = float((left**2).sum()) / freedom if freedom > 0 else np.nan
    return np.asarray(np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)) * variance))


def robust_std(values: ArrayLike, axis: tuple[int, ...] | None = None) -> Any:
    """Standard deviation around zero by the median absolute value, which outliers do not move; along axes that stay."""
    return 1.4826 * np.median(np.abs(values), axis=axis, keepdims=axis is not None)


def whole_shift(seen: Array, expected: Array) -> Array:
    """(2,) rows and columns, whole pixels, by which one image is displaced against another, by cross-correlation."""
    from skimage.registration import phase_cross_correlation

    return np.asarray(phase_cross_correlation(seen, expected, normalization=None)[0], dtype=np.float64)
