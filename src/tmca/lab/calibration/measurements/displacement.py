"""By how much a registered pattern is displaced in a capture, and how bright it is: for dispersion and view shear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, ShapeError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.pattern_image import SAMPLES, moved, seen_patterns
from tmca.lab.calibration.measurements.registration import Registration

LARGEST_RESIDUAL = 0.2
_LEVELS = (1.5, 0.0)
_BLUR = 2.0


@dataclass(frozen=True)
class Displacement:
    """Of one capture.

    Args:
        shift: (2,) rows and columns against the registration, sensor pixels.
        std: (2,) from the fit, sensor pixels.
        light: mean light of open mask pixels above the dark, units of the frame.
        residual: rms of what the fit leaves, as a share of ``light``.
    """

    shift: Array
    std: Array
    light: float
    residual: float


def displacement_of(
    frame: ArrayLike, pattern: ArrayLike, registration: Registration, *, source: object = "capture"
) -> Displacement:
    """Fit the shift of a pattern under smooth light, which falls off by a polynomial of second order over the frame.

    Args:
        frame: (H, W) linear digital numbers, dark taken off.
        pattern: (h, w) of zeros and ones that was shown.
        registration: of the mask, at its reference.
        source: named in errors.

    Raises:
        ShapeError: a pattern or frame of another size than those registered.
        DataError: the pattern is not seen, or the fit leaves more than a fifth of the light.
    """
    values, shown = np.asarray(frame, dtype=np.float64), np.asarray(pattern, dtype=np.float64)
    for name, shape, size in (
        ("pattern", shown.shape, registration.codes),
        ("frame", values.shape, registration.sensor),
    ):
        if shape != tuple(size):
            raise ShapeError(f"{source}", f"a {name} of shape {shape}", f"{tuple(size)} as registered")
    if not np.ptp(values) > 0:
        raise DataError(source, "a frame without light", "a pattern", "capture it again")
    shift, found = _coarse(values, shown, registration), None
    for level in _LEVELS:
        shift, found = _fitted(values, shown, registration, shift, level)
    light, residual = _light(values, shown, registration, shift)
    if not light > 0 or residual > LARGEST_RESIDUAL:
        what = f"a pattern that is not seen (a fit leaves {min(residual, 1):.0%} of its light or more)"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", "check the light and which pattern was shown")
    return Displacement(shift, _std(found), light, residual)


def _coarse(values: Array, shown: Array, registration: Registration) -> Array:
    """Whole pixels, by cross-correlation of blurred images without their means."""
    from scipy.ndimage import gaussian_filter
    from skimage.registration import phase_cross_correlation

    seen = seen_patterns(shown[None], registration.matrix, registration.sensor, samples=1)[0]
    own, other = (gaussian_filter(image, _BLUR) - gaussian_filter(image, 6 * _BLUR) for image in (values, seen))
    return np.asarray(phase_cross_correlation(own, other, normalization=None)[0], dtype=np.float64)


def _fitted(values: Array, shown: Array, registration: Registration, start: Array, level: float) -> tuple[Array, Any]:
    from scipy.ndimage import gaussian_filter
    from scipy.optimize import least_squares

    blur = float(np.hypot(level, registration.blur))
    target = gaussian_filter(values, level) if level else values
    samples = 1 if level else SAMPLES

    def residuals(shift: Array) -> Array:
        return _projected(target, _seen(shown, registration, shift, blur, samples))[0]

    found = least_squares(residuals, start, xtol=1e-7, ftol=1e-7, max_nfev=20)
    return np.asarray(found.x), found


def _seen(shown: Array, registration: Registration, shift: Array, blur: float, samples: int = SAMPLES) -> Array:
    return seen_patterns(shown[None], moved(registration.matrix, shift), registration.sensor, blur, samples)[0]


def _projected(values: Array, seen: Array) -> tuple[Array, Array, Array]:
    """What smooth light through the pattern, and an offset, leave of a frame; the light; its terms."""
    rows, columns = (np.linspace(-1, 1, n) for n in values.shape)
    y, x = np.broadcast_arrays(rows[:, None], columns)
    smooth = np.stack([np.ones_like(y), y, x, y * y, y * x, x * x])
    terms = np.concatenate([smooth * seen, np.ones((1, *values.shape))]).reshape(7, -1).T
    found = np.linalg.solve(terms.T @ terms + 1e-9 * np.eye(7), terms.T @ values.ravel())
    return values.ravel() - terms @ found, np.tensordot(found[:6], smooth, 1), found


def _light(values: Array, shown: Array, registration: Registration, shift: Array) -> tuple[float, float]:
    """Mean light over the mask's area, and the residual as a share of it."""
    seen = _seen(shown, registration, shift, registration.blur)
    left, light, _ = _projected(values, seen)
    inside = _seen(np.ones_like(shown), registration, shift, 0.0, 1) > 0.5
    if not inside.any():
        return 0.0, np.inf
    mean = float(light[inside].mean())
    return mean, float(np.sqrt((left**2).mean())) / max(mean, 1e-12)


def _std(found: Any) -> Array:
    freedom = max(1, found.fun.size - 9)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * float((found.fun**2).sum()) / freedom
    return np.asarray(np.sqrt(np.diag(covariance)))
