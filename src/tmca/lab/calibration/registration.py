"""Where every mask pixel falls on the sensor: an affine map, from patterns that were shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.fitting import fit_std, robust_std
from tmca.lab.calibration.pattern_image import SAMPLES, centred, find_coarse, mapped, seen_patterns
from tmca.lab.frames import Array


def closed_light(dark: Array, light: Array, lit: np.ndarray) -> tuple[float, float]:
    """Light of the dark pattern over that of the open one: ``1/contrast ratio``, and its standard deviation.

    The share that leaves the least absolute deviations ``|dark - share · light|`` over lit pixels: the median of their
    ratios, weighted by the light. Unlike a mean it stays where hot pixels, or noise cut off at zero, have one side
    only. Stray light that does not pass the mask cannot be told from light that does.

    Args:
        dark, light: (H, W) captures of the dark and the open pattern, linear, without the sensor's own dark.
        lit: (H, W) pixels that count.

    Returns:
        The share, below 0 where there is more noise than light, and its standard deviation from the pixels' scatter.
    """
    seen, whole = dark[lit], light[lit]
    order = np.argsort(seen / whole)
    below = np.cumsum(whole[order])
    middle = order[np.searchsorted(below, below[-1] / 2)]
    share = float(seen[middle] / whole[middle])
    scatter = robust_std(seen - share * whole)
    # a median varies by the root of π/2 more than a mean
    return share, float(np.sqrt(np.pi / 2)) * scatter / float(np.sqrt(whole @ whole))


_LIT = 0.3
"""Share of the brightest pixels' light below which a pixel does not count."""
_BRIGHTEST = 0.05
"""Share of the mask's image that the brightest pixels are."""
_ABOVE_NOISE = 3.0
_EDGE = 2
"""Pixels that are taken off the edge of what is lit."""


class _Shares(NamedTuple):
    """Frames of coded patterns as shares of the open one's light.

    Args:
        values: (P', H, W), 0 where no light is.
        shown: (P', h, w) the coded patterns.
        lit: (H, W) pixels that count.
        dark, light: (H, W) frames of the dark and the open pattern.
    """

    values: Array
    shown: Array
    lit: np.ndarray
    dark: Array
    light: Array


def _shares(frames: ArrayLike, patterns: ArrayLike, scale: float, source: object) -> _Shares:
    """Share of the open frame's light in the frames of coded patterns, where the mask is lit; errors as of
    ``register``."""
    values, shown = np.asarray(frames, dtype=np.float64), np.asarray(patterns, dtype=np.float64)
    if len(values) != len(shown):
        remedy = "capture them in the order of the patterns"
        raise DataError(source, f"{len(values)} frames", f"{len(shown)}, one for each pattern", remedy)
    mean = shown.mean(axis=(1, 2))
    coded = (mean > 0) & (mean < 1)
    for name, kind in {"all open": mean == 1, "all dark": mean == 0, "coded": coded}.items():
        if not kind.any():
            raise DataError(source, f"no pattern that is {name}", "one", "show tmca calibrate patterns")
    dark, light = values[mean == 0].mean(axis=0), values[mean == 1].mean(axis=0)
    image = float(np.prod([min(scale * n, size) / size for n, size in zip(shown.shape[1:], dark.shape, strict=True)]))
    noise = float(np.median(np.abs(np.diff(values, axis=-1)), axis=(1, 2)).min()) + 1e-12
    lit = _lit(light - dark, image, noise, source)
    above = np.where(lit, light - dark, 1.0)
    shares = np.where(lit, (values[coded] - dark) / above, 0.0)
    return _Shares(shares, shown[coded], lit, dark, light)


def _lit(above: Array, image: float, noise: float, source: object) -> np.ndarray:
    """(H, W) pixels that the open pattern lights, without their edge; DataError where there is no light on the mask's
    image, which is a share of the sensor."""
    from scipy.ndimage import binary_erosion, median_filter

    brightest = np.percentile(median_filter(above, 3), 100 * (1 - _BRIGHTEST * image))
    lit = above > max(_ABOVE_NOISE * noise, _LIT * brightest)
    inner = np.asarray(binary_erosion(lit, iterations=_EDGE))
    if not inner.any() or np.median(above[lit]) < 5 * noise or lit.mean() < 0.02 * image:
        remedy = "give more light; are the frames in the order of the patterns?"
        raise DataError(source, "an open pattern that is no brighter than the dark one", "light", remedy)
    return inner


