"""By how much a registered pattern is displaced in a capture, and how bright it is: for dispersion and view shear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.fitting import whole_shift
from tmca.lab.calibration.pattern_image import SAMPLES, moved, seen_patterns
from tmca.lab.calibration.registration import Registration
from tmca.lab.frames import Array

LARGEST_RESIDUAL = 0.2
_LEVELS = ((1.5, 1), (1.0, SAMPLES))
"""Blur through which the fit looks, sensor pixels, and parts of a pixel. A blur that is no Gaussian, such as one
between two pixels, displaces fine structure by less than its centre: through the last one little of that is seen."""
_LEAST_BLUR = 0.3
_MARGIN = 3
_BLUR = 2.0


@dataclass(frozen=True)
class Displacement:
    """Of one capture.

    Args:
        shift: (2,) rows and columns against the registration, sensor pixels.
        std: (2,) from the noise, sensor pixels.
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
    """Fit the shift of a pattern, with a blur of its own, under smooth light: a polynomial of second order.

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
    place = np.array([*_coarse(values, shown, registration), max(registration.blur, _LEAST_BLUR)])
    for level, samples in _LEVELS:
        where = _inside(shown, registration, place)
        fit = _fitted(values, shown, registration, place, level, samples, where)
        place = np.asarray(fit.x)
    light, residual = _light(values, shown, registration, place)
    if not light > 0 or residual > LARGEST_RESIDUAL:
        what = f"a pattern that is not seen (a fit leaves {min(residual, 1):.0%} of its light or more)"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", "check the light and which pattern was shown")
    return Displacement(place[:2], _std(fit, _LEVELS[-1][0], where), light, residual)


def _coarse(values: Array, shown: Array, registration: Registration) -> Array:
    """Whole pixels, by cross-correlation of blurred images without their means."""
    from scipy.ndimage import gaussian_filter

    seen = seen_patterns(shown[None], registration.matrix, registration.sensor, samples=1)[0]
    captured, predicted = (
        gaussian_filter(image, _BLUR) - gaussian_filter(image, 6 * _BLUR) for image in (values, seen)
    )
    return whole_shift(captured, predicted)


def _inside(shown: Array, registration: Registration, place: Array) -> np.ndarray:
    """(H, W) pixels well inside mask and sensor, all of a small one: how light ends at the mask's edge is not known."""
    from scipy.ndimage import binary_erosion

    whole = _seen(np.ones_like(shown), registration, np.array([*place[:2], 0.0]), 1) > 0.99
    inner = np.asarray(binary_erosion(whole, iterations=_MARGIN))
    return inner if inner.sum() > whole.sum() / 5 else np.ones_like(inner)


def _fitted(
    values: Array, shown: Array, registration: Registration, start: Array, level: float, samples: int, where: np.ndarray
) -> Any:
    """Least squares over shift and blur (rows, columns, pixels), frame and model seen through a blur of ``level``."""
    from scipy.optimize import least_squares

    def residuals(place: Array) -> Array:
        return _projected(values, _seen(shown, registration, place, samples), level, where)[0]

    return least_squares(residuals, start, xtol=1e-7, ftol=1e-7, max_nfev=20)


def _seen(shown: Array, registration: Registration, place: Array, samples: int = SAMPLES) -> Array:
    """The pattern displaced and blurred by ``place``."""
    matrix = moved(registration.matrix, place[:2])
    return seen_patterns(shown[None], matrix, registration.sensor, abs(float(place[2])), samples)[0]


def _projected(values: Array, seen: Array, level: float = 0.0, where: np.ndarray | None = None) -> tuple[Array, Array]:
    """What smooth light through the pattern, and an offset, leave of a frame, both blurred by ``level``, at some
    pixels; the light (H, W)."""
    from scipy.ndimage import gaussian_filter

    rows, columns = (np.linspace(-1, 1, n) for n in values.shape)
    y, x = np.broadcast_arrays(rows[:, None], columns)
    smooth = np.stack([np.ones_like(y), y, x, y * y, y * x, x * x])
    planes = np.concatenate([smooth * seen, np.ones((1, *values.shape)), values[None]])
    blurred = gaussian_filter(planes, (0, level, level)) if level else planes
    *parts, target = blurred.reshape(8, -1) if where is None else blurred[:, where]
    terms = np.stack(parts, axis=1)
    coefficients = np.linalg.solve(terms.T @ terms + 1e-9 * np.eye(7), terms.T @ target)
    return target - terms @ coefficients, np.tensordot(coefficients[:6], smooth, 1)


