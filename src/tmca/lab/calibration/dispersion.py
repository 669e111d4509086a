"""Dispersion curve and sensor response from captures of a known pattern under monochromatic light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.displacement import displacement_of
from tmca.lab.calibration.registration import Registration
from tmca.lab.frames import Array
from tmca.optics import Dispersion

REGISTERED_AT = "registration_wavelength_m"
"""Setting of a dispersion: wavelength of the registration that it was measured against; null if that was unknown."""
Curve = Literal["cauchy", "polynomial", "measured"]
LARGEST_RESIDUAL = 0.25
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
    if residual[1] > LARGEST_RESIDUAL:
        what = f"displacements of which a smooth curve leaves {residual[1]:.3g} pixels"
        remedy = "check the wavelengths of the captures; displacements by whole pixels need --curve measured"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:g} at most", remedy)
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
