"""A calibration with the true numbers of a rendered bench: what the best one would give."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.measurements.dispersion import MeasuredDispersion


@dataclass(frozen=True)
class TrueDispersion(MeasuredDispersion):
    """The bench's own curve instead of a fitted one, at its wavelengths and between them by a fine interpolation."""

    fine: tuple[Array, Array, Array] | None = None

    def at(self, wavelengths: ArrayLike) -> Array:
        """(n, 2) true displacement."""
        waves, shifts, _ = self.fine or (self.wavelengths, self.shifts, self.response)
        asked = np.asarray(wavelengths, dtype=np.float64)
        return np.stack([np.interp(asked, waves, shifts[:, axis]) for axis in (0, 1)], axis=1)

    def response_at(self, wavelengths: ArrayLike) -> Array:
        """(n,) true κ."""
        waves, _, response = self.fine or (self.wavelengths, self.shifts, self.response)
        return np.interp(np.asarray(wavelengths, dtype=np.float64), waves, response)


def true_calibration(calibration: Calibration, truth: dict[str, Any]) -> Calibration:
    """A calibration with the bench's true numbers; the sensor's stays as it was measured."""
    parts = dict(calibration.parts)
    if "registration" in parts:
        parts["registration"] = replace(
            parts["registration"],
            matrix=np.asarray(truth["matrix"]),
            blur=float(truth["blur"]),
            leakage=1 / truth["contrast_ratio"],
        )
        parts["timing"] = replace(parts["timing"], delay=truth["delay"], ratio=truth["ratio"], leakage=truth["leakage"])
    if "dispersion" in parts:
        fine = tuple(np.asarray(truth[f"fine_{name}"]) for name in ("wavelengths", "shifts", "response"))
        known = {f.name: getattr(parts["dispersion"], f.name) for f in fields(MeasuredDispersion)}
        parts["dispersion"] = TrueDispersion(**known, fine=(fine[0], fine[1], fine[2]))
    if "shear" in parts:
        places = parts["shear"].places
        light = 1 - truth["fall_off"] * (places**2).sum(axis=1)
        parts["shear"] = replace(parts["shear"], step=np.asarray(truth["step"]), light=light)
    for name in [name for name in parts if name.startswith("wavefront")]:
        own = truth["coefficients"][int(name.removeprefix("wavefront"))]
        parts[name] = replace(parts[name], coefficients=np.asarray(own))
    return Calibration(parts, calibration.about, calibration.path)
