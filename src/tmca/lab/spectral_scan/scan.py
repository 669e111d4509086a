"""The frames of a spectral scan: scene, dark and white, all there and at the wavelengths asked for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError
from tmca.lab.frames import Frames, check_distinct, read_frames
from tmca.lab.real_captures.noise import dark_noise
from tmca.lab.spectral_scan.checks import check_alike, check_light
from tmca.lab.spectral_scan.exchanged import doubt_exchanged

_NM = re.compile(r"(\d+(?:\.\d+)?) ?nm(?![a-z])", re.IGNORECASE)
_SAME = 0.5
"""Nanometres by which a wavelength may differ from the one asked for."""


@dataclass(frozen=True)
class Scan:
    """Scene and white ``(L, H, W)``, dark ``(L, H, W)`` or ``(1, H, W)``, in digital numbers; ``nm`` ``(L,)``.

    ``scene_frames``, ``white_frames`` ``(L,)`` and ``dark_frames`` ``(L,)`` or ``(1,)`` were averaged into each band;
    ``read_noise`` is what the dark ones say of a frame's: what differs from one to the next (one per wavelength: but
    for its mean), of a single one what differs between neighbouring pixels, where fixed patterns count too. ``doubts``
    are lines on frames that may be under each other's names.
    """

    source: Path
    nm: NDArray[np.float64]
    scene: Frames
    white: Frames
    dark: NDArray[np.float64]
    scene_frames: NDArray[np.int_]
    white_frames: NDArray[np.int_]
    dark_frames: NDArray[np.int_]
    read_noise: float
    doubts: tuple[str, ...] = ()


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
        DataError: missing frames, other wavelengths than those asked for or than the scene's, other sizes or types, a
            scene or white that is mostly saturated, a band without light or with a scene below the dark, or frames that
            are copies of each other.
        SettingError: frames of unknown wavelength and none given.
    """
    asked = None if wavelengths is None else np.asarray(metres_to_nm(np.asarray(wavelengths)))
    if asked is not None and (not asked.size or (np.diff(asked) <= 0).any()):
        raise SettingError("wavelengths", f"{asked.size} that do not ascend", "ascending wavelengths")
    taken, bright, black = (read_frames(path, saturation) for path in (scene, white, dark))
    check_alike(taken, bright, black)
    frames, nm, of_scene = _bands(taken, asked)
    whites, _, of_white = _bands(bright, nm)
    below, count, noise = _dark(black, nm)
    each = max(noise, frames.step / np.sqrt(12)) / np.sqrt([of_scene, of_white])
    check_light(frames, whites, below, nm, each)
    check_distinct(taken, bright)
    doubts = doubt_exchanged(frames, whites, below, nm)
    return Scan(Path(scene), nm, frames, whites, below, of_scene, of_white, count, noise, doubts)


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
    return replace(frames, names=tuple(frames.names[i[0]] for i in own), values=values, saturated=saturated)


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


def _dark(frames: Frames, nm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int_], float]:
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
    noise = float(np.sqrt(frames.values.var(axis=0, ddof=1).mean())) if count > 1 else 0.0
    return mean, np.array([count]), noise or dark_noise(frames.values[0])
