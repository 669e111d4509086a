"""Dispersion curve and sensor response from captures of a known pattern under monochromatic light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.displacement import displacement_of
from tmca.lab.calibration.measurements.limits import beyond
from tmca.lab.calibration.measurements.registration import Registration
from tmca.optics import Dispersion

Curve = Literal["cauchy", "polynomial", "measured"]
LARGEST_RESIDUAL = 0.25
"""Sensor pixels that a smooth curve may leave, root mean square along x."""
_POLYNOMIAL = "check the wavelengths of the captures; a disperser that is neither needs --curve polynomial"
_NO_GLASS = f"{_POLYNOMIAL} or measured"
_BACK = 0.1
"""Sensor pixels by which neighbouring wavelengths may seem to turn back: each may be off by 0.04, beside its noise."""
_RED = 1.5
"""Times by which red light may be displaced further than blue over the same range, beside ``LARGEST_RESIDUAL``: a
grating displaces both alike, and glass blue more than twice as far."""
_BENT = 0.1
"""Share of the way between two wavelengths by which glass may be off a straight line."""


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

    def off_reference(self, wavelength: float) -> float | None:
        """Pixels along x by which light of the registration's wavelength (metres) is displaced, which ought to be 0.

        None where that is no more than a curve may leave, with a tenth of the way between the wavelengths beside it,
        on which the displacement is no straight line; or where it is beyond those that were measured.
        """
        waves, along = self.wavelengths, self.shifts[:, 1]
        if not waves[0] <= wavelength <= waves[-1]:
            return None
        above = min(int(np.searchsorted(waves, wavelength)), len(waves) - 1)
        off = float(np.interp(wavelength, waves, along))
        between = 0.0 if np.isclose(waves, wavelength).any() else abs(along[above] - along[above - 1])
        return off if abs(off) > LARGEST_RESIDUAL + _BENT * between else None

    def red_and_blue(self) -> tuple[float, float] | None:
        """Pixels along x by which the red and the blue half of the range are displaced, where red is spread wider."""
        red, blue = _halves(self.wavelengths, self.shifts[:, 1])
        return (red, blue) if _wider(red, blue) else None

    def _check(self, asked: Array) -> None:
        low, high = self.wavelengths[0], self.wavelengths[-1]
        slack = 0.05 * (high - low) + 1e-12
        if asked.size and (asked.min() < low - slack or asked.max() > high + slack):
            found = f"bands from {asked.min() * 1e9:g} to {asked.max() * 1e9:g} nm"
            known = f"those measured, {low * 1e9:g} to {high * 1e9:g} nm"
            raise SettingError("measured dispersion", found, known, "measure the dispersion over all bands")


def measure_dispersion(
    frames: ArrayLike,
    wavelengths: ArrayLike,
    pattern: ArrayLike,
    registration: Registration,
    *,
    power: ArrayLike | None = None,
    curve: Curve = "cauchy",
    order: int = 3,
    red_wider: bool = False,
    names: Sequence[str] | None = None,
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
        red_wider: whether the camera is known to spread red light wider than blue, as no glass or grating does.
        names: of the frames, for errors.
        source: named in errors.

    Raises:
        SettingError: wavelengths, power or order that cannot be.
        DataError: a capture in which the pattern is not seen, displacements that no smooth curve follows, that turn
            back (but for a polynomial), or, for Cauchy's curve, that grow towards the red, as neither glass nor
            gratings have them.
    """
    values, metres = np.asarray(frames, dtype=np.float64), np.asarray(wavelengths, dtype=np.float64)
    stated = np.ones(len(metres)) if power is None else np.asarray(power, dtype=np.float64)
    _check_given(values, metres, stated)
    if curve != "measured" and not 0 <= order < len(metres):
        raise SettingError("order", str(order), f"0 to {len(metres) - 1}, one less than the captures")
    by_wave = np.argsort(metres)
    said = [names[i] if names is not None else f"{metres[i] * 1e9:g} nm" for i in by_wave]
    each = [
        displacement_of(values[i], pattern, registration, source=f"{source} ({name})")
        for i, name in zip(by_wave, said, strict=True)
    ]
    metres, shifts, std = metres[by_wave], np.stack([one.shift for one in each]), np.stack([one.std for one in each])
    coefficients, residual = _curve(metres, shifts, std, curve, order)
    if residual[1] > LARGEST_RESIDUAL:
        what = f"displacements of which a smooth curve leaves {beyond(residual[1], 'pixels')}"
        remedy = "check the wavelengths of the captures; displacements by whole pixels need --curve measured"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:g} at most", remedy)
    # that a polynomial leaves little of many captures says that it may bend; one through all of them says nothing
    if curve != "polynomial" or not np.isfinite(residual[1]):
        _check_direction(shifts[:, 1], std[:, 1], said, source)
    if curve == "cauchy" and not red_wider:
        _check_blue(metres, shifts[:, 1], source)
    light = np.array([one.light for one in each]) / stated[by_wave]
    misfit = np.array([one.residual for one in each])
    return MeasuredDispersion(metres, shifts, std, curve, coefficients, residual, light / light.mean(), misfit)


def _check_direction(along: Array, std: Array, names: Sequence[str], source: object) -> None:
    """Raises DataError where displacements turn back: prisms and gratings displace one way, and no curve would tell."""
    steps, noise = np.diff(along), np.hypot(std[1:], std[:-1])
    back = np.minimum(steps * (-1 if steps.sum() < 0 else 1) + 4 * noise, 0.0)
    worst = int(np.argmin(back)) if len(steps) else 0
    if len(steps) and back[worst] < -_BACK:
        what = f"displacements that turn back by {beyond(abs(steps[worst]), 'pixels')} from {names[worst]} to "
        raise DataError(source, what + names[worst + 1], f"{_BACK:g} at most", _POLYNOMIAL)


def _check_blue(metres: Array, along: Array, source: object) -> None:
    """Raises DataError where the red half of the range is displaced further than the blue one: names run backwards."""
    red, blue = _halves(metres, along)
    if _wider(red, blue):
        what = f"red light displaced by {red:.2f} pixels where blue is by {blue:.2f}, over as many nanometres"
        raise DataError(source, what, "no more than blue, as by glass or gratings", _NO_GLASS)


def spreads_red_wider(wavelengths: ArrayLike, displacement: ArrayLike) -> bool:
    """Whether a camera as drawn spreads the red half of its range wider than the blue one.

    Args:
        wavelengths: (L,) of its bands, metres.
        displacement: (L,) of them along x, pixels.
    """
    waves, along = np.asarray(wavelengths, dtype=np.float64), np.asarray(displacement, dtype=np.float64)
    by_wave = np.argsort(waves)
    return _wider(*_halves(waves[by_wave], along[by_wave]))


def _halves(metres: Array, along: Array) -> tuple[float, float]:
    """Displacement over the red and over the blue half of the range, pixels."""
    low, middle, high = np.interp([metres[0], metres[[0, -1]].mean(), metres[-1]], metres, along)
    return float(abs(high - middle)), float(abs(middle - low))


def _wider(red: float, blue: float) -> bool:
    return red > _RED * blue + LARGEST_RESIDUAL


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
    found = np.empty((order + 1, 2))
    for axis in (0, 1):
        weight = 1 / np.hypot(std[:, axis], 1e-3)
        found[:, axis] = np.linalg.lstsq(terms * weight[:, None], shifts[:, axis] * weight, rcond=None)[0]
    left = np.sqrt(((shifts - terms @ found) ** 2).mean(axis=0))
    return found, left if order + 1 < len(metres) else np.full(2, np.nan)
