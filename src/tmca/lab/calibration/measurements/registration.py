"""Where every mask pixel falls on the sensor: an affine map, from patterns that were shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.closed_light import closed_light
from tmca.lab.calibration.measurements.coarse import find_coarse
from tmca.lab.calibration.measurements.limits import beyond
from tmca.lab.calibration.measurements.open_light import coded_shares
from tmca.lab.calibration.measurements.pattern_image import SAMPLES, mapped, seen_patterns

LARGEST_RESIDUAL = 0.2
"""Share of a pattern's contrast that the fit may leave beside noise: of another pattern it leaves a half."""
_LARGEST_NOISE = 0.4
"""Share of a pattern's contrast that is put down to noise at most: beside it another pattern still leaves 0.3."""
_ORDER = "are the frames in the order of the patterns, and the patterns those that were shown"
_LEVELS = (3.0, 1.5, 0.0)
"""Blur under which the fit begins, sensor pixels: a rotation moves corners by more than a mask pixel."""
LARGEST_STD = 0.25
"""Sensor pixels by which the mask's corners may be uncertain, as much as displacements against it may be off."""
_SCALE = 0.06
"""Share by which the scale may be another than was said, to the nearest hundredth: the search goes no further."""


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

    def offset(self, other: ArrayLike) -> float:
        """Root mean square distance from another map over all mask pixels, sensor pixels."""
        rows, columns = (np.arange(n) for n in self.codes)
        own = mapped(self.matrix, rows[:, None], columns)
        theirs = mapped(np.asarray(other), rows[:, None], columns)
        return float(np.sqrt(sum(((a - b) ** 2).mean() for a, b in zip(own, theirs, strict=True))))


def nominal_matrix(codes: tuple[int, int], sensor: tuple[int, int], scale: float = 1.0) -> Array:
    """The (2, 3) map that lays the middle of the mask on the middle of the sensor, unturned."""
    middles = [((s - 1) / 2, (c - 1) / 2) for s, c in zip(sensor, codes, strict=True)]
    return np.hstack([scale * np.eye(2), [[s - scale * c] for s, c in middles]])


