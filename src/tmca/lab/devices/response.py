"""Grey levels of a display and the light that they give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError
from tmca.lab.devices.descriptions import DeviceDescription

LEVELS = 256


def response(device: DeviceDescription) -> NDArray[np.float64]:
    """(256,) share of the light at every grey level, rising from 0 to 1.

    Raises:
        DataError: a table that is none, or does not rise.
    """
    if device.lut is None:
        return np.asarray((np.arange(LEVELS) / (LEVELS - 1)) ** device.gamma)
    return _table(Path(device.lut))


def grey_of(light: NDArray[np.float32], device: DeviceDescription) -> NDArray[np.uint8]:
    """Grey levels that give shares of the light, the nearest ones.

    Raises:
        SettingError: shares outside 0 to 1.
    """
    if light.min() < 0 or light.max() > 1:
        raise SettingError("aperture", f"{light.min():g} to {light.max():g}", "shares of the light, 0 to 1")
    known = response(device)
    above = np.searchsorted(known, light).clip(1, LEVELS - 1)
    nearer = light - known[above - 1] < known[above] - light
    return np.asarray(above - nearer, dtype=np.uint8)


def light_of(grey: NDArray[np.uint8], device: DeviceDescription) -> NDArray[np.float32]:
    """Share of the light that grey levels give."""
    return response(device)[grey].astype(np.float32)


def step_of(device: DeviceDescription) -> float:
    """Largest step of light between neighbouring grey levels."""
    return float(np.diff(response(device)).max())


def _table(file: Path) -> NDArray[np.float64]:
    try:
        rows = np.genfromtxt(file, delimiter=",", comments="#")
    except (OSError, ValueError):
        raise DataError(file, "no table of numbers", "lines GREY,RESPONSE", "see docs/devices.md") from None
    rows = rows[np.isfinite(rows).all(axis=1)] if rows.ndim == 2 else rows
    if rows.ndim != 2 or rows.shape[1] != 2 or len(rows) < 2:
        raise DataError(file, f"an array of shape {rows.shape}", "lines GREY,RESPONSE, two or more")
    grey, light = rows[np.argsort(rows[:, 0])].T
    if (np.diff(light) <= 0).any() or (np.diff(grey) <= 0).any() or grey[0] > 0 or grey[-1] < LEVELS - 1:
        raise DataError(file, "a response that does not rise from grey 0 to 255", "one that does", "measure it again")
    found = np.interp(np.arange(LEVELS), grey, light)
    return np.asarray((found - found[0]) / (found[-1] - found[0]))