LARGEST_RESIDUAL = 0.4
"""Share of the patterns' contrast that the fit may leave: of other patterns it leaves a half."""
_LEVELS = (3.0, 1.5, 0.0)
"""Blur under which the fit begins, sensor pixels: a rotation moves corners by more than a mask pixel."""
LARGEST_STD = 0.25
"""Sensor pixels by which the mask's corners may be uncertain, as much as displacements against it may be off."""


@dataclass(frozen=True)
class Registration:
    """Code pixel (i, j) falls on sensor pixel ``matrix @ (i, j, 1)``.

    Args:
        matrix: (2, 3), rows first.
        std: (2, 3) standard deviations of the shift of the middle (last column) and of the linear part, from the fit.
        blur: standard deviation of the relay's blur, sensor pixels.
        residual: rms of what the fit leaves, as a share of the patterns' contrast.
        codes, sensor: (rows, columns) of mask and sensor.
        wavelength: of the light, metres; None if it was not said.
        leakage: share of the light that closed mask pixels pass, 1/contrast ratio; below 0 by noise, None if the
            sensor's dark was not known.
        leakage_std: its standard deviation, from the pixels' scatter.
    """

    matrix: Array
    std: Array
    blur: float
    residual: float
    codes: tuple[int, int]
    sensor: tuple[int, int]
    wavelength: float | None = None
    leakage: float | None = None
    leakage_std: float | None = None

    @property
    def closed_light(self) -> float:
        """The leakage as it is applied: 0 where it is unknown or below."""
        return max(0.0, self.leakage or 0.0)

    @property
    def contrast_ratio(self) -> float:
        """Light of open mask pixels over that of closed ones; infinite where none was measured."""
        return 1 / self.closed_light if self.closed_light else np.inf

    @property
    def scale(self) -> float:
        """Sensor pixels per mask pixel, the mean over directions."""
        return _scale(self.matrix)

    @property
    def edge_std(self) -> float:
        """Standard deviation of the place of the mask's corners, sensor pixels, the worse axis."""
        arm = np.array([(self.codes[0] - 1) / 2, (self.codes[1] - 1) / 2, 1.0])
        return float(np.sqrt(((self.std * arm) ** 2).sum(axis=1)).max())

    def beside(self, drawn: ArrayLike | None) -> dict[str, float]:
        """Sensor pixels by which the middle of the mask lies beside where it was drawn.

        Args:
            drawn: (2, 3) map from code to sensor pixels; without, the distance is that from the sensor's middle.
        """
        middle = [np.array((n - 1) / 2) for n in self.codes]
        wanted = [np.array((n - 1) / 2) for n in self.sensor]
        if drawn is not None:
            wanted = list(mapped(np.asarray(drawn), *middle))
        rows, columns = (float(a - b) for a, b in zip(mapped(self.matrix, *middle), wanted, strict=True))
        where = "from_the_sensor_middle" if drawn is None else "from_where_drawn"
        return {f"rows_{where}": rows, f"columns_{where}": columns}

    def offset(self, other: ArrayLike) -> float:
        """Root mean square distance from another map over all mask pixels, sensor pixels."""
        rows, columns = (np.arange(n) for n in self.codes)
        places = mapped(self.matrix, rows[:, None], columns)
        others = mapped(np.asarray(other), rows[:, None], columns)
        return float(np.sqrt(sum(((a - b) ** 2).mean() for a, b in zip(places, others, strict=True))))


def nominal_matrix(codes: tuple[int, int], sensor: tuple[int, int], scale: float = 1.0) -> Array:
    """The (2, 3) map that lays the middle of the mask on the middle of the sensor, unturned."""
    return centred(scale * np.eye(2), codes, sensor)


