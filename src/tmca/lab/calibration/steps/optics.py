"""The steps between mask and sensor: registration, dispersion, shear and timing, from captures to parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tmca.data import metres_to_nm, nm_to_metres
from tmca.errors import DataError
from tmca.lab.calibration import captures
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.captures import averaged, corrected, in_order, named, read_captures
from tmca.lab.calibration.measurements.dark_flat import ROUNDING, DarkField
from tmca.lab.calibration.measurements.dispersion import Curve, MeasuredDispersion, measure_dispersion
from tmca.lab.calibration.measurements.registration import Registration, register
from tmca.lab.calibration.measurements.shear import measure_shear
from tmca.lab.calibration.measurements.timing import measure_timing
from tmca.lab.calibration.stated import REGISTERED_AT
from tmca.lab.calibration.steps.building_on import needed, read_patterns, sensor_size, shown_pattern
from tmca.lab.frames import Frames


def registration_step(
    calibration: Calibration,
    path: str | Path,
    patterns: str | Path,
    *,
    wavelength: float | None = None,
    scale: float = 1.0,
    device: tuple[int, int] | None = None,
    saturation: float | None = None,
) -> Calibration:
    """Captures of patterns, in the order of the patterns → the map from mask to sensor.

    Args:
        calibration: to build on; with its dark, light that passes closed mask pixels is measured as well.
        path: captures.
        patterns: that were shown, an open and a dark one among them.
        wavelength: of the light, metres; needed before a disperser.
        scale: sensor pixels per mask pixel, to 6 %.
        device: (rows, columns) of the mask, to be checked.
        saturation: of the captures.

    Raises:
        DataError: missing, saturated or dark captures, patterns of another size, or a fit that failed.
    """
    shown = read_patterns(patterns, device)
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    values = corrected(in_order(frames, len(shown), "pattern"), calibration)
    above_dark = calibration.part("dark") is not None
    found = register(
        values, shown, scale=scale, wavelength=wavelength, above_dark=above_dark, names=frames.names, source=path
    )
    residuals = {
        "residual_of_contrast": found.residual,
        "corner_std_pixels": found.edge_std,
        "blur_pixels": found.blur,
        "mirrored": float(np.linalg.det(found.matrix[:, :2]) < 0),
        "scale": found.scale,
        "turn_degrees": float(np.rad2deg(np.arctan2(found.matrix[1, 0], found.matrix[0, 0]))),
        **_leakage_said(found),
    }
    settings = {"wavelength_m": wavelength, "scale": scale}
    return calibration.with_part(
        "registration", found, residuals, (path, patterns), sensor=found.sensor, codes=found.codes, settings=settings
    )


def _leakage_said(found: Registration) -> dict[str, float]:
    """What closed mask pixels pass; nothing where the sensor's dark was not known."""
    if found.leakage is None or found.leakage_std is None:
        return {}
    return {
        "contrast_ratio": found.contrast_ratio,
        "leakage": found.leakage,
        "leakage_std": found.leakage_std,
    }


def dispersion_step(
    calibration: Calibration,
    path: str | Path,
    patterns: str | Path,
    *,
    pattern: int = 3,
    power: str | Path | None = None,
    curve: Curve = "cauchy",
    order: int = 3,
    saturation: float | None = None,
) -> Calibration:
    """Captures of one pattern at many wavelengths (``…450nm…``) → dispersion curve and κ.

    Args:
        calibration: with dark and registration.
        path: captures.
        patterns: that were shown.
        pattern: which of them, from 0.
        power: text file of the source's power: nm, power.
        curve, order: see `tmca.lab.calibration.measurements.dispersion.measure_dispersion`.
        saturation: of the captures.

    Raises:
        DataError: missing, saturated or dark captures, or displacements that no smooth curve follows.
    """
    registration = needed(calibration, "registration", "dispersion")
    needed(calibration, "dark", "dispersion")
    frames = read_captures(path, saturation=saturation, sensor=registration.sensor)
    values, keys = averaged(frames.values.astype(np.float64), named(frames, captures.WAVE, "band_450nm"))
    waves = np.asarray(nm_to_metres(np.array([key[0] for key in keys])))
    stated = None if power is None else _power(power, waves)
    red_wider = bool(captures.kept_with(Path(path)).get(captures.RED_WIDER))
    found = measure_dispersion(
        corrected(values, calibration), waves, shown_pattern(patterns, pattern, registration), registration,
        power=stated, curve=curve, order=order, red_wider=red_wider, source=path,
    )  # fmt: skip
    _check_reference(found, registration, path)
    residuals = {
        "x_residual_pixels": float(found.residual[1]),
        "y_residual_pixels": float(found.residual[0]),
        "largest_std_pixels": float(found.std.max()),
        "span_pixels": float(np.ptp(found.shifts[:, 1])),
        "y_span_pixels": float(np.ptp(found.shifts[:, 0])),
        "largest_misfit": float(found.misfit.max()),
    }
    sources = [path, patterns, *([] if power is None else [power])]
    settings = {"pattern": pattern, "curve": curve, "order": order, REGISTERED_AT: registration.wavelength}
    settings[captures.RED_WIDER] = red_wider
    return calibration.with_part("dispersion", found, residuals, sources, sensor=registration.sensor, settings=settings)


