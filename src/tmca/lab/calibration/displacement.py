"""By how much a registered pattern is displaced in a capture, and how bright it is: by its wavelength (dispersion and
response) and by the view that is open (shear)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.fitting import whole_shift
from tmca.lab.calibration.pattern_image import SAMPLES, moved, seen_patterns
from tmca.lab.calibration.registration import Registration
from tmca.lab.frames import Array
from tmca.optics import Dispersion

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


REGISTERED_AT = "registration_wavelength_m"
"""Setting of a dispersion: wavelength of the registration that it was measured against; null if that was unknown."""
Curve = Literal["cauchy", "polynomial", "measured"]
LARGEST_CURVE_RESIDUAL = 0.25
"""Sensor pixels that a smooth curve may leave, root mean square along x."""


@dataclass(frozen=True)
class MeasuredDispersion:
    """Displacement of light along y and x against the registration, and κ.

    Args:
        wavelengths: (L,) of the captures, metres, ascending.
        shifts: (L, 2) measured, rows and columns, sensor pixels.
        std: (L, 2) of each.
        curve: ``"cauchy"``: powers of 1/λ²; ``"polynomial"``: powers of λ; ``"measured"``: straight lines between what
            was measured.
        coefficients: (order + 1, 2) of the curve; (0, 2) of none.
        residual: (2,) rms of what the curve leaves along y and x, sensor pixels; NaN of one that goes through all.
        response: (L,) light over the source's power, mean 1.
        misfit: (L,) what each capture's own fit leaves, as a share of its light.
    """

    wavelengths: Array
    shifts: Array
    std: Array
    curve: Curve
    coefficients: Array
    residual: Array
    response: Array
    misfit: Array

    def at(self, wavelengths: ArrayLike) -> Array:
        """(n, 2) displacement along y and x of the curve, sensor pixels.

        Raises:
            SettingError: wavelengths (metres) more than a twentieth of the range beyond those measured.
        """
        asked = np.asarray(wavelengths, dtype=np.float64)
        self._check(asked)
        if self.curve == "measured":
            return np.stack([np.interp(asked, self.wavelengths, one) for one in self.shifts.T], axis=1)
        return _terms(asked, self.wavelengths, self.curve, len(self.coefficients) - 1) @ self.coefficients

    def response_at(self, wavelengths: ArrayLike) -> Array:
        """(n,) κ, linear between the wavelengths that were measured.

        Raises:
            SettingError: see ``at``.
        """
        asked = np.asarray(wavelengths, dtype=np.float64)
        self._check(asked)
        return np.interp(asked, self.wavelengths, self.response)

    def dispersion(self, wavelengths: Sequence[float], start: float = 0.0) -> Dispersion:
        """The ``Dispersion`` along x of bands, where the registration's light is displaced by ``start`` pixels."""
        return Dispersion(tuple(start + self.at(wavelengths)[:, 1]))

    def _check(self, asked: Array) -> None:
        low, high = self.wavelengths[0], self.wavelengths[-1]
        slack = 0.05 * (high - low) + 1e-12
        if asked.size and (asked.min() < low - slack or asked.max() > high + slack):
            found = f"bands from {asked.min() * 1e9:g} to {asked.max() * 1e9:g} nm"
            expected = f"those measured, {low * 1e9:g} to {high * 1e9:g} nm"
            raise SettingError("measured dispersion", found, expected, "measure the dispersion over all bands")