def register(
    frames: ArrayLike,
    patterns: ArrayLike,
    *,
    scale: float = 1.0,
    start: ArrayLike | None = None,
    wavelength: float | None = None,
    above_dark: bool = False,
    source: object = "registration",
) -> Registration:
    """Fit the map by least squares of seen patterns, from coarse to fine.

    Args:
        frames: (P, H, W) what the sensor recorded of each pattern, digital numbers, linear.
        patterns: (P, h, w) of zeros and ones; one all open and one all dark among them.
        scale: sensor pixels per mask pixel, to 6 %.
        start: (2, 3) map to begin at, whose scale counts then; searched over shifts, flips and quarter turns without.
        wavelength: of the light, metres.
        above_dark: the frames are without the sensor's dark; then light of the dark pattern is measured as leakage.
        source: named in errors.

    Raises:
        DataError: another number of frames, no open, dark or coded pattern, patterns that are not seen, or a fit that
            leaves more than 0.4 of the patterns' contrast or the place of the mask's corners uncertain.
        SettingError: an impossible scale.
    """
    if not 0 < scale < np.inf:
        raise SettingError("--scale", f"{scale:g}", "sensor pixels per mask pixel, above 0")
    scale = scale if start is None else _scale(np.asarray(start))
    seen = _shares(frames, patterns, scale, source)
    shares, shown, lit = seen.values, seen.shown, seen.lit
    matrix = find_coarse(shares, shown, lit, scale, source) if start is None else np.asarray(start, dtype=np.float64)
    fit: Any = None
    for level in _LEVELS:
        matrix, fit = _fitted(shares, shown, lit, matrix, level)
    leakage = closed_light(seen.dark, seen.light, lit) if above_dark else (None, None)
    residual = float(np.sqrt(np.mean(fit.fun**2))) / (2 * float(np.std(shares[:, lit])))
    codes, sensor = ((int(part.shape[1]), int(part.shape[2])) for part in (shown, shares))
    blur, std, middle = abs(float(fit.x[6])), fit_std(fit), np.array([(n - 1) / 2 for n in codes])
    std = np.hstack([std[2:6].reshape(2, 2) / middle, std[:2, None]])
    registered = Registration(matrix, std, blur, residual, codes, sensor, wavelength, *leakage)
    _check_fit(registered, source)
    return registered


def _check_fit(registered: Registration, source: object) -> None:
    """Raises DataError for a fit that leaves too much of the patterns, or in doubt where the mask is."""
    for what, left, most in (
        ("of the patterns' contrast", registered.residual, LARGEST_RESIDUAL),
        ("pixels of doubt about the mask's corners", registered.edge_std, LARGEST_STD),
    ):
        if not left <= most:
            remedy = "is there light and focus enough, is --scale right, and are frames and patterns in one order?"
            raise DataError(source, f"a fit that leaves {left:.2g} {what}", f"{most:g} at most", remedy)


def _scale(matrix: Array) -> float:
    """Sensor pixels per mask pixel of a map, the mean over directions."""
    return float(np.sqrt(abs(np.linalg.det(matrix[:, :2]))))


def _fitted(shares: Array, shown: Array, lit: np.ndarray, start: Array, level: float) -> tuple[Array, Any]:
    """Least squares over six numbers of the map, in pixels at the mask's edge, and the blur."""
    from scipy.ndimage import gaussian_filter
    from scipy.optimize import least_squares

    size = (int(shares.shape[1]), int(shares.shape[2]))
    target = gaussian_filter(shares, (0, level, level), mode="nearest")[:, lit]
    first_blur, samples = ([0.3], SAMPLES) if level == 0 else ([], 1)
    part = _bounds(lit)

    def residuals(values: Array) -> Array:
        blur = float(np.hypot(level, values[6])) if first_blur else level
        matrix = _changed(start, values, shown.shape[1:])
        return _left(seen_patterns(shown, matrix, size, blur, samples, part)[:, lit[part]], target)

    fine = 1e-7 if level == 0 else 1e-4
    fit = least_squares(residuals, [0.0] * 6 + first_blur, xtol=fine, ftol=fine, max_nfev=30)
    return _changed(start, fit.x, shown.shape[1:]), fit


def _bounds(lit: np.ndarray) -> tuple[slice, slice]:
    """The smallest rectangle of rows and columns that holds all pixels that count."""
    rows, columns = (np.flatnonzero(lit.any(axis=axis)) for axis in (1, 0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _left(seen: Array, target: Array) -> Array:
    """What is left of the target after the best gain and offset of every pattern."""
    low, high = seen.mean(axis=1, keepdims=True), target.mean(axis=1, keepdims=True)
    centred, wanted = seen - low, target - high
    gain = (centred * wanted).sum(axis=1, keepdims=True) / np.maximum((centred**2).sum(axis=1, keepdims=True), 1e-12)
    return np.asarray(wanted - gain * centred).ravel()


def _changed(start: Array, values: Any, codes: tuple[int, ...]) -> Array:
    """The map after a shift (2) and four changes of its linear part, each in sensor pixels at the mask's edge."""
    middle = np.array([(n - 1) / 2 for n in codes])
    linear = start[:, :2] + np.reshape(values[2:6], (2, 2)) / middle
    place = start[:, :2] @ middle + start[:, 2] + np.asarray(values[:2])
    return np.hstack([linear, (place - linear @ middle)[:, None]])
