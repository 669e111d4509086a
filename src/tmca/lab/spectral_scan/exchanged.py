"""Two bands of a scan under each other's names: reflectance that is smooth over wavelengths once they are exchanged."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError
from tmca.lab.frames import Frames

Array = NDArray[np.float64]
_FEWEST = 8
"""Bands of which fewer do not say what is smooth."""
_BLOCKS = 16
"""Along an axis: means of blocks have little noise, and still tell surfaces apart."""
_SURE, _WHOLE = 0.05, 0.15
"""Shares of the bend, in the bands beside the two and in all of the scan, that an exchange leaves where it is certain.
Two frames of a scene that were renamed leave 0.03 and 0.1. Of scans in order, with edges and lines, every exchange
leaves 0.13 or 0.2."""
_DOUBT = 0.12
"""Share in the bands beside the two below which it is worth a look: spectra of lines alone come to it by chance."""


@dataclass(frozen=True)
class Exchange:
    """The exchange of two bands that leaves least of the bend.

    Args:
        bands: both.
        white: the white's frames were exchanged as well.
        beside, whole: shares of the bend that it leaves, in the bands beside the two and in all.
    """

    bands: tuple[int, int]
    white: bool
    beside: float
    whole: float


def check_exchanged(scene: Frames, white: Frames, dark: Array, nm: Array) -> tuple[str, ...]:
    """Refuse two frames that were clearly named after each other, and tell of two that may have been.

    Args:
        scene, white: a frame per band.
        dark: (L, H, W) or (1, H, W).
        nm: of the bands, ascending.

    Returns:
        No line or one.

    Raises:
        DataError: naming both frames.
    """
    if len(nm) < _FEWEST:
        return ()
    found = best_exchange(_light(scene, dark), np.maximum(_light(white, dark), 1e-12), nm)
    names = " and ".join(scene.names[band] for band in found.bands) + (
        ", and those of the white," if found.white else ""
    )
    if found.beside < _SURE and found.whole < _WHOLE:
        what = f"{names} under each other's names: exchanged they leave {found.whole:.0%} of how reflectance bends"
        raise DataError(scene.source, what, "bands that go on from one to the next", "name them back, or capture again")
    if found.beside < _DOUBT:
        return (f"{scene.source}: {names} may be under each other's names: reflectance is smoother the other way",)
    return ()


def best_exchange(scene: Array, white: Array, nm: Array) -> Exchange:
    """The most likely exchange of two bands, of the scene's frames alone or of those of the white as well.

    A band bends by what it is off the straight line between the bands beside it.

    Args:
        scene, white: (L, n) light above the dark of L bands in n places.
        nm: (L,) of the bands, ascending.
    """
    share = (nm[2:] - nm[1:-1]) / (nm[2:] - nm[:-2])
    before = _bend(scene / white, share)
    best = Exchange((0, 1), False, np.inf, np.inf)
    for one, other in combinations(range(len(nm)), 2):
        order = np.arange(len(nm))
        order[[one, other]] = other, one
        near = _beside(one, other, len(nm))
        for both in (False, True):
            after = _bend(scene[order] / (white[order] if both else white), share)
            beside = float(after[near].sum() / max(before[near].sum(), 1e-300))
            if beside < best.beside:
                best = Exchange((one, other), both, beside, float(after.sum() / before.sum()))
    return best


def _bend(reflectance: Array, share: Array) -> Array:
    """(L - 2,) sum over places of the squared distance from the straight line between neighbours."""
    line = share[:, None] * reflectance[:-2] + (1 - share[:, None]) * reflectance[2:]
    return np.asarray(((reflectance[1:-1] - line) ** 2).sum(axis=1))


def _beside(one: int, other: int, bands: int) -> list[int]:
    """Rows of the bend that either band takes part in."""
    near = {band + step - 1 for band in (one, other) for step in (-1, 0, 1)}
    return sorted(row for row in near if 0 <= row < bands - 2)


def _light(frames: Frames, dark: Array) -> Array:
    """(L, n) means of blocks above the dark."""
    above = frames.values - dark
    for axis in (1, 2):
        length = above.shape[axis]
        parts = np.array_split(np.arange(length), min(_BLOCKS, length))
        above = np.add.reduceat(above, [part[0] for part in parts], axis=axis)
        sizes = np.array([len(part) for part in parts])
        above = above / np.expand_dims(sizes, tuple(n for n in range(3) if n != axis))
    return np.asarray(above.reshape(len(above), -1), dtype=np.float64)
