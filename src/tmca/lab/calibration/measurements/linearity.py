"""Response of a sensor from a series of exposures: linearity, saturation, electrons per digital number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.errors import DataError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.dark_flat import ROUNDING, DarkField

LARGEST_DEVIATION = 0.05
_RANGE = (0.05, 0.95)
"""Share of the saturation level between which the line is fitted, as EMVA 1288 does."""


@dataclass(frozen=True)
class Linearity:
    """Of the mean over all good pixels.

    Args:
        exposures: (E,) seconds, ascending.
        levels: (E,) mean above the dark, digital numbers.
        variances: (E,) of a pixel's noise over time, digital numbers squared.
        slope: digital numbers per second.
        offset: of the line, digital numbers.
        deviations: (E,) from the line relative to it; NaN outside the fitted range.
        saturation: level above the dark at which most pixels are saturated; NaN where none was reached.
        gain: electrons per digital number, by photon transfer.
        gain_std: of it.
        read_noise: of the photon transfer's line at no light, electrons.
    """

    exposures: Array
    levels: Array
    variances: Array
    slope: float
    offset: float
    deviations: Array
    saturation: float
    gain: float
    gain_std: float
    read_noise: float

    @property
    def largest_deviation(self) -> float:
        """From linearity, as a share."""
        return float(np.nanmax(np.abs(self.deviations)))

    @property
    def full_well(self) -> float:
        """Electrons at saturation; NaN where it was not reached."""
        return self.gain * self.saturation


def measure_linearity(
    exposures: ArrayLike,
    frames: ArrayLike,
    dark: DarkField,
    saturated: ArrayLike | None = None,
    *,
    source: object = "linearity",
) -> Linearity:
    """Line through mean levels (least relative squares), and variance over level: ``σ² = σ_read² + level / gain``.

    The variance is that of differences between frames of one exposure, which fixed patterns leave. Sources: EMVA
    standard 1288; Janesick, Photon Transfer (2007).

    Args:
        exposures: (E,) seconds.
        frames: (E, N, H, W), N ≥ 2, digital numbers.
        dark: of the same sensor.
        saturated: (E, N, H, W) pixels at the end of the scale.
        source: named in errors.

    Raises:
        DataError: fewer than three exposures below saturation, one frame each, a frame that is off the mean of
            its exposure by more than 5 %, levels that do not grow, or a response that is as far off a line.
    """
    times, values = np.asarray(exposures, dtype=np.float64), np.asarray(frames, dtype=np.float64)
    if values.ndim != 4 or values.shape[1] < 2 or len(set(times.tolist())) < len(times):
        raise DataError(source, f"frames of shape {values.shape}", "two or more at each of several exposures")
    order = np.argsort(times)
    full: NDArray[np.bool_] = np.zeros(values.shape, bool)
    if saturated is not None:
        full = np.asarray(saturated, bool)
    times, values, full = times[order], values[order], full[order]
    good = np.asarray(dark.defects == 0)
    each = (values - dark.mean)[..., good].mean(axis=-1)
    levels = each.mean(axis=1)
    _check_named(times, each, source)
    variances = values.var(axis=1, ddof=1)[:, good].mean(axis=1)
    share = np.asarray(full.any(axis=1))[:, good].mean(axis=1)
    saturation = float(levels[share > 0.5].min()) if (share > 0.5).any() else float("nan")
    used = _used(times, levels, share, saturation, source)
    slope, offset = _line(times[used], levels[used], 1 / levels[used])
    deviations = np.where(used, levels / (offset + slope * times) - 1, np.nan)
    if np.nanmax(np.abs(deviations)) > LARGEST_DEVIATION:
        what = f"a response that is off a line by {np.nanmax(np.abs(deviations)):.1%}"
        remedy = "check the exposures; switch gamma off, keep the lamp steady"
        raise DataError(source, what, f"{LARGEST_DEVIATION:.0%} at most", remedy)
    transfer = _transfer(levels[used], variances[used], values.shape[1], source)
    return Linearity(times, levels, variances, slope, offset, deviations, saturation, *transfer)


def _check_named(times: Array, each: Array, source: object) -> None:
    """Raises DataError where levels (E, N) are off the mean of their exposure, or those of the next one are lower."""
    levels = each.mean(axis=1)
    slack = np.maximum(LARGEST_DEVIATION * np.maximum(levels, _RANGE[0] * levels.max()), ROUNDING)
    away = np.abs(each - levels[:, None]).max(axis=1)
    if (away > slack).any():
        worst = int((away / slack).argmax())
        said = " and ".join(f"{level:.4g}" for level in (each[worst].min(), each[worst].max()))
        found = f"levels of {said} in frames of one exposure, {times[worst] * 1e3:g} ms"
        expected = f"each within {LARGEST_DEVIATION:.0%} of their mean"
        raise DataError(source, found, expected, "check the file names; keep the lamp steady")
    if (np.diff(levels) < -slack[1:]).any():
        raise DataError(source, "levels that do not grow with the exposure", "growing ones", "check the file names")


def _used(times: Array, levels: Array, share: Array, saturation: float, source: object) -> np.ndarray:
    """Exposures that are fitted."""
    top = saturation if np.isfinite(saturation) else float(levels.max()) / _RANGE[1]
    used = (levels >= _RANGE[0] * top) & (levels <= _RANGE[1] * top * (1 + 1e-9)) & (share < 1e-3)
    if used.sum() < 3:
        found = f"{int(used.sum())} exposures between 5% and 95% of saturation"
        raise DataError(source, found, "three or more", "take more exposures, from short to just below saturation")
    if (np.diff(levels[used]) <= 0).any():
        raise DataError(source, "levels that do not grow with the exposure", "growing ones", "check the file names")
    return np.asarray(used)


def _line(x: Array, y: Array, weight: Array) -> tuple[float, float]:
    terms = np.column_stack([x, np.ones_like(x)])
    slope, offset = np.linalg.lstsq(terms * weight[:, None], y * weight, rcond=None)[0]
    return float(slope), float(offset)


def _transfer(levels: Array, variances: Array, frames: int, source: object) -> tuple[float, float, float]:
    """Electrons per digital number, its standard deviation, and electrons of read noise."""
    if not (variances > 0).all():
        raise DataError(source, "frames that repeat without any noise", "shot noise", "is it a raw capture?")
    weight = 1 / variances
    terms = np.column_stack([levels, np.ones_like(levels)]) * weight[:, None]
    (slope, floor), *_ = np.linalg.lstsq(terms, variances * weight, rcond=None)
    if not slope > 0:
        raise DataError(source, "noise that does not grow with the light", "shot noise", "is it a raw capture?")
    left = variances * weight - terms @ np.array([slope, floor])
    spread = np.sqrt(np.linalg.inv(terms.T @ terms)[0, 0] * (left**2).sum() / max(1, len(levels) - 2))
    return float(1 / slope), float(spread / slope**2), float(np.sqrt(max(floor, 0.0)) / slope)
