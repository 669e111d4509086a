"""The steps of a calibration: captures in, one more part measured, with what it says of its own errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tmca.data import metres_to_nm, nm_to_metres
from tmca.errors import DataError, SettingError
from tmca.lab.calibration import captures
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.captures import averaged, corrected, in_order, named, read_captures
from tmca.lab.calibration.dispersion import Curve, measure_dispersion
from tmca.lab.calibration.psf import measure_psf
from tmca.lab.calibration.registration import Registration, register
from tmca.lab.calibration.shear import measure_shear
from tmca.lab.calibration.timing import measure_timing
from tmca.lab.calibration.zernike_fit import MODES, fit_zernike_psf, wavefront_rms
from tmca.lab.frames import read_frames
from tmca.optics import PhaseMaskBench
from tmca.optics.zernike import Mode


def needed(calibration: Calibration, name: str, step: str) -> Any:
    """A part that a step builds on.

    Raises:
        DataError: it was not measured.
    """
    part = calibration.part(name)
    if part is None:
        remedy = f"run tmca calibrate {name} first, and name its file with --onto"
        raise DataError(calibration.where, f"no {name}", f"one, on which {step} builds", remedy)
    return part


def sensor_size(calibration: Calibration) -> tuple[int, int] | None:
    """(H, W) of the sensor, if a step has seen it."""
    found = calibration.about["camera"].get("sensor")
    return None if found is None else (int(found[0]), int(found[1]))


def read_patterns(path: str | Path, device: tuple[int, int] | None = None) -> Array:
    """(P, h, w) patterns that were shown, zeros and ones, from a folder of pictures or a stack.

    Raises:
        DataError: grey patterns, or a size that is not the device's.
    """
    values = read_frames(path).values
    top = float(values.max())
    if not top > 0 or not np.isin(values, (0, top)).all():
        raise DataError(path, "grey patterns", "pictures of two levels: dark and open", "save them without smoothing")
    if device is not None and values.shape[1:] != tuple(device):
        found, known = ("×".join(map(str, n)) for n in (values.shape[1:], device))
        raise DataError(path, f"patterns of {found} pixels", f"{known}, those of the device", "name what was shown")
    return np.asarray(values, dtype=np.float64) / top


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
        calibration: to build on.
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
    found = register(values, shown, scale=scale, wavelength=wavelength, source=path)
    residuals = {
        "residual_of_contrast": found.residual,
        "corner_std_pixels": found.edge_std,
        "blur_pixels": found.blur,
        "scale": float(np.sqrt(abs(np.linalg.det(found.matrix[:, :2])))),
        "turn_degrees": float(np.rad2deg(np.arctan2(found.matrix[1, 0], found.matrix[0, 0]))),
    }
    settings = {"wavelength_m": wavelength, "scale": scale}
    return calibration.with_part(
        "registration", found, residuals, (path, patterns), sensor=found.sensor, codes=found.codes, settings=settings
    )


def _pattern(path: str | Path, index: int, registration: Registration) -> Array:
    """One of the patterns that were shown, of the size that was registered."""
    shown = read_patterns(path, registration.codes)
    if not 0 <= index < len(shown):
        raise SettingError("pattern", str(index), f"0 to {len(shown) - 1}")
    share = shown[index].mean()
    if share in (0.0, 1.0):
        raise SettingError("pattern", f"{index}, which is all {'open' if share else 'dark'}", "a coded one")
    return shown[index]


def dispersion_step(
    calibration: Calibration,
    path: str | Path,
    patterns: str | Path,
    *,
    pattern: int = 3,
    power: str | Path | None = None,
    curve: Curve = "cauchy",
    order: int = 2,
    saturation: float | None = None,
) -> Calibration:
    """Captures of one pattern at many wavelengths (``…450nm…``) → dispersion curve and κ.

    Args:
        calibration: with dark and registration.
        path: captures.
        patterns: that were shown.
        pattern: which of them, from 0.
        power: text file of the source's power: nm, power.
        curve, order: see `tmca.lab.calibration.dispersion.measure_dispersion`.
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
    found = measure_dispersion(
        corrected(values, calibration), waves, _pattern(patterns, pattern, registration), registration,
        power=stated, curve=curve, order=order, source=path,
    )  # fmt: skip
    residuals = {
        "x_residual_pixels": float(found.residual[1]),
        "y_residual_pixels": float(found.residual[0]),
        "largest_std_pixels": float(found.std.max()),
        "span_pixels": float(np.ptp(found.shifts[:, 1])),
        "y_span_pixels": float(np.ptp(found.shifts[:, 0])),
        "largest_misfit": float(found.misfit.max()),
    }
    sources = [path, patterns, *([] if power is None else [power])]
    settings = {"pattern": pattern, "curve": curve, "order": order}
    return calibration.with_part("dispersion", found, residuals, sources, sensor=registration.sensor, settings=settings)


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
    chosen = _pattern(patterns, pattern, registration)
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
    """Captures with one slot of aperture and shutter open each (``aperture_0_shutter_1``) → delay and ratio.

    Args:
        calibration: with dark.
        path, saturation: see ``dispersion_step``.

    Raises:
        DataError: missing, saturated or dark captures, or levels that no delay explains.
    """
    needed(calibration, "dark", "timing")
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    keys = [(int(i), int(j)) for i, j in named(frames, captures.SLOTS, "aperture_0_shutter_1")]
    slots = 1 + max(max(key) for key in keys)
    gone = [k for k in range(slots) if (k, k) not in keys]
    if gone:
        found = f"no aperture_{gone[0]}_shutter_{gone[0]}"
        raise DataError(path, found, "every slot of the aperture with that of the shutter", "capture it")
    levels = np.full((slots, slots), np.nan)
    light = corrected(frames.values, calibration).mean(axis=(1, 2))
    for key in set(keys):
        levels[key] = np.mean([one for one, own in zip(light, keys, strict=True) if own == key])
    measured = measure_timing(levels, source=path)
    residuals = {
        "residual_of_a_slot": measured.residual,
        "delay_slots": measured.delay,
        "ratio": measured.ratio,
        "delay_std_slots": float(measured.std[0]),
        "ratio_std": float(measured.std[1]),
    }
    size = (int(frames.values.shape[1]), int(frames.values.shape[2]))
    return calibration.with_part("timing", measured, residuals, (path,), sensor=size)