def measure_dispersion(
    frames: ArrayLike,
    wavelengths: ArrayLike,
    pattern: ArrayLike,
    registration: Registration,
    *,
    power: ArrayLike | None = None,
    curve: Curve = "cauchy",
    order: int = 3,
    source: object = "dispersion",
) -> MeasuredDispersion:
    """Displacement of every wavelength, and a smooth curve through them by weighted least squares.

    Cauchy: ``d = Σ c_n λ^(-2n)``, as the index of glass goes; polynomial: ``d = Σ c_n λ^n``; measured: no curve, where
    every band was measured and no glass says how they lie.

    Args:
        frames: (L, H, W) linear digital numbers, dark taken off, exposed alike.
        wavelengths: (L,) metres.
        pattern: (h, w) shown in all of them.
        registration: of the mask.
        power: (L,) of the source, any unit; equal without it.
        curve: which one.
        order: of its highest power; one less than the captures at most.
        source: named in errors.

    Raises:
        SettingError: wavelengths, power or order that cannot be.
        DataError: a capture in which the pattern is not seen, or displacements that no smooth curve follows.
    """
    values, metres = np.asarray(frames, dtype=np.float64), np.asarray(wavelengths, dtype=np.float64)
    stated = np.ones(len(metres)) if power is None else np.asarray(power, dtype=np.float64)
    _check_given(values, metres, stated)
    if curve != "measured" and not 0 <= order < len(metres):
        raise SettingError("order", str(order), f"0 to {len(metres) - 1}, one less than the captures")
    by_wave = np.argsort(metres)
    each = [
        displacement_of(values[i], pattern, registration, source=f"{source} ({metres[i] * 1e9:g} nm)") for i in by_wave
    ]
    metres, shifts, std = metres[by_wave], np.stack([one.shift for one in each]), np.stack([one.std for one in each])
    coefficients, residual = _curve(metres, shifts, std, curve, order)
    if residual[1] > LARGEST_CURVE_RESIDUAL:
        what = f"displacements of which a smooth curve leaves {residual[1]:.3g} pixels"
        remedy = "check the wavelengths of the captures; displacements by whole pixels need --curve measured"
        raise DataError(source, what, f"{LARGEST_CURVE_RESIDUAL:g} at most", remedy)
    light = np.array([one.light for one in each]) / stated[by_wave]
    misfit = np.array([one.residual for one in each])
    return MeasuredDispersion(metres, shifts, std, curve, coefficients, residual, light / light.mean(), misfit)


def _check_given(values: Array, metres: Array, power: Array) -> None:
    if values.ndim != 3 or metres.shape != (len(values),) or len(set(metres.tolist())) < len(metres):
        raise SettingError("wavelengths", f"{metres.size} for {len(values)} captures", "a different one for each")
    if not ((metres > 100e-9) & (metres < 100e-6)).all():
        raise SettingError("wavelengths", f"{metres.min():g} to {metres.max():g}", "metres")
    if power.shape != metres.shape or not (np.isfinite(power) & (power > 0)).all():
        raise SettingError("source power", f"{power.tolist()}", "a number above 0 for each wavelength")


def _terms(asked: Array, measured: Array, curve: Curve, order: int) -> Array:
    """(n, order + 1) powers of λ or 1/λ², brought to ±1 over the measured range."""
    variable, ends = (w if curve == "polynomial" else w**-2 for w in (asked, measured[[0, -1]]))
    middle, half = (ends[0] + ends[1]) / 2, max(abs(ends[1] - ends[0]) / 2, 1e-30)
    return np.vander((variable - middle) / half, order + 1, increasing=True)


def _curve(metres: Array, shifts: Array, std: Array, curve: Curve, order: int) -> tuple[Array, Array]:
    """(order + 1, 2) coefficients and (2,) rms of what they leave, NaN where they are as many as the captures."""
    if curve == "measured":
        return np.zeros((0, 2)), np.full(2, np.nan)
    terms = _terms(metres, metres, curve, order)
    coefficients = np.empty((order + 1, 2))
    for axis in (0, 1):
        weight = 1 / np.hypot(std[:, axis], 1e-3)
        coefficients[:, axis] = np.linalg.lstsq(terms * weight[:, None], shifts[:, axis] * weight, rcond=None)[0]
    left = np.sqrt(((shifts - terms @ coefficients) ** 2).mean(axis=0))
    return coefficients, left if order + 1 < len(metres) else np.full(2, np.nan)


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