def register(
    frames: ArrayLike,
    patterns: ArrayLike,
    *,
    scale: float = 1.0,
    start: ArrayLike | None = None,
    wavelength: float | None = None,
    above_dark: bool = False,
    names: Sequence[str] | None = None,
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
        names: of the frames, for errors.
        source: named in errors.

    Raises:
        DataError: no open or dark pattern, patterns that are not seen or not in the order of the frames, a fit that
            leaves more than a fifth of a pattern's contrast beside noise or the place of the mask's corners uncertain,
            or another scale.
        SettingError: an impossible scale.
    """
    if not 0 < scale < np.inf:
        raise SettingError("--scale", f"{scale:g}", "sensor pixels per mask pixel, above 0")
    scale = scale if start is None else _scale(np.asarray(start))
    shares, lit, noise, coded = coded_shares(frames, patterns, scale=scale, names=names, source=source)
    shown = _coded(np.asarray(patterns, dtype=np.float64))
    found = find_coarse(shares, shown, lit, scale, source) if start is None else np.asarray(start, dtype=np.float64)
    values: Any = None
    for level in _LEVELS:
        found, values = _fitted(shares, shown, lit, found, level)
    std, residual = _spread(values, shown.shape[1:]), float(np.sqrt(np.mean(values.fun**2)))
    contrast = 2 * float(np.std(shares[:, lit]))
    size = (int(shares.shape[1]), int(shares.shape[2]))
    codes = (int(shown.shape[1]), int(shown.shape[2]))
    leakage = _leakage(frames, patterns, lit) if above_dark else (None, None)
    blur = abs(float(values.x[6]))
    registered = Registration(found, std, blur, residual / contrast, codes, size, wavelength, *leakage)
    _check_each(values.fun, shares[:, lit], noise, coded, source)
    _check(registered, scale, source)
    return registered


def _check_each(left: Array, shares: Array, noise: float, names: Sequence[str], source: object) -> None:
    """Raises DataError where the fit leaves (P' · N) too much of a coded pattern's shares (P', N) beside noise."""
    contrast = 2 * shares.std(axis=1)
    power = (left.reshape(shares.shape) ** 2).mean(axis=1) - np.minimum(noise, _LARGEST_NOISE * contrast) ** 2
    nothing = np.ones_like(contrast)  # a frame without contrast explains no pattern
    unexplained = np.divide(np.sqrt(np.maximum(power, 0.0)), contrast, out=nothing, where=contrast > 0)
    worst = int(unexplained.argmax())
    if unexplained[worst] > LARGEST_RESIDUAL:
        share = beyond(float(unexplained[worst]), "%")
        what = f"a fit that leaves {share} of the contrast of frame {names[worst]} beside noise"
        raise DataError(
            source, what, f"{LARGEST_RESIDUAL:.0%} at most", f"{_ORDER}, and is there light and focus enough?"
        )


def _check(found: Registration, scale: float, source: object) -> None:
    """Raises DataError for a map that the frames do not tell, or of another scale."""
    if not found.edge_std <= LARGEST_STD:
        what = f"a fit that leaves the mask's corners uncertain by {beyond(found.edge_std, 'pixels')}"
        raise DataError(source, what, f"{LARGEST_STD:g} at most", f"give more light; {_ORDER}?")
    if abs(found.scale / scale - 1) > _SCALE + 0.005:
        what = f"{found.scale:.3g} sensor pixels per mask pixel"
        raise DataError(source, what, f"{scale:.3g}, to {_SCALE:.0%}", f"check --scale; {_ORDER}?")


def _scale(matrix: Array) -> float:
    """Sensor pixels per mask pixel of a map, the mean over directions."""
    return float(np.sqrt(abs(np.linalg.det(matrix[:, :2]))))


def _coded(patterns: Array) -> Array:
    """The patterns that are neither open nor dark."""
    mean = patterns.mean(axis=(1, 2))
    return np.asarray(patterns[(mean > 0) & (mean < 1)])


def _leakage(frames: ArrayLike, patterns: ArrayLike, lit: np.ndarray) -> tuple[float, float]:
    """Through the dark patterns, and its standard deviation."""
    values, mean = np.asarray(frames, dtype=np.float64), np.mean(np.asarray(patterns), axis=(1, 2))
    return closed_light(values[mean == 0].mean(axis=0), values[mean == 1].mean(axis=0), lit)


def _fitted(shares: Array, shown: Array, lit: np.ndarray, start: Array, level: float) -> tuple[Array, Any]:
    """Least squares over six numbers of the map, in pixels at the mask's edge, and the blur."""
    from scipy.optimize import least_squares

    size = (int(shares.shape[1]), int(shares.shape[2]))
    target = _blurred(shares, level)[:, lit]
    own, samples = ([0.3], SAMPLES) if level == 0 else ([], 1)

    def residuals(values: Array) -> Array:
        blur = float(np.hypot(level, values[6])) if own else level
        matrix = _changed(start, values, shown.shape[1:])
        return _left(seen_patterns(shown, matrix, size, blur, samples)[:, lit], target)

    fine = 1e-7 if level == 0 else 1e-4
    found = least_squares(residuals, [0.0] * 6 + own, xtol=fine, ftol=fine, max_nfev=30)
    return _changed(start, found.x, shown.shape[1:]), found


def _blurred(images: Array, level: float) -> Array:
    if level == 0:
        return images
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(images, (0, level, level), mode="nearest"))


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


def _spread(found: Any, codes: tuple[int, ...]) -> Array:
    """(2, 3) standard deviations from the fit's Jacobian: linear part, and shift of the middle."""
    freedom = max(1, found.fun.size - found.x.size)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * float((found.fun**2).sum()) / freedom
    std = np.sqrt(np.diag(covariance))
    middle = np.array([(n - 1) / 2 for n in codes])
    return np.hstack([np.reshape(std[2:6], (2, 2)) / middle, std[:2, None]])
