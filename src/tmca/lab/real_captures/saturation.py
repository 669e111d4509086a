"""Pixels of a real capture that are saturated: which they are, and a snapshot that does without them."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.errors import DataError, SettingError
from tmca.lab.captured_notes import SATURATED

PIXELS, WITHHELD = "saturated_pixels", "saturated_withheld"
"""Notes of an imported capture: how many pixels are saturated, and whether they were withheld (0 or 1)."""
_MOST = 0.5
"""Share of the pixels that may be saturated."""


def without_pixels(snapshot: Snapshot[SpectralCamera], gone: Tensor) -> Snapshot[SpectralCamera]:
    """A snapshot in which some pixels say nothing: their shutter is closed and their value 0.

    Args:
        snapshot: of any spectral camera.
        gone: (H, W') True where a pixel of the sensor is withheld.
    """
    camera = snapshot.camera
    aperture, shutter = camera.codes()
    shown = (~gone).to(shutter)
    blind = SpectralCamera(
        bands=camera.wavelengths, size=camera.size, slots=camera.slots, aperture=aperture, shutter=shutter * shown,
        exposure=camera.exposure, dispersion=camera.dispersion, response=camera.response, sensor=camera.sensor,
    )  # fmt: skip
    return Snapshot(snapshot.values * shown, blind, snapshot.notes)


def marked(
    taken: Snapshot[SpectralCamera], values: NDArray[np.float64], saturation: float | None, withhold: bool
) -> Snapshot[SpectralCamera]:
    """A snapshot whose notes tell of its saturated pixels; without those pixels, if they are to be withheld.

    Args:
        taken: the snapshot.
        values: (H, W') the capture in its own numbers.
        saturation: from which on a pixel says nothing; None where it is not known.
        withhold: close the shutter of saturated pixels.

    Raises:
        SettingError: pixels to be withheld, and no saturation known.
        DataError: more than half of them are saturated, or have the largest value of all where that is not known.
    """
    gone = values >= (values.max() if saturation is None else saturation)
    if withhold and saturation is not None and gone.all():
        raise DataError(taken.notes["source"], f"nothing below the saturation of {saturation:g}", "some pixels")
    if gone.mean() > _MOST:
        found = f"{gone.mean():.0%} of the pixels saturated"
        raise DataError(taken.notes["source"], found, f"{_MOST:.0%} at most", "expose for less time")
    if saturation is None:
        if withhold:
            remedy = "add it to the description"
            raise SettingError("--withhold-saturated", "no saturation in the prototype", "its value", remedy)
        return taken
    taken.notes |= {PIXELS: int(gone.sum()), SATURATED: float(gone.mean()), WITHHELD: int(withhold)}
    return without_pixels(taken, torch.from_numpy(gone)) if withhold else taken
