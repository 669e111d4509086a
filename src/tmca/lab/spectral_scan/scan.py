"""The frames of a spectral scan: scene, dark and white, all there and at the wavelengths asked for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError
from tmca.lab.frames import Frames, read_frames

_NM = re.compile(r"(\d+(?:\.\d+)?) ?nm(?![a-z])", re.IGNORECASE)
_SAME = 0.5
"""Nanometres by which a wavelength may differ from the one asked for."""
_DARKEST = 5.0
_SATURATED = 0.5


@dataclass(frozen=True)
class Scan:
    """Scene and white ``(L, H, W)``, dark ``(L, H, W)`` or ``(1, H, W)``, in digital numbers; ``nm`` ``(L,)``.

    ``scene_frames``, ``white_frames`` ``(L,)`` and ``dark_frames`` ``(L,)`` or ``(1,)`` were averaged into each band;
    ``read_noise`` is what the dark ones say of a frame's (one per wavelength: what differs from one to the next, but
    for its mean), None of a single one.
    """

    source: Path
    nm: NDArray[np.float64]
    scene: Frames
    white: Frames
    dark: NDArray[np.float64]
    scene_frames: NDArray[np.int_]
    white_frames: NDArray[np.int_]
    dark_frames: NDArray[np.int_]
    read_noise: float | None


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
        DataError: missing frames, other wavelengths than those asked for or than the scene's, other sizes, a scene or
            white that is mostly saturated, or a band without light.
        SettingError: frames of unknown wavelength and none given.
    """
    asked = None if wavelengths is None else np.asarray(metres_to_nm(np.asarray(wavelengths)))
    if asked is not None and (not asked.size or (np.diff(asked) <= 0).any()):
        raise SettingError("wavelengths", f"{asked.size} that do not ascend", "ascending wavelengths")
    frames, nm, of_scene = _bands(read_frames(scene, saturation), asked)
    bright, _, of_white = _bands(read_frames(white, saturation), nm)
    black, count, noise = _dark(read_frames(dark, saturation), nm)
    for other, shape in ((bright.source, bright.values.shape[1:]), (dark, black.shape[1:])):
        if shape != frames.values.shape[1:]:
            found, wanted = ("×".join(map(str, size)) for size in (shape, frames.values.shape[1:]))
            raise DataError(other, f"frames of {found} pixels", f"{wanted} as the scene's", "capture them alike")
    scan = Scan(Path(scene), nm, frames, bright, black, of_scene, of_white, count, noise)
    _check_light(scan)
    return scan


def _bands(frames: Frames, asked: NDArray[np.float64] | None) -> tuple[Frames, NDArray[np.float64], NDArray[np.int_]]:
    """A frame per wavelength, the wavelengths, which are those asked for, and how many frames were averaged."""
    found = [_NM.search(name) for name in frames.names]
    if not any(found):
        return _counted(frames, asked)
    nameless = [name for name, match in zip(frames.names, found, strict=True) if not match]
    if nameless:
        remedy = "name it like the others, or keep it in another folder"
        raise DataError(frames.source, f"no wavelength in the name {nameless[0]}", "a name such as scene_450nm", remedy)
    nm = np.array([float(match[1]) for match in found if match])
    bands = np.unique(nm) if asked is None else asked
    nearest = np.abs(nm[:, None] - bands).argmin(axis=1)
    _check_asked(frames.source, nm, bands, nearest)
    return _averaged(frames, nearest), bands, np.bincount(nearest)


def _averaged(frames: Frames, band: NDArray[np.intp]) -> Frames:
    """The mean of each band's frames, saturated where one of them is; ``band`` (N,) is the band of every frame."""
    own = [np.flatnonzero(band == i) for i in range(band.max() + 1)]
    values = np.stack([frames.values[i].mean(axis=0, dtype=np.float64) for i in own]).astype(np.float32)
    saturated = np.stack([frames.saturated[i].any(axis=0) for i in own])
    return Frames(frames.source, tuple(frames.names[i[0]] for i in own), values, saturated, frames.step)


def _counted(frames: Frames, asked: NDArray[np.float64] | None) -> tuple[Frames, NDArray[np.float64], NDArray[np.int_]]:
    if asked is None:
        found = f"{len(frames.names)} frames without wavelengths in their names, the first {frames.names[0]}"
        raise SettingError("wavelengths", f"none for {frames.source}: {found}", "one per frame (--wavelengths)")
    if asked.size != len(frames.names):
        expected = f"{asked.size}: one per wavelength from {asked[0]:g} to {asked[-1]:g} nm"
        raise DataError(frames.source, f"{len(frames.names)} frames", expected, "capture the missing ones")
    return frames, asked, np.ones(asked.size, dtype=int)


def _check_asked(source: Path, nm: NDArray[np.float64], asked: NDArray[np.float64], nearest: NDArray[np.intp]) -> None:
    here = np.abs(nm - asked[nearest]) <= _SAME
    gone = [f"{wave:g}" for i, wave in enumerate(asked) if i not in nearest[here]]
    more = [f"{wave:g}" for wave in np.unique(nm[~here])]
    if gone or more:
        parts = [f"no frame at {', '.join(gone[:4])}{' …' if len(gone) > 4 else ''} nm"] if gone else []
        parts += [f"frames at {', '.join(more[:4])}{' …' if len(more) > 4 else ''} nm"] if more else []
        expected = f"the {asked.size} wavelengths asked for, {asked[0]:g} to {asked[-1]:g} nm"
        raise DataError(source, " and ".join(parts), expected, "capture them, or ask for others with --wavelengths")


def _dark(frames: Frames, nm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int_], float | None]:
    """Dark frames, how many were averaged, and the noise of one."""
    if frames.saturated.mean() > 0.01:
        found = f"{frames.saturated.mean():.0%} of the dark pixels saturated"
        raise DataError(frames.source, found, "dark frames", "cover the lens")
    if all(_NM.search(name) for name in frames.names) and len(frames.names) > 1 and nm.size > 1:
        own, _, counts = _bands(frames, nm)
        dark = own.values.astype(np.float64)
        spread = np.diff(dark, axis=0).std(axis=(1, 2)) / np.sqrt(1 / counts[1:] + 1 / counts[:-1])
        return dark, counts, float(np.median(spread))
    mean, count = frames.values.mean(axis=0, dtype=np.float64)[None], len(frames.names)
    noise = float(np.sqrt(frames.values.var(axis=0, ddof=1).mean())) if count > 1 else None
    return mean, np.array([count]), noise


def _check_light(scan: Scan) -> None:
    """Refuse scans that are mostly saturated, or bands in which even the white is dark."""
    for frames in (scan.scene, scan.white):
        share = frames.saturated.mean(axis=(1, 2))
        if share.max() > _SATURATED:
            found = f"{share.max():.0%} of the pixels saturated in {frames.names[int(share.argmax())]}"
            raise DataError(frames.source, found, f"{_SATURATED:.0%} at most", "expose for less time")
    signal = np.median(scan.white.values - scan.dark, axis=(1, 2))
    floor = _DARKEST * max(scan.read_noise or 0.0, scan.scene.step / np.sqrt(12)) / np.sqrt(scan.white_frames)
    if (signal <= floor).any():
        band = int((signal - floor).argmin())
        found = f"a white of {signal[band]:.3g} above the dark at {scan.nm[band]:g} nm"
        expected = f"more than {floor[band]:.3g}"
        raise DataError(scan.white.source, found, expected, "expose for longer, or swap dark and white back")
