"""Spectra by scanning: scene, dark and white frames made into reflectance with its standard deviation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tmca.data import label, metres_to_nm, nm_to_metres
from tmca.errors import DataError, SettingError, check_range
from tmca.lab.frames import Frames, check_saturation, check_size, named, read_frames
from tmca.lab.ground_truth.spectra import read_spectra
from tmca.lab.importing import dark_noise

if TYPE_CHECKING:
    import xarray as xr


Array = NDArray[np.float64]
_DARKEST = 5.0
"""Standard deviations of a pixel's noise by which a white has to be brighter than the dark, at its median."""
_SATURATED = 0.5


def _check_alike(scene: Frames, others: Sequence[Frames]) -> None:
    """Raises DataError unless all have frames of one size and one type."""
    for other in others:
        check_size(other.source, "frames", other.values.shape[1:], scene.values.shape[1:], "capture them as the scene")
        if other.kind != scene.kind:
            found, remedy = f"digital numbers of type {other.kind}", "save all with the same settings"
            raise DataError(other.source, found, f"{scene.kind} as the scene's", remedy)


_NM = re.compile(r"(\d+(?:\.\d+)?) ?nm(?![a-z])", re.IGNORECASE)
_SAME = 0.5
"""Nanometres by which a wavelength may differ from the one asked for."""


@dataclass(frozen=True)
class Scan:
    """Scene and white ``(L, H, W)``, dark ``(L, H, W)`` or ``(1, H, W)``, in digital numbers; ``nm`` ``(L,)``.

    ``scene_frames``, ``white_frames`` ``(L,)`` and ``dark_frames`` ``(L,)`` or ``(1,)`` were averaged into each band;
    ``read_noise`` is what the dark ones say of a frame's: what differs from one to the next (one per wavelength: but
    for its mean), of a single one what differs between neighbouring pixels, where fixed patterns count too."""

    source: Path
    nm: NDArray[np.float64]
    scene: Frames
    white: Frames
    dark: NDArray[np.float64]
    scene_frames: NDArray[np.int_]
    white_frames: NDArray[np.int_]
    dark_frames: NDArray[np.int_]
    read_noise: float


def read_scan(
    scene: str | Path,
    dark: str | Path,
    white: str | Path,
    *,
    wavelengths: Sequence[float] | None = None,
    saturation: float | None = None,
) -> Scan:
    """Read a scan: one frame or more per wavelength of the scene and of a white reference, and dark frames.

    File names say the wavelength (``scene_450nm.png``, again as ``scene_450nm_r1.png``); frames without it, and those
    of a stack, count in order and need ``wavelengths``. Frames of one wavelength are averaged, and a pixel that is
    saturated in one of them is. Dark frames with wavelengths in their names are taken band by band, others all
    together.

    Args:
        scene, dark, white: folders of frames or stacks, see `tmca.lab.frames.read_frames`.
        wavelengths: asked for, metres, ascending.
        saturation: see `tmca.lab.frames.read_frames`.

    Raises:
        DataError: missing frames, other wavelengths than those asked for or than the scene's, other sizes or types, or
            a scene or white that is mostly saturated.
        SettingError: frames of unknown wavelength and none given.
    """
    asked = None if wavelengths is None else np.asarray(metres_to_nm(np.asarray(wavelengths)))
    if asked is not None and (not asked.size or (np.diff(asked) <= 0).any()):
        raise SettingError("wavelengths", f"{asked.size} that do not ascend", "ascending wavelengths")
    taken, bright, black = (read_frames(path, saturation) for path in (scene, white, dark))
    _check_alike(taken, (bright, black))
    frames, nm, of_scene = _bands(taken, asked)
    whites, _, of_white = _bands(bright, nm)
    below, count, noise = _dark(black, nm)
    for part in (frames, whites):
        check_saturation(part, _SATURATED)
    return Scan(Path(scene), nm, frames, whites, below, of_scene, of_white, count, noise)


def _bands(frames: Frames, asked: NDArray[np.float64] | None) -> tuple[Frames, NDArray[np.float64], NDArray[np.int_]]:
    """A frame per wavelength, the wavelengths, which are those asked for, and how many frames were averaged."""
    if any(map(_NM.search, frames.names)):
        nm = np.array([key[0] for key in named(frames, _NM, "scene_450nm")])
    elif asked is None:
        found = f"none for {frames.source}, whose frames have none in their names"
        raise SettingError("wavelengths", found, "one per frame (--wavelengths)")
    elif asked.size != len(frames.names):
        raise DataError(frames.source, f"{len(frames.names)} frames", f"{asked.size}, one per wavelength")
    else:
        nm = asked
    bands = np.unique(nm) if asked is None else asked
    nearest = np.abs(nm[:, None] - bands).argmin(axis=1)
    far = np.abs(nm - bands[nearest]) > _SAME
    gone = np.setdiff1d(np.arange(bands.size), nearest[~far])
    if far.any() or gone.size:
        parts = [f"no frame at {bands[gone[0]]:g} nm"] if gone.size else []
        parts += [f"frames at {nm[far][0]:g} nm"] if far.any() else []
        expected = f"the {bands.size} wavelengths asked for, {bands[0]:g} to {bands[-1]:g} nm"
        raise DataError(frames.source, " and ".join(parts), expected, "capture them, or ask for others (--wavelengths)")
    return _averaged(frames, nearest), bands, np.bincount(nearest)


