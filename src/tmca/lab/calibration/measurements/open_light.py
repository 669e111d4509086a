"""Captures of patterns as shares of the open one's light, where the mask is lit; frames that show another pattern."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.limits import beyond

_LIT = 0.3
"""Share of the brightest pixels' light below which a pixel does not count."""
_BRIGHTEST = 0.05
"""Share of the mask's image that the brightest pixels are."""
_ABOVE_NOISE = 6.0
"""Times the noise that a pixel has to change between frames: the range of ten frames of noise is half of it."""
_HALF = 0.5
"""Share of a pixel's light by which a frame has to be beyond that of the open or dark pattern, to be another's: noise
of 20 dB is a tenth."""
_ELSEWHERE = 0.05
"""Share of the lit pixels that may be brighter than through the open pattern, or darker than through the dark one. Of
frames in the order of the patterns none are; a random pattern in the place of either leaves a half."""
_SEEN = 0.2
"""Least share of the mask's image that has to be lit after its edge is taken off: a coded pattern of small blocks, all
of it edges, keeps less than a tenth; a mask of 16 pixels keeps a half, and one half beside the sensor or in shadow as
much."""
_EDGE = 2
"""Pixels that are taken off the edge of what is lit."""


class Shares(NamedTuple):
    """Coded frames as shares of the open one's light.

    Args:
        values: (P', H, W), 0 where no light is.
        lit: (H, W) pixels that count.
        noise: rms of the values there, from the scatter of the frame that has least.
        names: (P') of the frames.
    """

    values: Array
    lit: np.ndarray
    noise: float
    names: list[str]


def coded_shares(
    frames: ArrayLike,
    patterns: ArrayLike,
    *,
    scale: float = 1.0,
    names: Sequence[str] | None = None,
    source: object = "registration",
) -> Shares:
    """Share of the open frame's light in the frames of coded patterns, where the mask is lit.

    Args:
        frames: (P, H, W) linear digital numbers, one for each pattern, in their order.
        patterns: (P, h, w) of zeros and ones; one all open and one all dark among them.
        scale: sensor pixels per mask pixel.
        names: of the frames, for errors.
        source: named in errors.

    Raises:
        DataError: another number of frames, no open, dark or coded pattern, no light, a frame that is brighter than
            the open pattern's or darker than the dark one's, or light on a small part of the mask only.
    """
    values, shown = np.asarray(frames, dtype=np.float64), np.asarray(patterns, dtype=np.float64)
    if len(values) != len(shown):
        raise DataError(source, f"{len(values)} frames", f"{len(shown)}, one for each pattern", "capture them again")
    mean = shown.mean(axis=(1, 2))
    kinds = {"all open": mean == 1, "all dark": mean == 0, "coded": (mean > 0) & (mean < 1)}
    for name, kind in kinds.items():
        if not kind.any():
            raise DataError(source, f"no pattern that is {name}", "one", "show tmca calibrate patterns")
    dark, light = values[kinds["all dark"]].mean(axis=0), values[kinds["all open"]].mean(axis=0)
    image = _image(scale, shown.shape[1:], dark.shape)
    noise = float(np.median(np.abs(np.diff(values, axis=-1)), axis=(1, 2)).min()) + 1e-12
    lit = _lit(light - dark, image, noise, source)
    names = names or [str(n) for n in range(len(values))]
    coded = [names[int(n)] for n in np.flatnonzero(kinds["coded"])]
    swing = np.ptp(values, axis=0)
    seen = _seen(swing, image, _ABOVE_NOISE * noise)
    _check_shown(values[kinds["coded"]], (dark, light), swing, seen, coded, source)
    lit = _inside(lit, image, source)
    above = np.where(lit, light - dark, 1.0)
    shares = np.where(lit, (values[kinds["coded"]] - dark) / above, 0.0)
    # of Gaussian noise the median difference of neighbours is 0.954 times it; frame and ends have 2 of its variances
    return Shares(shares, lit, float(np.sqrt(2 * np.mean(above[lit] ** -2)) * noise / 0.954), coded)


def _image(scale: float, codes: tuple[int, ...], sensor: tuple[int, ...]) -> float:
    """Share of the sensor that the mask's image takes, at most."""
    return float(np.prod([min(scale * n, size) / size for n, size in zip(codes, sensor, strict=True)]))


def _seen(light: Array, image: float, floor: float) -> np.ndarray:
    """(H, W) pixels above a floor whose light is not far below that of the brightest of the mask's image."""
    from scipy.ndimage import median_filter

    brightest = np.percentile(median_filter(light, 3), 100 * (1 - _BRIGHTEST * image))
    return np.asarray(light > max(floor, _LIT * brightest))


def _lit(above: Array, image: float, noise: float, source: object) -> np.ndarray:
    """(H, W) pixels that the open pattern lights; DataError where it is no brighter than the dark one."""
    lit = _seen(above, image, _ABOVE_NOISE / 2 * noise)
    if not lit.any() or np.median(above[lit]) < 5 * noise or lit.mean() < 0.02 * image:
        remedy = "give more light; are the frames in the order of the patterns?"
        raise DataError(source, "an open pattern that is no brighter than the dark one", "light", remedy)
    return lit


def _check_shown(
    coded: Array, ends: tuple[Array, Array], swing: Array, seen: np.ndarray, names: Sequence[str], source: object
) -> None:
    """Raises DataError for a coded frame that is brighter than the open one, or darker than the dark one."""
    count = max(1, int(seen.sum()))
    for name, frame in zip(names, coded, strict=True):
        above, below = frame - ends[1], ends[0] - frame
        for how, beside in (("brighter than the open pattern's", above), ("darker than the dark pattern's", below)):
            share = float(((beside > _HALF * swing) & seen).sum() / count)
            if share > _ELSEWHERE:
                found = f"frame {name} {how} on {beyond(share, '%')} of the lit pixels"
                raise DataError(
                    source, found, f"{_ELSEWHERE:.0%} at most", "put the frames in the order of the patterns"
                )


def _inside(lit: np.ndarray, image: float, source: object) -> np.ndarray:
    """Lit pixels without their edge; DataError where they are a small part of the mask's image."""
    from scipy.ndimage import binary_erosion

    inner = np.asarray(binary_erosion(lit, iterations=_EDGE))
    share = float(inner.mean() / image)
    if share < _SEEN:
        order = "are the frames in the order of the patterns, and is --scale right?"
        found = f"an open pattern that lights {share:.1%} of the mask's image evenly"
        raise DataError(
            source, found, f"{_SEEN:.0%} or more", f"light the whole mask, nothing brighter beside it; {order}"
        )
    return inner
