"""What a scan cannot be: frames of different cameras, light below the dark, a scene brighter than white."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError
from tmca.lab.frames import Frames

Array = NDArray[np.float64]
_DARKEST = 5.0
"""Standard deviations of a pixel's noise: a white has to be brighter than the dark by them, at its median, and a scene
may be darker by them. The median of a frame is far more certain than a pixel; what is left is drift of the dark."""
_SATURATED = 0.5
_BRIGHTEST = 1.3
"""Median reflectance of a scan. No surface sends back more than it gets; a gloss is the lamp's image in a few pixels,
and what fluoresces does so in some bands. Half of all values above 1 take a scene nearer to the lamp than the white,
and 12 % nearer is 1.3 times the light."""


def check_alike(scene: Frames, white: Frames, dark: Frames) -> None:
    """Raises DataError unless the three have frames of one size and one type."""
    for other in (white, dark):
        if other.values.shape[1:] != scene.values.shape[1:]:
            found, wanted = ("×".join(map(str, one.values.shape[1:])) for one in (other, scene))
            raise DataError(other.source, f"frames of {found} pixels", f"{wanted} as the scene's", "capture them alike")
        if other.kind != scene.kind:
            found, remedy = f"digital numbers of type {other.kind}", "save all with the same settings"
            raise DataError(other.source, found, f"{scene.kind} as the scene's", remedy)


def check_light(scene: Frames, white: Frames, dark: Array, nm: Array, noise: Array) -> None:
    """Refuse scans that are mostly saturated, bands in which even the white is dark, and scenes below the dark.

    Args:
        scene, white: a frame per band.
        dark: (L, H, W) or (1, H, W).
        nm: of the bands.
        noise: (2, L) standard deviation of a pixel of scene and white.
    """
    for frames in (scene, white):
        share = frames.saturated.mean(axis=(1, 2))
        if share.max() > _SATURATED:
            found = f"{share.max():.0%} of the pixels saturated in {frames.names[int(share.argmax())]}"
            raise DataError(frames.source, found, f"{_SATURATED:.0%} at most", "expose for less time")
    seen, full = (np.median(frames.values - dark, axis=(1, 2)) for frames in (scene, white))
    least, lowest = _DARKEST * noise[1], -_DARKEST * noise[0]
    if (full <= least).any():
        band = int((full - least).argmin())
        found = f"a white of {full[band]:.3g} above the dark at {nm[band]:g} nm"
        remedy = "expose for longer, or swap dark and white back"
        raise DataError(white.source, found, f"more than {least[band]:.3g}", remedy)
    if (seen < lowest).any():
        band = int((seen - lowest).argmin())
        found = f"a scene {-seen[band]:.3g} below the dark at {nm[band]:g} nm ({scene.names[band]})"
        raise DataError(scene.source, found, f"{-lowest[band]:.3g} at most", "capture it, or the dark, again")


def check_reflectance(values: Array, measured: NDArray[np.bool_], where: object) -> None:
    """Raises DataError where most of a scene (L, H, W) is brighter than white can be."""
    usual = float(np.median(values[measured]))
    if usual > _BRIGHTEST:
        remedy = "swap scene and white back, take both in one light and exposure, or give --white-reflectance"
        raise DataError(where, f"a median reflectance of {usual:.3g}", f"{_BRIGHTEST:g} at most", remedy)
