"""Two bands of a scan under each other's names: reflectance that is smooth over wavelengths once they are exchanged."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tmca.lab.frames import Frames

Array = NDArray[np.float64]
_FEWEST = 8
"""Bands of which fewer do not say what is smooth."""
_BLOCKS = 16
"""Along an axis: means of blocks have little noise, and still tell surfaces apart."""
_LIT = 0.05
"""Share of a band's brightest white below which a block says nothing of reflectance."""
_BENT = 0.02
"""Bend beside two bands, as a share of reflectance, both root mean square, below which it is drift of the lamp."""
_BESIDE, _WHOLE = 0.12, 0.3
"""Shares of the bend, in the bands beside the two and in all of the scan, that an exchange leaves where it is likely.
Of 16 bands or more, two frames of the colour charts that were renamed leave 0.1 and 0.28. Of charts in order, patch by
patch, on even grids and under light-emitting diodes, every exchange leaves more than 0.15 or 0.45."""


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


def doubt_exchanged(scene: Frames, white: Frames, dark: Array, nm: Array) -> tuple[str, ...]:
    """Tell of two frames that may be named after each other: spectra alone never prove it, so nothing is refused.

    Args:
        scene, white: a frame per band.
        dark: (L, H, W) or (1, H, W).
        nm: of the bands, ascending.

    Returns:
        No line or one, which names both frames.
    """
    if len(nm) < _FEWEST:
        return ()
    seen, full = _light(scene, dark), _light(white, dark)
    lit = (full > _LIT * full.max(axis=1, keepdims=True)).all(axis=0)
    found = best_exchange(seen[:, lit], full[:, lit], nm)
    if found is None or found.beside >= _BESIDE or found.whole >= _WHOLE:
        return ()
    names = " and ".join(scene.names[band] for band in found.bands)
    both = ", and those of the white," if found.white else ""
    why = f"exchanged they leave {found.whole:.0%} of how reflectance bends; compare both with their neighbours"
    return (f"{scene.source}: {names}{both} may be under each other's names: {why}",)


def best_exchange(scene: Array, white: Array, nm: Array) -> Exchange | None:
    """The most likely exchange of two bands, of the scene's frames alone or of those of the white as well.

    A band bends by what it is off the straight line between the bands beside it. The first and the last band are on one
    such line alone, with little weight where they are far away: what is odd would always seem to belong there.

    Args:
        scene, white: (L, n) light above the dark of L bands in n places.
        nm: (L,) of the bands, ascending.

    Returns:
        None where no two bands are beside a bend that is more than drift.
    """
    share = (nm[2:] - nm[1:-1]) / (nm[2:] - nm[:-2])
    before, best = _bend(scene / white, share), None
    drift = _BENT**2 * float(((scene / white) ** 2).sum()) / len(nm)
    for one, other in combinations(range(1, len(nm) - 1), 2):
        near = _beside(one, other, len(nm))
        if before[near].mean() <= drift:
            continue
        order = np.arange(len(nm))
        order[[one, other]] = other, one
        for both in (False, True):
            after = _bend(scene[order] / (white[order] if both else white), share)
            beside, whole = float(after[near].sum() / before[near].sum()), float(after.sum() / before.sum())
            if best is None or beside < best.beside:
                best = Exchange((one, other), both, beside, whole)
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
