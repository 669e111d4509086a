"""Dark, flat and linearity of a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.errors import DataError
from tmca.lab.calibration.fitting import robust_std
from tmca.lab.frames import Array, check_size
from tmca.lab.quality import Doubtful

HOT, DEAD = 1, 2
"""Values of ``defects``: hot or noisy in the dark, and of a response far from the others'."""
ROUNDING = 0.3
"""Digital numbers of noise that rounding makes of none."""
_OUTLIER = 8.0
_DEAD = (0.5, 1.5)
_ORDER = 4


@dataclass(frozen=True)
class DarkField:
    """Digital numbers; of several buckets (R, H, W) in the place of (H, W).

    Args:
        mean: (H, W) offset.
        read_noise: (H, W) standard deviation of a frame.
        defects: (H, W) ``HOT`` where the offset or the noise is far from that of the others.
        frames: that were averaged.
    """

    mean: Array
    read_noise: Array
    defects: NDArray[np.uint8]
    frames: int

    @property
    def noise(self) -> float:
        """Root mean square of the read noise of good pixels."""
        return float(np.sqrt((self.read_noise[self.defects == 0] ** 2).mean()))

    def of_bucket(self, number: int) -> DarkField:
        """Of one of several buckets."""
        return DarkField(self.mean[number], self.read_noise[number], self.defects[number], self.frames)


@dataclass(frozen=True)
class FlatField:
    """Response to even light; of several buckets (R, H, W) in the place of (H, W).

    Args:
        gain: (H, W) light of every pixel over the mean: response and evenness of the light together.
        level: mean above the dark, digital numbers.
        nonuniformity: standard deviation of the pixels' own response (PRNU), relative, without noise and
            smooth light.
        std: of ``gain``, from the frames' noise, root mean square.
        defects: (H, W) ``DEAD`` where the response is below half or above one and a half of its surroundings'.
        frames: that were averaged.
    """

    gain: Array
    level: float
    nonuniformity: float
    std: float
    defects: NDArray[np.uint8]
    frames: int


def measure_dark(frames: ArrayLike, *, source: object = "dark") -> DarkField:
    """Mean and standard deviation of every pixel of frames without light.

    Args:
        frames: (N, H, W), or (N, R, H, W) of several buckets, N ≥ 2, digital numbers.
        source: named in errors.

    Raises:
        DataError: fewer than two frames, or more than a tenth of the pixels hot: light came in.
    """
    values = np.asarray(frames, dtype=np.float64)
    if values.ndim not in (3, 4) or len(values) < 2:
        found = f"{len(values) if values.ndim > 2 else 1} dark frame"
        raise DataError(source, found, "two or more, for the read noise", "capture more")
    mean, noise = values.mean(axis=0), values.std(axis=0, ddof=1)
    usual = np.median(noise, axis=(-2, -1), keepdims=True)
    hot = _far(mean, len(values)) | (_far(noise, len(values)) & (noise > usual))
    if (share := float(hot.mean((-2, -1)).max())) > 0.1:
        raise DataError(source, f"{share:.0%} hot pixels", "10% at most", "cover the lens; even light is no dark")
    return DarkField(mean, noise, np.where(hot, HOT, 0).astype(np.uint8), len(values))


def _stacked(fields: Sequence[Any], name: str) -> Any:
    """(R, H, W) one map of every bucket."""
    return np.stack([getattr(field, name) for field in fields])


def _far(values: Array, frames: int) -> NDArray[np.bool_]:
    """Values (…, H, W) many robust deviations from the median; of sample deviations, whose own spread has long tails,
    of more."""
    off = np.abs(values - np.median(values, axis=(-2, -1), keepdims=True))
    spread = robust_std(off, axis=(-2, -1)) + 0.5 / np.sqrt(12 * frames)
    return np.asarray(off > _OUTLIER * spread * (1 + 4 / frames))


def measure_flat(frames: ArrayLike, dark: DarkField, *, source: object = "flat") -> FlatField:
    """Every pixel's light under even light, over the mean.

    Args:
        frames: (N, H, W), N ≥ 2, digital numbers, below saturation.
        dark: of the same sensor.
        source: named in errors.

    Raises:
        DataError: one frame only, another size, or light no brighter than the noise.
    """
    values = np.asarray(frames, dtype=np.float64)
    if values.ndim != 3 or len(values) < 2:
        raise DataError(source, "one flat frame", "two or more, to tell noise from response", "capture more")
    check_size(source, "frames", values.shape[1:], dark.mean.shape, "use the sensor of the dark")
    above, noise = values.mean(axis=0) - dark.mean, values.std(axis=0, ddof=1)
    good = dark.defects == 0
    level = float(above[good].mean())
    if level < 10 * max(dark.noise, ROUNDING):
        raise DataError(source, f"light of {level:.3g} above the dark", "ten times its noise", "give more light")
    gain, surroundings = above / level, _smooth(above / level, good)
    dead = good & ((gain < _DEAD[0] * surroundings) | (gain > _DEAD[1] * surroundings))
    good &= ~dead
    std = float(np.sqrt((noise[good] ** 2).mean() / len(values))) / level
    varies = float(np.var((gain / surroundings)[good])) - std**2
    return FlatField(
        gain, level, float(np.sqrt(max(varies, 0.0))), std, np.where(dead, DEAD, 0).astype(np.uint8), len(values)
    )