def _check_reference(found: MeasuredDispersion, registration: Registration, path: str | Path) -> None:
    """Raises DataError where the registration's own light is displaced against it."""
    if registration.wavelength is None:
        return
    off = found.off_reference(registration.wavelength)
    if off is not None:
        what = f"light of {metres_to_nm(registration.wavelength):.6g} nm displaced by {off:.2f} pixels"
        remedy = "check the wavelengths of captures and registration; where the bench moved, register again"
        raise DataError(path, what, "none, for it was registered", remedy)


def _power(path: str | Path, waves: Array) -> Array:
    """Power of the source at wavelengths."""
    from tmca.lab.spectral_scan import read_spectra

    return np.asarray(read_spectra(path).at(np.asarray(metres_to_nm(waves)))[0], dtype=np.float64)


def shear_step(
    calibration: Calibration,
    path: str | Path,
    patterns: str | Path,
    *,
    pattern: int = 3,
    saturation: float | None = None,
) -> Calibration:
    """Captures of one pattern with one view open each (``view_-1_2``) → pixels per view, and the light of views.

    Args:
        calibration: with dark and registration at the middle view.
        path, patterns, pattern, saturation: see ``dispersion_step``.

    Raises:
        DataError: missing, saturated or dark captures, or shifts that are not linear.
    """
    registration = needed(calibration, "registration", "shear")
    needed(calibration, "dark", "shear")
    frames = read_captures(path, saturation=saturation, sensor=registration.sensor)
    values, keys = averaged(frames.values.astype(np.float64), named(frames, captures.VIEW, "view_-1_2"))
    places = [(int(v), int(u)) for v, u in keys]
    chosen = shown_pattern(patterns, pattern, registration)
    found = measure_shear(corrected(values, calibration), places, chosen, registration, source=path)
    residuals = {
        "residual_pixels": found.residual,
        "y_pixels_per_view": float(found.step[0]),
        "x_pixels_per_view": float(found.step[1]),
        "largest_std_pixels_per_view": float(found.std.max()),
        "largest_cross_term": float(np.abs(found.cross).max()),
    }
    settings = {"pattern": pattern}
    return calibration.with_part(
        "shear", found, residuals, (path, patterns), sensor=registration.sensor, settings=settings
    )


def timing_step(calibration: Calibration, path: str | Path, *, saturation: float | None = None) -> Calibration:
    """Captures with one slot of aperture and shutter open each (``aperture_0_shutter_1``) → delay, ratio and leakage.

    Args:
        calibration: with dark; with registration, what the aperture leaks is told from what the shutter does.
        path, saturation: see ``dispersion_step``.

    Raises:
        DataError: missing, saturated or dark captures, or levels that no delay explains.
    """
    needed(calibration, "dark", "timing")
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    levels = _pair_levels(frames, calibration)
    registration = calibration.part("registration")
    aperture, std = (0.0, 0.0) if registration is None else (registration.closed_light, registration.leakage_std or 0.0)
    measured = measure_timing(levels, aperture_leakage=aperture, aperture_leakage_std=std, source=path)
    residuals = {
        "residual_of_a_slot": measured.residual,
        "delay_slots": measured.delay,
        "ratio": measured.ratio,
        "delay_std_slots": float(measured.std[0]),
        "ratio_std": float(measured.std[1]),
        "leakage": measured.leakage,
        "leakage_std": measured.leakage_std,
        "repeats": float(measured.repeats),
    }
    size = (int(frames.values.shape[1]), int(frames.values.shape[2]))
    settings = {"aperture_leakage": aperture}
    return calibration.with_part("timing", measured, residuals, (path,), sensor=size, settings=settings)


def _pair_levels(frames: Frames, calibration: Calibration) -> Array:
    """(K, K) mean light with slot i of the aperture and slot j of the shutter open; NaN of pairs without a frame."""
    keys = [(int(i), int(j)) for i, j in named(frames, captures.SLOTS, "aperture_0_shutter_1")]
    slots = 1 + max(max(key) for key in keys)
    wanted = [(i, j) for i in range(slots) for j in range(slots) if abs(i - j) <= 1]
    if gone := [pair for pair in wanted if pair not in keys]:
        found = "no aperture_{}_shutter_{}".format(*gone[0])
        expected = "every slot of the aperture with that of the shutter and with both beside it"
        raise DataError(frames.source, found, expected, "capture it")
    levels = np.full((slots, slots), np.nan)
    light = corrected(frames.values, calibration).mean(axis=(1, 2))
    for key in set(keys):
        levels[key] = np.mean([one for one, own in zip(light, keys, strict=True) if own == key])
    _check_light(float(np.nanmax(levels)), calibration.part("dark"), frames.source)
    return levels


def _check_light(level: float, dark: DarkField, source: object) -> None:
    """Raises DataError for a largest mean level that is within the noise of the mean of dark frames."""
    noise = max(dark.noise, ROUNDING) * np.sqrt((1 + 1 / dark.frames) / dark.mean.size)
    if level < 10 * noise:
        found = f"light of {level:.2g} above the dark in the brightest pair of slots"
        raise DataError(source, found, f"ten times its noise, {10 * noise:.2g}, or more", "is the lamp on?")