def psf_step(
    calibration: Calibration,
    path: str | Path,
    bench: PhaseMaskBench,
    *,
    slot: int = 0,
    nominal: Array | None = None,
    modes: Sequence[Mode] = MODES,
    saturation: float | None = None,
    source: str | Path | None = None,
) -> Calibration:
    """Captures of a point source (``…0.6m_550nm…``) with the mask of one slot → PSF stack and wavefront.

    Args:
        calibration: with dark.
        path: captures at every pair of depth and wavelength.
        bench: the camera's optics.
        slot: whose mask was shown.
        nominal: (H, W) heights that were asked for, metres.
        modes: to fit.
        saturation: of the captures.
        source: file that bench and heights are from.

    Raises:
        DataError: missing, saturated or dark captures, or no wavefront that explains them.
    """
    needed(calibration, "dark", "psf")
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    values, keys = averaged(frames.values.astype(np.float64), named(frames, captures.POINT, "point_0.6m_550nm"))
    depths, waves = (sorted({key[i] for key in keys}) for i in (0, 1))
    gone = [(z, w) for z in depths for w in waves if (z, w) not in keys]
    if gone:
        found = f"no capture at {gone[0][0]:g} m and {gone[0][1]:g} nm"
        raise DataError(path, found, f"all of {len(depths)} depths and {len(waves)} wavelengths", "capture it")
    cube = corrected(values, calibration).reshape(len(depths), len(waves), *values.shape[1:])
    stack = measure_psf(cube, depths, np.asarray(nm_to_metres(np.array(waves))), bench.window, source=path)
    fit = fit_zernike_psf(stack, bench, modes=modes, nominal=nominal, source=path)
    middle = float(stack.wavelengths[len(waves) // 2])
    residuals = {
        "residual": fit.residual,
        "snr_db": stack.snr_db,
        "rms_waves": wavefront_rms(fit.coefficients, bench, middle),
        "std_waves": wavefront_rms(fit.std, bench, middle),
        "starts": float(fit.starts),
    }
    size, sources = (int(values.shape[1]), int(values.shape[2])), [path, *([] if source is None else [source])]
    with_stack = calibration.with_part(f"psf{slot}", stack, {"snr_db": stack.snr_db}, sources, sensor=size)
    return with_stack.with_part(f"wavefront{slot}", fit, residuals, sources, settings={"wavelength_m": middle})