def _averaged(frames: Frames, band: NDArray[np.intp]) -> Frames:
    """The mean of each band's frames, saturated where one of them is; ``band`` (N,) is the band of every frame."""
    members = [np.flatnonzero(band == i) for i in range(band.max() + 1)]
    values = np.stack([frames.values[i].mean(axis=0, dtype=np.float64) for i in members]).astype(np.float32)
    saturated = np.stack([frames.saturated[i].any(axis=0) for i in members])
    return replace(frames, names=tuple(frames.names[i[0]] for i in members), values=values, saturated=saturated)


def _dark(frames: Frames, nm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int_], float]:
    """Dark frames, how many were averaged, and the noise of one."""
    if frames.saturated.mean() > 0.01:
        found = f"{frames.saturated.mean():.0%} of the dark pixels saturated"
        raise DataError(frames.source, found, "dark frames", "cover the lens")
    if all(_NM.search(name) for name in frames.names) and len(frames.names) > 1 and nm.size > 1:
        averaged, _, counts = _bands(frames, nm)
        dark = averaged.values.astype(np.float64)
        spread = np.diff(dark, axis=0).std(axis=(1, 2)) / np.sqrt(1 / counts[1:] + 1 / counts[:-1])
        return dark, counts, float(np.median(spread))
    mean, count = frames.values.mean(axis=0, dtype=np.float64)[None], len(frames.names)
    noise = float(np.sqrt(frames.values.var(axis=0, ddof=1).mean())) if count > 1 else 0.0
    return mean, np.array([count]), noise or dark_noise(frames.values[0])


REASONS = ("measured", "saturated", "dark")


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
        DataError: no pixel is measured.
    """
    white = np.broadcast_to(np.asarray(white_reflectance, dtype=np.float64), scan.nm.shape)[:, None, None]
    if not ((white > 0) & (white <= 1.5)).all():
        raise SettingError("white_reflectance", f"{white.min():g} to {white.max():g}", "above 0, near 1")
    floor = _variance(scan, read_noise, gain)
    above, range_ = scan.scene.values - scan.dark, scan.white.values - scan.dark
    noise = [
        (floor + gain * np.maximum(light, 0)) / count[:, None, None]
        for light, count in ((above, scan.scene_frames), (range_, scan.white_frames))
    ]
    quality = np.where(range_ <= _DARKEST * np.sqrt(noise[1]), 2, 0).astype(np.uint8)
    quality[scan.scene.saturated | scan.white.saturated] = 1
    if (quality > 0).all():
        raise DataError(scan.source, "no pixel that is neither saturated nor dark", "some", "expose again")
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = above / range_
        dark = floor / scan.dark_frames[:, None, None]
        std = white * np.sqrt(noise[0] + ratio**2 * noise[1] + (1 - ratio) ** 2 * dark) / np.abs(range_)
    return _labelled(scan, white * ratio, std, quality)


def _variance(scan: Scan, read_noise: float | None, gain: float) -> float:
    """Of a frame without light; that of the dark frames where no ``read_noise`` is given."""
    for name, value in (("read_noise", read_noise), ("gain", gain)):
        if value is not None:
            check_range(name, value, 0)
    sigma = scan.read_noise if read_noise is None else read_noise
    floor = sigma**2 + scan.scene.step**2 / 12
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
    metres = nm_to_metres(scan.nm)
    reflectance, spread = (
        label(cube, metres, {"long_name": meaning})
        for cube, meaning in zip(cubes, ("reflectance", "standard deviation of the reflectance"), strict=True)
    )
    reasons = {"reasons": ", ".join(f"{i} {name}" for i, name in enumerate(REASONS))}
    reasons["long_name"] = "why a value is unknown"
    counts = {f"{name}_pixels": int((quality == i).sum()) for i, name in enumerate(REASONS) if i}
    flags = (("wavelength", "y", "x"), quality, reasons)
    cubes_by_name = {"reflectance": reflectance, "reflectance_std": spread, "quality": flags}
    return xr.Dataset(cubes_by_name, attrs={"source": str(scan.source), **counts})
