"""What the captures of each step of a calibration say: parts with their residuals."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from tmca.cameras import Snapshot
from tmca.data import metres_to_nm, nm_to_metres
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.buckets import measure_buckets
from tmca.lab.calibration.captured import Captured, Fitted, StepSettings
from tmca.lab.calibration.captures import averaged, read_captures, read_patterns, taken_with, whole_exposures
from tmca.lab.calibration.displacement import REGISTERED_AT, measure_dispersion, measure_shear
from tmca.lab.calibration.psf import fit_zernike_psf, measure_psf, wavefront_rms
from tmca.lab.calibration.registration import register
from tmca.lab.calibration.sensor import (
    DarkField,
    FlatField,
    measure_dark,
    measure_flat,
    measure_flats,
    measure_linearity,
)
from tmca.lab.calibration.timing import measure_timing
from tmca.lab.frames import Array, named

VIEW = re.compile(r"view_(-?\d+)_(-?\d+)(?:_|$)")
SLOTS = re.compile(r"aperture_(\d+)_shutter_(\d+)(?:_|$)")
POINT = re.compile(r"(\d+(?:\.\d+)?)m_(\d+(?:\.\d+)?)nm(?:_|$)")
WAVE = re.compile(r"(\d+(?:\.\d+)?)nm(?:_|$)")
BUCKET = re.compile(r"bucket_(\d+)(?:_|$)")
IN_TURN = re.compile(r"in_turn_(\d+)(?:_|$)")
EXPOSURE = re.compile(r"(\d+(?:\.\d+)?)ms(?:_|$)")

DRAWN = "drawn_map"
"""Note of a registration's frames: where the mask was drawn, (2, 3) from code to sensor pixels."""
WHOLE_EXPOSURES = "whole_exposures"
"""Setting of a flat that a bench took: whether the sensor codes its shutter, and has a timing."""


def dark(seen: Captured) -> dict[str, Fitted]:
    field, top = measure_dark(seen.frames.values, source=seen.path), seen.frames.top
    residuals = {
        "offset_dn": float(field.mean.mean()),
        "read_noise_dn": field.noise,
        "hot_pixels": float((field.defects > 0).sum()),
        "frames": float(field.frames),
        "noise_of_saturation": float(np.sqrt((field.read_noise**2).mean())) / top,
    }
    return {"dark": Fitted(field, residuals)}


def flat(seen: Captured) -> dict[str, Fitted]:
    dark, given = seen.calibration.part("dark"), seen.given
    reflectance = _reflectance(given)
    if seen.buckets == 1:
        field = measure_flat(seen.frames.values, dark, source=seen.path)
    else:
        field = measure_flats(_of_buckets(seen, dark), dark, source=seen.path)
    level = _white_level(seen, field) / reflectance
    residuals = {
        "level_dn": field.level,
        "nonuniformity": field.nonuniformity,
        "std": field.std,
        "dead_pixels": float((field.defects > 0).sum()),
        "noise_of_light": float(field.std * np.sqrt(field.frames)),
        "white_level_dn": level,
    }
    if seen.buckets > 1:
        means = field.gain.mean((1, 2))
        residuals |= {f"gain_of_bucket_{r + 1}": float(means[r] / means[0]) for r in range(1, seen.buckets)}
    settings: dict[str, Any] = {"white_level": level, "reflectance": reflectance}
    if (whole := whole_exposures(seen.path)) is not None:
        settings[WHOLE_EXPOSURES] = whole
    return {"flat": Fitted(field, residuals, settings, [given.white])}


def _reflectance(given: StepSettings) -> float:
    """Of the white reference, 1 where none is given."""
    reflectance = 1.0 if given.reflectance is None else given.reflectance
    if not 0 < reflectance <= 1:
        raise SettingError("--reflectance", f"{reflectance:g}", "a share of white, above 0 and up to 1")
    return reflectance


