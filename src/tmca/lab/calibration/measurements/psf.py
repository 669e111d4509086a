"""Point spread functions over depth and wavelength from captures of a point source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array

_LEAST = 10.0
"""Brightest pixel over the noise, below which no point is seen."""
_BRIGHT = 0.2


@dataclass(frozen=True)
class PsfStack:
    """Cut-outs around a point, background taken off, of unit energy.

    Args:
        values: (D, L, h, w).
        depths: (D,) metres.
        wavelengths: (L,) metres.
        centres: (D, 2) row and column of the middle of each cut-out on the sensor.
        noise: (D, L) standard deviation of a pixel, units of ``values``.
    """

    values: Array
    depths: Array
    wavelengths: Array
    centres: Array
    noise: Array

    @property
    def snr_db(self) -> float:
        """Root mean square of the cut-outs over the noise."""
        return float(20 * np.log10(np.sqrt((self.values**2).mean()) / max(np.sqrt((self.noise**2).mean()), 1e-30)))


def measure_psf(
    frames: ArrayLike,
    depths: ArrayLike,
    wavelengths: ArrayLike,
    window: tuple[int, int] = (31, 31),
    *,
    source: object = "psf",
) -> PsfStack:
    """Cut the point out of every frame: around one middle per depth, the centroid over its wavelengths.

    Args:
        frames: (D, L, H, W) linear digital numbers, dark taken off.
        depths: (D,) of the source, metres.
        wavelengths: (L,) metres.
        window: (h, w) odd, pixels.
        source: named in errors.

    Raises:
        SettingError: an even window, or one as large as the frames.
        DataError: a frame without a point, or a point too near the frame's border.
    """
    values = np.asarray(frames, dtype=np.float64)
    metres, waves = np.asarray(depths, dtype=np.float64), np.asarray(wavelengths, dtype=np.float64)
    if values.shape[:2] != (len(metres), len(waves)) or values.ndim != 4:
        raise SettingError("psf", f"frames of shape {values.shape}", f"({len(metres)}, {len(waves)}, H, W)")
    if any(side % 2 == 0 or not 3 <= side <= n - 4 for side, n in zip(window, values.shape[2:], strict=True)):
        found = f"{window[0]}×{window[1]} in frames of {values.shape[2]}×{values.shape[3]}"
        raise SettingError("window", found, "odd sides, smaller than the frames by 4 pixels or more")
    cut, centres = np.empty((*values.shape[:2], *window)), np.empty((len(metres), 2))
    noise = np.empty(values.shape[:2])
    for depth, stack in enumerate(values):
        place = _middle(stack, f"{source} ({metres[depth]:g} m)")
        centres[depth] = place
        for wave, frame in enumerate(stack):
            where = f"{source} ({metres[depth]:g} m, {waves[wave] * 1e9:g} nm)"
            cut[depth, wave], noise[depth, wave] = _cut(frame, place, window, where)
    return PsfStack(cut, metres, waves, centres, noise)


def _middle(stack: Array, where: str) -> tuple[int, int]:
    """Centroid of what is brighter than a fifth of the peak, over all wavelengths, to whole pixels."""
    found = np.zeros(2)
    for frame in stack:
        above = frame - np.median(frame)
        noise = 1.4826 * float(np.median(np.abs(above))) + 1e-12
        if above.max() < _LEAST * noise:
            what = f"no point (the brightest pixel is {above.max() / noise:.1f} times the noise)"
            raise DataError(where, what, f"{_LEAST:g} times or more", "give more light, or expose for longer")
        weight = np.where(above > _BRIGHT * above.max(), above, 0.0)
        rows, columns = np.indices(frame.shape)
        found += np.array([(weight * rows).sum(), (weight * columns).sum()]) / weight.sum() / len(stack)
    return round(float(found[0])), round(float(found[1]))


def _cut(frame: Array, place: tuple[int, int], window: tuple[int, int], where: str) -> tuple[Array, float]:
    """The cut-out of unit energy, and the standard deviation of its noise."""
    spans = [slice(p - side // 2, p + side // 2 + 1) for p, side in zip(place, window, strict=True)]
    if any(s.start < 0 or s.stop > n for s, n in zip(spans, frame.shape, strict=True)):
        found = f"a point at row {place[0]}, column {place[1]}"
        raise DataError(where, found, f"half a window of {window[0]}×{window[1]} from the border", "move the source")
    outside = np.ones(frame.shape, bool)
    outside[spans[0], spans[1]] = False
    around = frame[outside]
    background = float(np.median(around))
    part = frame[spans[0], spans[1]] - background
    energy = float(part.sum())
    if not energy > 0:
        raise DataError(where, "a point without light", "light above the background", "expose for longer")
    spread = 1.4826 * float(np.median(np.abs(around - background)))
    return part / energy, spread / energy
