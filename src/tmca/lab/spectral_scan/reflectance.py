"""Reflectance of a scan, with its standard deviation; saturated and dark pixels are left out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.data import label, nm_to_metres
from tmca.errors import DataError, SettingError
from tmca.lab.spectral_scan.checks import check_reflectance
from tmca.lab.spectral_scan.scan import Scan
from tmca.lab.spectral_scan.spectra_files import read_spectra

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
REASONS = ("measured", "saturated", "dark")
_DARKEST = 5.0


def measure_reflectance(
    scan: Scan, *, white_reflectance: ArrayLike = 1.0, read_noise: float | None = None, gain: float = 0.0
) -> xr.Dataset:
    """``R = ρ (S - D) / (W - D)`` per pixel and band, and its standard deviation by first-order error propagation.

    ``σ_R² = ρ² [σ_S² + q² σ_W² + (1 - q)² σ_D²] / (W - D)²`` with ``q = (S - D)/(W - D)``: the dark is common to both
    differences. A frame's variance is ``read_noise² + step²/12 + gain (frame - dark)``, that of the mean of n
    independent frames of a wavelength an n-th of it.

    Args:
        scan: the frames.
        white_reflectance: ρ of the white reference, one number or one per band.
        read_noise: standard deviation of a frame, digital numbers; that of the dark frames without it.
        gain: digital numbers per electron, for shot noise; none without it.

    Returns:
        ``reflectance`` and ``reflectance_std`` (wavelength, y, x), NaN where left out; ``quality`` (wavelength, y,
        x): 0 measured, 1 saturated in scene or white, 2 a white that is less than 5 standard deviations above the
        dark.

    Raises:
        SettingError: an impossible noise or reflectance of the white; dark frames of floats without any noise, and none
            given.
        DataError: no pixel is measured, or most are brighter than white can be.
    """
    white = np.broadcast_to(np.asarray(white_reflectance, dtype=np.float64), scan.nm.shape)[:, None, None]
    if not ((white > 0) & (white <= 1.5)).all():
        raise SettingError("white_reflectance", f"{white.min():g} to {white.max():g}", "above 0, near 1")
    floor = _variance(scan, read_noise, gain)
    above, range_ = scan.scene.values - scan.dark, scan.white.values - scan.dark
    counts = (scan.scene_frames, scan.white_frames)
    noise = [
        (floor + gain * np.maximum(light, 0)) / count[:, None, None]
        for light, count in zip((above, range_), counts, strict=True)
    ]
    quality = np.where(range_ <= _DARKEST * np.sqrt(noise[1]), 2, 0).astype(np.uint8)
    quality[scan.scene.saturated | scan.white.saturated] = 1
    if (quality > 0).all():
        raise DataError(scan.source, "no pixel that is neither saturated nor dark", "some", "expose again")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = above / range_
        dark = floor / scan.dark_frames[:, None, None]
        std = white * np.sqrt(noise[0] + ratio**2 * noise[1] + (1 - ratio) ** 2 * dark) / np.abs(range_)
    check_reflectance(white * ratio, quality == 0, scan.source)
    return _labelled(scan, white * ratio, std, quality)


def _variance(scan: Scan, read_noise: float | None, gain: float) -> float:
    """Of a frame without light; that of the dark frames where no ``read_noise`` is given."""
    for name, value in (("read_noise", read_noise), ("gain", gain)):
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise SettingError(name, repr(value), "a number from 0 up")
    own = scan.read_noise if read_noise is None else read_noise
    floor = own**2 + scan.scene.step**2 / 12
    if read_noise is None and not floor:
        raise SettingError("read_noise", "none in the dark frames", "that of a frame (--read-noise)")
    return float(floor)


def white_of(given: str, nm: Array) -> Array:
    """Reflectance of a white reference per band: a number, or the first spectrum of a file of `read_spectra`.

    Raises:
        SettingError: neither a number nor a file.
        DataError: a file that is no spectrum, or does not cover the bands.
    """
    if Path(given).is_file():
        return np.asarray(read_spectra(given).at(nm)[0])
    try:
        return np.full(nm.shape, float(given))
    except ValueError:
        raise SettingError("white_reflectance", repr(given), "a number or a file of its spectrum") from None


def _labelled(scan: Scan, values: Array, std: Array, quality: NDArray[np.uint8]) -> xr.Dataset:
    import xarray as xr

    good = quality == 0
    cubes = [np.where(good, cube, np.nan).astype(np.float32) for cube in (values, std)]
    metres, about = nm_to_metres(scan.nm), {"long_name": "reflectance"}
    reflectance, spread = label(cubes[0], metres, about), label(cubes[1], metres, about)
    reasons = {"reasons": ", ".join(f"{i} {name}" for i, name in enumerate(REASONS))}
    counts = {f"{name}_pixels": int((quality == i).sum()) for i, name in enumerate(REASONS) if i}
    flags = (("wavelength", "y", "x"), quality, reasons)
    cubes_by_name = {"reflectance": reflectance, "reflectance_std": spread, "quality": flags}
    return xr.Dataset(cubes_by_name, attrs={"source": str(scan.source), **counts})