def measure_flats(frames: Sequence[Array], dark: DarkField, *, source: object = "flat") -> FlatField:
    """The response of several buckets, all over one mean.

    Args:
        frames: of every bucket (N, H, W), N ≥ 2, that have all of the light.
        dark: of the same sensor.
        source: named in errors.

    Raises:
        DataError: see ``measure_flat``.
    """
    each = [measure_flat(one, dark.of_bucket(r), source=source) for r, one in enumerate(frames)]
    levels = np.array([field.level for field in each])
    gain = _stacked(each, "gain") * levels[:, None, None] / levels.mean()
    varies, std = (float(np.sqrt((_stacked(each, name) ** 2).mean())) for name in ("nonuniformity", "std"))
    return FlatField(gain, float(levels.mean()), varies, std, _stacked(each, "defects"), min(map(len, frames)))


def _smooth(values: Array, good: NDArray[np.bool_]) -> Array:
    """Least-squares polynomial of fourth order over good pixels: light falls off smoothly, response does not."""
    y, x = (np.linspace(-1, 1, n) for n in values.shape)
    terms = np.stack([np.outer(y**i, x**j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i)])
    coefficients = np.linalg.lstsq(terms[:, good].T, values[good], rcond=None)[0]
    return np.asarray(np.tensordot(coefficients, terms, 1))


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
        read_noise: of the dark frames, electrons; the photon transfer's line at no light is less sure.
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
    def gain_is_known(self) -> bool:
        """Whether the gain is larger than its standard deviation."""
        return self.gain_std < self.gain

    @property
    def full_well(self) -> float:
        """Electrons at saturation; NaN where it was not reached."""
        return self.gain * self.saturation

    def electrons(self, source: object) -> dict[str, float]:
        """Gain, read noise and full well in electrons; NaN, with a warning that names the source, where the gain is not
        known."""
        said = {
            "electrons_per_dn": self.gain,
            "electrons_per_dn_std": self.gain_std,
            "read_noise_electrons": self.read_noise,
            "read_noise_electrons_std": self.read_noise * self.gain_std / self.gain,
            "full_well_electrons": self.full_well,
        }
        if self.gain_is_known:
            return said
        found = f"{self.gain:.3g} ± {self.gain_std:.3g} electrons per digital number"
        remedy = "not known, and not used; give more light, or take more frames"
        warn(f"{source}: {found}: {remedy}", Doubtful, stacklevel=2)
        return dict.fromkeys(said, float("nan"))


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
        DataError: fewer than three exposures below saturation, one frame each, levels that do not grow, or a response
            that is off a line by more than 5 %.
    """
    times, values = np.asarray(exposures, dtype=np.float64), np.asarray(frames, dtype=np.float64)
    if values.ndim != 4 or values.shape[1] < 2 or len(set(times.tolist())) < len(times):
        raise DataError(source, f"frames of shape {values.shape}", "two or more at each of several exposures")
    order = np.argsort(times)
    full = np.zeros(values.shape, bool) if saturated is None else np.asarray(saturated, bool)
    times, values, full = times[order], values[order], full[order]
    good = np.asarray(dark.defects == 0)
    levels = (values - dark.mean)[..., good].mean(axis=-1).mean(axis=1)
    variances = values.var(axis=1, ddof=1)[:, good].mean(axis=1)
    share = np.asarray(full.any(axis=1))[:, good].mean(axis=1)
    saturation = float(levels[share > 0.5].min()) if (share > 0.5).any() else float("nan")
    used = _used(times, levels, share, saturation, source)
    slope, offset = map(float, np.polyfit(times[used], levels[used], 1, w=1 / levels[used]))
    deviations = np.where(used, levels / (offset + slope * times) - 1, np.nan)
    if np.nanmax(np.abs(deviations)) > LARGEST_DEVIATION:
        what = f"a response that is off a line by {np.nanmax(np.abs(deviations)):.1%}"
        remedy = "check the exposures; switch gamma off, keep the lamp steady"
        raise DataError(source, what, f"{LARGEST_DEVIATION:.0%} at most", remedy)
    gain, std = _transfer(levels[used], variances[used], source)
    return Linearity(times, levels, variances, slope, offset, deviations, saturation, gain, std, dark.noise * gain)


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


def _transfer(levels: Array, variances: Array, source: object) -> tuple[float, float]:
    """Electrons per digital number, and its standard deviation."""
    if not (variances > 0).all():
        raise DataError(source, "frames that repeat without any noise", "shot noise", "is it a raw capture?")
    (slope, _), covariance = np.polyfit(levels, variances, 1, w=1 / variances, cov=True)
    if not slope > 0:
        raise DataError(source, "noise that does not grow with the light", "shot noise", "is it a raw capture?")
    return float(1 / slope), float(np.sqrt(covariance[0, 0]) / slope**2)


def mended(values: Array, bad: np.ndarray) -> Array:
    """Values (…, H, W), or (…, R, H, W) of several buckets, bad ones replaced by the median of their neighbours."""
    if bad.ndim == 3:
        return np.stack([mended(values[..., r, :, :], bad[r]) for r in range(len(bad))], axis=-3)
    filled = values.copy()
    border = [(0, 0)] * (values.ndim - 2) + [(1, 1), (1, 1)]
    padded = np.pad(np.where(bad, np.nan, values), border, constant_values=np.nan)
    for y, x in np.argwhere(bad):
        around = padded[..., y : y + 3, x : x + 3].reshape(*values.shape[:-2], 9)
        with np.errstate(all="ignore"):
            filled[..., y, x] = np.nan_to_num(np.nanmedian(around, axis=-1))
    return filled
