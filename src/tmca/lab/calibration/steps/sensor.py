"""The steps that measure a sensor: dark, flat, linearity."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tmca.errors import DataError, SettingError
from tmca.lab.calibration import captures
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.captures import named, read_captures
from tmca.lab.calibration.measurements.dark_flat import check_steady, measure_dark, measure_flat
from tmca.lab.calibration.measurements.linearity import measure_linearity
from tmca.lab.calibration.steps.building_on import needed, sensor_size


def dark_step(calibration: Calibration, path: str | Path, *, saturation: float | None = None) -> Calibration:
    """Frames without light → offset, read noise, hot pixels.

    Args:
        calibration: to build on.
        path: captures, two or more.
        saturation: of the captures.

    Raises:
        DataError: one frame, another size than before, or light in them.
    """
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    found = measure_dark(frames.values, top=frames.top, source=path)
    residuals = {
        "offset_dn": float(found.mean.mean()),
        "read_noise_dn": found.noise,
        "hot_pixels": float((found.defects > 0).sum()),
        "frames": float(found.frames),
    }
    return calibration.with_part("dark", found, residuals, (path,), sensor=_size(found.mean))


def flat_step(
    calibration: Calibration,
    path: str | Path,
    *,
    white: str | Path | None = None,
    reflectance: float = 1.0,
    saturation: float | None = None,
) -> Calibration:
    """Frames of even light → flat field; frames of white through the open camera → the level of white.

    Args:
        calibration: with dark.
        path: captures of even light, two or more.
        white: captures of a white scene, mask and shutter held open for the exposure of a snapshot. Without them the
            level of the flat stands for white.
        reflectance: of that white scene, as a share: a grey reference does not saturate.
        saturation: of the captures.

    Raises:
        DataError: one frame, saturated or dark ones, or another size than the dark.
        SettingError: an impossible reflectance.
    """
    if not 0 < reflectance <= 1:
        raise SettingError("--reflectance", f"{reflectance:g}", "a share of white, above 0 and up to 1")
    dark = needed(calibration, "dark", "flat")
    frames = read_captures(path, saturation=saturation, sensor=dark.mean.shape)
    found = measure_flat(frames.values, dark, source=path)
    level = found.level if white is None else _white(white, calibration.with_part("flat", found, {}), saturation)
    level /= reflectance
    above_dark = frames.top - float(np.median(dark.mean))
    residuals = {
        "level_dn": found.level,
        "nonuniformity": found.nonuniformity,
        "std": found.std,
        "dead_pixels": float((found.defects > 0).sum()),
        "white_level_dn": level,
        **({"white_level_of_saturation": level / above_dark} if np.isfinite(above_dark) else {}),
    }
    sources = [path, *([] if white is None else [white])]
    return calibration.with_part(
        "flat", found, residuals, sources, settings={"white_level": level, "reflectance": reflectance}
    )


def _white(path: str | Path, calibration: Calibration, saturation: float | None) -> float:
    """Level of white in the middle third of the sensor, where a disperser lays all bands on one another."""
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    rows, columns = (slice(n // 3, n - n // 3) for n in frames.values.shape[1:])
    values = captures.corrected(frames.values, calibration)[:, rows, columns]
    level = float(np.median(values.mean(axis=0)))
    if level < 10 * calibration.part("dark").noise:
        raise DataError(path, f"white of {level:.3g} above the dark", "ten times its noise", "give more light")
    if len(values) > 1:
        check_steady(float(np.sqrt(values.var(axis=0, ddof=1).mean())) / level, path)
    return level


def linearity_step(calibration: Calibration, path: str | Path, *, saturation: float | None = None) -> Calibration:
    """Frames of even light at several exposures (``…5ms…``), two or more each → linearity, saturation, gain.

    Args:
        calibration: with dark.
        path: captures.
        saturation: of the captures.

    Raises:
        DataError: too few exposures or frames, or a response that is not linear.
    """
    dark = needed(calibration, "dark", "linearity")
    frames = read_captures(path, saturation=saturation, may_saturate=True, sensor=dark.mean.shape)
    times = np.array([key[0] for key in named(frames, captures.EXPOSURE, "even_5ms_0")])
    distinct, counts = np.unique(times, return_counts=True)
    if counts.min() < 2 or len(set(counts.tolist())) > 1:
        found = f"{counts.min()} to {counts.max()} frames at {distinct[int(counts.argmin())]:g} ms and others"
        raise DataError(path, found, "as many, two or more, at every exposure", "capture the missing ones")
    chosen = [np.flatnonzero(times == time) for time in distinct]
    values, full = (np.stack([part[i] for i in chosen]) for part in (frames.values, frames.saturated))
    measured = measure_linearity(distinct * 1e-3, values, dark, full, source=path)
    residuals = {
        "largest_deviation": measured.largest_deviation,
        "saturation_dn": measured.saturation,
        "electrons_per_dn": measured.gain,
        "electrons_per_dn_std": measured.gain_std,
        "read_noise_electrons": measured.read_noise,
        "full_well_electrons": measured.full_well,
    }
    return calibration.with_part("linearity", measured, residuals, (path,))


def _size(values: np.ndarray) -> tuple[int, int]:
    return (int(values.shape[0]), int(values.shape[1]))
