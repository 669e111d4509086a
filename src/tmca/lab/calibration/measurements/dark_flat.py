"""Dark and flat fields of a sensor: offset, read noise, hot and dead pixels, and each pixel's response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.errors import DataError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.limits import beyond

HOT, DEAD = 1, 2
"""Values of ``defects``: hot or noisy in the dark, and of a response far from the others'."""
ROUNDING = 0.3
"""Digital numbers of noise that rounding makes of none."""
_OUTLIER = 8.0
_DEAD = (0.5, 1.5)
_ORDER = 4
_BRIGHT = 0.25
"""Share of saturation above which frames are no dark ones."""
_NOISY = 0.05
"""Share of saturation above which dark frames differ by more than read noise: no flat field below saturation would be
ten times as bright."""
_DRIFT = 10.0
"""Noise of a pixel by which the levels of dark frames may differ: those of a sensor that warms up do so by a few."""
_UNSTEADY, _MANY = 0.2, 0.05
"""Shares beyond which frames are no flat field: noise of a pixel over the level, and dead pixels."""


@dataclass(frozen=True)
class DarkField:
    """Digital numbers.

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


@dataclass(frozen=True)
class FlatField:
    """Response to even light.

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


def measure_dark(frames: ArrayLike, *, top: float = np.inf, source: object = "dark") -> DarkField:
    """Mean and standard deviation of every pixel of frames without light.

    Args:
        frames: (N, H, W), N ≥ 2, digital numbers.
        top: value of a saturated pixel.
        source: named in errors.

    Raises:
        DataError: fewer than two frames, more than a tenth of the pixels hot, or a level above a quarter of saturation:
            light came in.
    """
    values = np.asarray(frames, dtype=np.float64)
    if values.ndim != 3 or len(values) < 2:
        found = f"{len(values) if values.ndim == 3 else 1} dark frame"
        raise DataError(source, found, "two or more, for the read noise", "capture more")
    mean, noise = values.mean(axis=0), values.std(axis=0, ddof=1)
    if np.median(mean) > _BRIGHT * top:
        found, known = f"a level of {np.median(mean):.4g} without light", f"{_BRIGHT:.0%} of {top:g} at most"
        raise DataError(source, found, known, "cover the lens; give --saturation where the sensor's top is another")
    _check_dark(values, noise, top, source)
    hot = _far(mean, values.shape[0]) | (_far(noise, values.shape[0]) & (noise > np.median(noise)))
    if hot.mean() > 0.1:
        raise DataError(source, f"{hot.mean():.0%} hot pixels", "10% at most", "cover the lens; even light is no dark")
    return DarkField(mean, noise, np.where(hot, HOT, 0).astype(np.uint8), len(values))


def _check_dark(values: Array, noise: Array, top: float, source: object) -> None:
    """Raises DataError for frames of changing light: with more noise than any sensor has, or unlike one another."""
    own = float(np.sqrt((noise**2).mean()))
    remedy = "cover the lens in every frame; check that no other captures are among them"
    if own > _NOISY * top:
        found = f"frames that differ by {beyond(own / top, '%')} of saturation"
        raise DataError(source, found, f"read noise, {_NOISY:.0%} at most", remedy)
    levels = values.mean(axis=(1, 2))
    alone = (values - levels[:, None, None]).std(axis=0, ddof=1)
    drift, alike = float(levels.std(ddof=1)), max(float(np.sqrt((alone**2).mean())), ROUNDING)
    if drift > _DRIFT * alike:
        found = f"frames whose levels differ by {drift:.3g}, {drift / alike:.3g} times the noise of a pixel"
        raise DataError(source, found, f"{_DRIFT:g} times at most", remedy)


def _far(values: Array, frames: int) -> NDArray[np.bool_]:
    """Values many robust deviations from the median; of sample deviations, whose own spread has long tails, of more."""
    middle = np.median(values)
    spread = 1.4826 * np.median(np.abs(values - middle)) + 0.5 / np.sqrt(12 * frames)
    return np.asarray(np.abs(values - middle) > _OUTLIER * spread * (1 + 4 / frames))


def measure_flat(frames: ArrayLike, dark: DarkField, *, source: object = "flat") -> FlatField:
    """Every pixel's light under even light, over the mean.

    Args:
        frames: (N, H, W), N ≥ 2, digital numbers, below saturation.
        dark: of the same sensor.
        source: named in errors.

    Raises:
        DataError: one frame only, another size, light no brighter than the noise, or light that is uneven or changes.
    """
    values = np.asarray(frames, dtype=np.float64)
    if values.ndim != 3 or len(values) < 2:
        raise DataError(source, "one flat frame", "two or more, to tell noise from response", "capture more")
    if values.shape[1:] != dark.mean.shape:
        found, known = ("×".join(map(str, shape)) for shape in (values.shape[1:], dark.mean.shape))
        raise DataError(source, f"frames of {found} pixels", f"{known} as the dark", "use one sensor")
    above, noise = values.mean(axis=0) - dark.mean, values.std(axis=0, ddof=1)
    good = dark.defects == 0
    level = float(above[good].mean())
    if level < 10 * max(dark.noise, ROUNDING):
        raise DataError(source, f"light of {level:.3g} above the dark", "ten times its noise", "give more light")
    gain, surroundings = above / level, _smooth(above / level, good)
    dead = good & ((gain < _DEAD[0] * surroundings) | (gain > _DEAD[1] * surroundings))
    good &= ~dead
    std = float(np.sqrt((noise[good] ** 2).mean() / len(values))) / level
    _check_even(std * np.sqrt(len(values)), float(dead.mean()), source)
    varies = float(np.var((gain / surroundings)[good])) - std**2
    return FlatField(
        gain, level, float(np.sqrt(max(varies, 0.0))), std, np.where(dead, DEAD, 0).astype(np.uint8), len(values)
    )


def check_steady(noise: float, source: object) -> None:
    """Raises DataError where light changes from frame to frame: ``noise`` of a pixel, as a share of the level."""
    if noise > _UNSTEADY:
        found = f"light that differs by {beyond(noise, '%')} from frame to frame"
        raise DataError(source, found, f"{_UNSTEADY:.0%} at most", "capture the same even light in every frame")


def _check_even(noise: float, dead: float, source: object) -> None:
    """Raises DataError where light changes from frame to frame, or within one by more than a smooth fall."""
    check_steady(noise, source)
    if dead > _MANY:
        found = f"light far from even on {dead:.0%} of the pixels"
        raise DataError(source, found, f"dead pixels on {_MANY:.0%} at most", "light the sensor evenly, out of focus")


def _smooth(values: Array, good: NDArray[np.bool_]) -> Array:
    """Least-squares polynomial of fourth order over good pixels: light falls off smoothly, response does not."""
    y, x = (np.linspace(-1, 1, n) for n in values.shape)
    terms = np.stack([np.outer(y**i, x**j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i)])
    found = np.linalg.lstsq(terms[:, good].T, values[good], rcond=None)[0]
    return np.asarray(np.tensordot(found, terms, 1))