def _of_buckets(seen: Captured, dark: DarkField) -> list[Array]:
    """Of every bucket the frames (N, H, W) with all slots in it, and on them what leaks into it from others."""
    owner = np.array([int(key[0]) for key in named(seen.frames, BUCKET, "flat_bucket_0_3")])
    if gone := sorted(set(range(seen.buckets)) - set(owner.tolist())):
        expected = f"frames of even light in each of {seen.buckets} buckets"
        raise DataError(seen.path, f"no frame of bucket_{gone[0]}", expected, "capture it")
    values = np.asarray(seen.frames.values, dtype=np.float64)
    means = np.stack([values[owner == r].mean(0) - dark.mean for r in range(seen.buckets)])
    return [values[owner == r][:, r] + means[:, r].sum(0) - means[r, r] for r in range(seen.buckets)]


def _white_level(seen: Captured, field: FlatField) -> float:
    """Level of white in the middle third of the sensor, where a disperser lays all bands on one another; without
    frames of white that of the flat."""
    path = seen.given.white
    if path is None:
        return field.level
    calibration = seen.calibration.with_part("flat", field, {})
    frames = read_captures(path, saturation=seen.given.saturation, sensor=calibration.about["camera"]["sensor"])
    rows, columns = (slice(n // 3, n - n // 3) for n in frames.values.shape[-2:])
    values = calibration.light(frames.values)[:, rows, columns]
    level = float(np.median(values.mean(axis=0)))
    if level < 10 * calibration.part("dark").noise:
        raise DataError(path, f"white of {level:.3g} above the dark", "ten times its noise", "give more light")
    return level


def linearity(seen: Captured) -> dict[str, Fitted]:
    times = np.array([key[0] for key in named(seen.frames, EXPOSURE, "even_5ms_0")])
    distinct, counts = np.unique(times, return_counts=True)
    if counts.min() < 2 or len(set(counts.tolist())) > 1:
        found = f"{counts.min()} to {counts.max()} frames at {distinct[int(counts.argmin())]:g} ms and others"
        raise DataError(seen.path, found, "as many, two or more, at every exposure", "capture the missing ones")
    chosen = [np.flatnonzero(times == time) for time in distinct]
    values, full = (np.stack([part[i] for i in chosen]) for part in (seen.frames.values, seen.frames.saturated))
    dark = seen.calibration.part("dark")
    if seen.buckets > 1:  # the one that has the light
        values, full, dark = values[:, :, 0], full[:, :, 0], dark.of_bucket(0)
    measured = measure_linearity(distinct * 1e-3, values, dark, full, source=seen.path)
    residuals = {
        "largest_deviation": measured.largest_deviation,
        "saturation_dn": measured.saturation,
        **measured.electrons(seen.path),
    }
    return {"linearity": Fitted(measured, residuals)}


def registration(seen: Captured) -> dict[str, Fitted]:
    given, light = seen.given, seen.calibration.light(seen.frames.values)
    if given.patterns is None:
        raise SettingError("--patterns", "none", "the folder of those that were shown")
    shown, wave = read_patterns(given.patterns, given.device), _wavelength(seen)
    above_dark = seen.calibration.part("dark") is not None
    registered = register(light, shown, scale=given.scale, wavelength=wave, above_dark=above_dark, source=seen.path)
    residuals = {
        "residual_of_contrast": registered.residual,
        "corner_std_pixels": registered.edge_std,
        "blur_pixels": registered.blur,
        "mirrored": float(np.linalg.det(registered.matrix[:, :2]) < 0),
        "scale": registered.scale,
        "turn_degrees": float(np.rad2deg(np.arctan2(registered.matrix[1, 0], registered.matrix[0, 0]))),
        **registered.beside(taken_with(seen.path).get(DRAWN)),
    }
    if wave is not None:
        residuals["wavelength_nm"] = float(metres_to_nm(wave))
    if registered.leakage is not None and registered.leakage_std is not None:
        residuals |= {name: getattr(registered, name) for name in ("contrast_ratio", "leakage", "leakage_std")}
    settings = {"wavelength_m": wave, "scale": given.scale}
    return {"registration": Fitted(registered, residuals, settings, [given.patterns], registered.codes)}


def _wavelength(seen: Captured) -> float | None:
    """Metres of the light of a registration, as it is given, else as the bench noted it."""
    noted = taken_with(seen.path).get("wavelength_nm") if seen.given.wavelength is None else None
    return seen.given.wavelength if noted is None else float(nm_to_metres(noted))


def timing(seen: Captured) -> dict[str, Fitted]:
    registration = seen.calibration.part("registration")
    aperture, std = (0.0, 0.0) if registration is None else (registration.closed_light, registration.leakage_std or 0.0)
    levels, *others = _pair_levels(seen)
    measured = measure_timing(
        levels,
        aperture_leakage=aperture,
        aperture_leakage_std=std,
        others=sum(others) if others else None,
        transfer=seen.calibration.part("buckets").transfer if others else 0.0,
        source=seen.path,
    )
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
    return {"timing": Fitted(measured, residuals, {"aperture_leakage": aperture})}


def buckets(seen: Captured) -> dict[str, Fitted]:
    if seen.buckets == 1:
        raise DataError(seen.path, "frames of one bucket", "a page for each of several", "capture all of them")
    light = seen.calibration.corrected(seen.frames.values).mean((2, 3))
    turns = [int(turn[1]) for name in seen.frames.names if (turn := IN_TURN.search(name))]
    slots = max(turns, default=1)
    shown = [f"bucket_{bucket}_" for bucket in range(seen.buckets)] + [f"in_turn_{slots}_"] * (slots > 1)
    chosen = [[name.startswith(begin) for name in seen.frames.names] for begin in shown]
    if gone := [begin for begin, which in zip(shown, chosen, strict=True) if not any(which)]:
        raise DataError(seen.path, f"no frame {gone[0]}0", "all slots in each bucket", "capture it")
    measured = measure_buckets([light[which].mean(0) for which in chosen], slots, source=seen.path)
    if not turns:
        _check_bench(seen)
    residuals = {
        "residual_of_light": measured.residual,
        "leakage": measured.leakage,
        "leakage_std": float(measured.std[0]),
        "transfer_slots": measured.transfer,
        "transfer_std_slots": float(measured.std[1]),
    }
    return {"buckets": Fitted(measured, residuals)}


def _check_bench(seen: Captured) -> None:
    """Raises DataError unless a bench took the frames: of one slot it takes none in turn, other software names one."""
    if whole_exposures(seen.path) is None:
        expected = "the K slots in one bucket after the other, which tell the time of a change"
        remedy = "capture it; where K is 1, bucket_0_0 again as in_turn_1_0"
        raise DataError(seen.path, "no frame in_turn_K_0", expected, remedy)


def _pair_levels(seen: Captured) -> Array:
    """(R, K, K) mean light of every bucket with slot i of the aperture and slot j of the shutter open, the others in
    another bucket; NaN of pairs without a frame."""
    frames, numbers = averaged(seen.frames.values, named(seen.frames, SLOTS, "aperture_0_shutter_1"))
    light = seen.calibration.corrected(frames).mean((-2, -1))
    keys = [(int(i), int(j)) for i, j in numbers]
    slots = 1 + max(max(key) for key in keys)
    wanted = [(i, j) for i in range(slots) for j in range(slots) if abs(i - j) <= 1]
    if gone := [pair for pair in wanted if pair not in keys]:
        expected = "every slot of the aperture with that of the shutter and with both beside it"
        raise DataError(seen.path, "no aperture_{}_shutter_{}".format(*gone[0]), expected, "capture it")
    if seen.buckets > 1:
        if (mixing := seen.calibration.part("buckets")) is None:
            remedy = "run tmca calibrate buckets first, and name its file with --onto"
            raise DataError(seen.calibration.where, "no buckets", "one, on which timing builds", remedy)
        light = mixing.unmixed(light)
    levels = np.full((seen.buckets, slots, slots), np.nan)
    levels[:, *np.array(keys).T] = light.T
    return levels


def dispersion(seen: Captured) -> dict[str, Fitted]:
    from tmca.lab.ground_truth.spectra import read_spectra

    registration, given = seen.calibration.part("registration"), seen.given
    light, keys = seen.by_name(WAVE, "band_450nm")
    nm = np.array([key[0] for key in keys])
    power = None if given.power is None else np.asarray(read_spectra(given.power).at(nm)[0], dtype=np.float64)
    index, shown = seen.pattern()
    measured = measure_dispersion(
        light, np.asarray(nm_to_metres(nm)), shown, registration, power=power, curve=given.curve, order=given.order,
        source=seen.path,
    )  # fmt: skip
    residuals = {
        "x_residual_pixels": float(measured.residual[1]),
        "y_residual_pixels": float(measured.residual[0]),
        "largest_std_pixels": float(measured.std.max()),
        "span_pixels": float(np.ptp(measured.shifts[:, 1])),
        "y_span_pixels": float(np.ptp(measured.shifts[:, 0])),
        "largest_misfit": float(measured.misfit.max()),
    }
    settings = {"pattern": index, "curve": given.curve, "order": given.order, REGISTERED_AT: registration.wavelength}
    return {"dispersion": Fitted(measured, residuals, settings, [given.patterns, given.power])}


def shear(seen: Captured) -> dict[str, Fitted]:
    light, keys = seen.by_name(VIEW, "view_-1_2")
    index, shown = seen.pattern()
    places = [(int(v), int(u)) for v, u in keys]
    measured = measure_shear(light, places, shown, seen.calibration.part("registration"), source=seen.path)
    residuals = {
        "residual_pixels": measured.residual,
        "y_pixels_per_view": float(measured.step[0]),
        "x_pixels_per_view": float(measured.step[1]),
        "largest_std_pixels_per_view": float(measured.std.max()),
        "largest_cross_term": float(np.abs(measured.cross).max()),
    }
    return {"shear": Fitted(measured, residuals, {"pattern": index}, [seen.given.patterns])}


def psf(seen: Captured) -> dict[str, Fitted]:
    camera, slot = _phase_mask_camera(seen), seen.given.slot
    cube, depths, waves = _points(seen)
    stack = measure_psf(cube, depths, waves, camera.bench.window, source=seen.path)
    nominal = camera.codes()[0][slot].detach().double().numpy()
    fit = fit_zernike_psf(stack, camera.bench, nominal=nominal, source=seen.path)
    middle = float(stack.wavelengths[len(waves) // 2])
    residuals = {
        "residual": fit.residual,
        "snr_db": stack.snr_db,
        "rms_waves": wavefront_rms(fit.coefficients, camera.bench, middle),
        "std_waves": wavefront_rms(fit.std, camera.bench, middle),
        "starts": float(fit.starts),
    }
    return {
        f"psf{slot}": Fitted(stack, {"snr_db": stack.snr_db}, sources=[seen.given.snapshot]),
        f"wavefront{slot}": Fitted(fit, residuals, {"wavelength_m": middle}, [seen.given.snapshot]),
    }


def _points(seen: Captured) -> tuple[Array, list[float], Array]:
    """(Z, L, H, W) light of points at all depths and wavelengths, both in metres."""
    light, keys = seen.by_name(POINT, "point_0.6m_550nm")
    depths, nm = (sorted({key[i] for key in keys}) for i in (0, 1))
    if gone := [(z, w) for z in depths for w in nm if (z, w) not in keys]:
        missing = f"no capture at {gone[0][0]:g} m and {gone[0][1]:g} nm"
        raise DataError(seen.path, missing, f"all of {len(depths)} depths and {len(nm)} wavelengths", "capture it")
    return light.reshape(len(depths), len(nm), *light.shape[1:]), depths, np.asarray(nm_to_metres(np.array(nm)))


def _phase_mask_camera(seen: Captured) -> Any:
    """The camera of a snapshot file, whose mask of a slot is measured."""
    snapshot, slot = seen.given.snapshot, seen.given.slot
    if snapshot is None:
        expected, remedy = "a snapshot file that says its masks", "name it: --snapshot"
        raise DataError(seen.path, "points, and no camera", expected, remedy)
    camera = Snapshot.load(snapshot).camera
    if "heights" not in camera.plane_names:
        remedy = "name a snapshot of the camera that the points are of"
        raise DataError(snapshot, f"a {camera.kind} camera", "a spectral-depth one, with phase masks", remedy)
    if not 0 <= slot < camera.slots:
        raise SettingError("--slot", f"{slot}", f"slots 0 to {camera.slots - 1} of a spectral-depth camera")
    return camera