def _light(values: Array, shown: Array, registration: Registration, place: Array) -> tuple[float, float]:
    """Mean light over the mask's area, and the residual as a share of it."""
    left, light = _projected(values, _seen(shown, registration, place))
    inside = _seen(np.ones_like(shown), registration, np.array([*place[:2], 0.0]), 1) > 0.5
    if not inside.any():
        return 0.0, np.inf
    mean = float(light[inside].mean())
    return mean, float(np.sqrt((left**2).mean())) / max(mean, 1e-12)


def _std(fit: Any, level: float, where: np.ndarray) -> Array:
    """(2,) of the shift, by independent noise of pixels, of which the blur left neighbours alike."""
    from scipy.ndimage import gaussian_filter

    freedom = max(1, fit.fun.size - 10)
    noise = float((fit.fun**2).sum()) / freedom * 4 * np.pi * level**2
    slopes = np.zeros((fit.jac.shape[1], *where.shape))
    slopes[:, where] = fit.jac.T
    seen = gaussian_filter(slopes, (0, level, level)).reshape(len(slopes), -1)
    back = np.linalg.pinv(fit.jac.T @ fit.jac)
    return np.asarray(np.sqrt(np.diag(back @ (seen @ seen.T) @ back)[:2] * noise))


LARGEST_SHEAR_RESIDUAL = 0.25
"""Sensor pixels that a linear fit may leave, root mean square."""


@dataclass(frozen=True)
class MeasuredShear:
    """The ray from sensor pixel m to view ℓ crosses the mask where ``m + step · ℓ`` lies under the registration.

    Args:
        places: (n, 2) views ℓ = (v, u) that were open, in view steps from the middle.
        shifts: (n, 2) of the mask's shadow, rows and columns, sensor pixels.
        step: (2,) sensor pixels per view along y and x: the shadow of view ℓ is shifted by ``-step · ℓ``.
        std: (2,) of the step.
        cross: (2,) shift along y per view along x, and along x per view along y: an aperture that is turned.
        residual: rms of what the fit leaves, sensor pixels.
        light: (n,) of each view over that of the brightest.
    """

    places: Array
    shifts: Array
    step: Array
    std: Array
    cross: Array
    residual: float
    light: Array

    def vignetting(self, views: tuple[int, int]) -> Array:
        """(V, U) light of every view, ones where a view was not captured."""
        light = np.ones(views)
        for (v, u), share in zip(self.places, self.light, strict=True):
            row, column = int(v) + views[0] // 2, int(u) + views[1] // 2
            if 0 <= row < views[0] and 0 <= column < views[1]:
                light[row, column] = share
        return light


def measure_shear(
    frames: ArrayLike,
    places: Sequence[tuple[int, int]],
    pattern: ArrayLike,
    registration: Registration,
    *,
    source: object = "shear",
) -> MeasuredShear:
    """Linear fit of the shadow's shifts over the views.

    Args:
        frames: (n, H, W) linear digital numbers, dark taken off, each with one view open.
        places: (v, u) of the view of each, in view steps from the middle.
        pattern: (h, w) on the mask.
        registration: of the mask at the middle view.
        source: named in errors.

    Raises:
        SettingError: fewer than two views along an axis.
        DataError: a capture in which the pattern is not seen, or shifts that are not linear.
    """
    values, views = np.asarray(frames, dtype=np.float64), np.asarray(places, dtype=np.float64)
    if views.shape != (len(values), 2) or any(len(set(views[:, axis])) < 2 for axis in (0, 1)):
        raise SettingError("views", f"{views.tolist()}", "(v, u) of every capture, two or more along each axis")
    each = [
        displacement_of(frame, pattern, registration, source=f"{source} (view {v:g}, {u:g})")
        for frame, (v, u) in zip(values, views, strict=True)
    ]
    shifts = np.stack([one.shift for one in each])
    terms = np.column_stack([np.ones(len(views)), views])
    coefficients = np.linalg.lstsq(terms, shifts, rcond=None)[0]
    left = shifts - terms @ coefficients
    residual = float(np.sqrt((left**2).mean()))
    if residual > LARGEST_SHEAR_RESIDUAL:
        what = f"shifts of which a linear fit leaves {residual:.3g} pixels"
        raise DataError(source, what, f"{LARGEST_SHEAR_RESIDUAL:g} at most", "check which view each capture had open")
    step, cross = -np.diag(coefficients[1:]), -np.array([coefficients[2, 0], coefficients[1, 1]])
    std = np.sqrt(np.diag(np.linalg.pinv(terms.T @ terms))[1:] * (left**2).sum(axis=0) / max(1, len(views) - 3))
    light = np.array([one.light for one in each])
    return MeasuredShear(views, shifts, step, std, cross, residual, light / light.max())
