"""View shear of a coded mask: how far its shadow moves from view to view, with one view open at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.displacement import displacement_of
from tmca.lab.calibration.measurements.limits import beyond
from tmca.lab.calibration.measurements.registration import Registration

LARGEST_RESIDUAL = 0.25
"""Sensor pixels that a linear fit may leave, root mean square."""
_TURNED = 0.5
"""Share of the step that may be along the other axis: half of it is an aperture turned by 27°, all of it one whose rows
and columns were named in each other's place."""


@dataclass(frozen=True)
class MeasuredShear:
    """The ray from sensor pixel m to view ℓ crosses the mask where ``m + step · ℓ`` lies under the registration.

    Args:
        places: (n, 2) views ℓ = (v, u) that were open, in view steps from the middle.
        shifts: (n, 2) of the mask's shadow, rows and columns, sensor pixels.
        step: (2,) sensor pixels per view along y and x: the shadow of view ℓ is shifted by ``-step · ℓ``.
        std: (2,) of the step.
        cross: (2,) shift along y per view along x, and along x per view along y: an aperture that is turned.
        residual: rms of what the fit leaves, sensor pixels.
        light: (n,) of each view over that of the brightest.
    """

    places: Array
    shifts: Array
    step: Array
    std: Array
    cross: Array
    residual: float
    light: Array

    def vignetting(self, views: tuple[int, int]) -> Array:
        """(V, U) light of every view, ones where a view was not captured."""
        found = np.ones(views)
        for (v, u), share in zip(self.places, self.light, strict=True):
            row, column = int(v) + views[0] // 2, int(u) + views[1] // 2
            if 0 <= row < views[0] and 0 <= column < views[1]:
                found[row, column] = share
        return found


def measure_shear(
    frames: ArrayLike,
    places: Sequence[tuple[int, int]],
    pattern: ArrayLike,
    registration: Registration,
    *,
    source: object = "shear",
) -> MeasuredShear:
    """Linear fit of the shadow's shifts over the views.

    Args:
        frames: (n, H, W) linear digital numbers, dark taken off, each with one view open.
        places: (v, u) of the view of each, in view steps from the middle.
        pattern: (h, w) on the mask.
        registration: of the mask at the middle view.
        source: named in errors.

    Raises:
        SettingError: fewer than two views along an axis.
        DataError: a capture in which the pattern is not seen, shifts that are not linear, or along the other axis.
    """
    values, views = np.asarray(frames, dtype=np.float64), np.asarray(places, dtype=np.float64)
    if views.shape != (len(values), 2) or any(len(set(views[:, axis])) < 2 for axis in (0, 1)):
        raise SettingError("views", f"{views.tolist()}", "(v, u) of every capture, two or more along each axis")
    each = [
        displacement_of(frame, pattern, registration, source=f"{source} (view {v:g}, {u:g})")
        for frame, (v, u) in zip(values, views, strict=True)
    ]
    shifts = np.stack([one.shift for one in each])
    terms = np.column_stack([np.ones(len(views)), views])
    found = np.linalg.lstsq(terms, shifts, rcond=None)[0]
    left = shifts - terms @ found
    residual = float(np.sqrt((left**2).mean()))
    if residual > LARGEST_RESIDUAL:
        what = f"shifts of which a linear fit leaves {beyond(residual, 'pixels')}"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:g} at most", "check which view each capture had open")
    step, cross = -np.diag(found[1:]), -np.array([found[2, 0], found[1, 1]])
    _check_axes(step, cross, source)
    std = np.sqrt(np.diag(np.linalg.pinv(terms.T @ terms))[1:] * (left**2).sum(axis=0) / max(1, len(views) - 3))
    light = np.array([one.light for one in each])
    return MeasuredShear(views, shifts, step, std, cross, residual, light / light.max())


def _check_axes(step: Array, cross: Array, source: object) -> None:
    """Raises DataError where views along one axis shift the shadow along the other one."""
    along, across = float(np.abs(step).max()), float(np.abs(cross).max())
    if across > max(_TURNED * along, LARGEST_RESIDUAL):
        what = f"shifts of {beyond(across, 'pixels')} per view along the other axis, {along:.2f} along its own"
        remedy = "name the frames view_ROW_COLUMN; turn the aperture's device upright"
        raise DataError(source, what, f"{_TURNED:.0%} of those along its own at most", remedy)
