"""What the steps of a calibration share: what they build on, and the patterns that were shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.measurements.registration import Registration
from tmca.lab.frames import read_frames


def needed(calibration: Calibration, name: str, step: str) -> Any:
    """A part that a step builds on.

    Raises:
        DataError: it was not measured.
    """
    part = calibration.part(name)
    if part is None:
        remedy = f"run tmca calibrate {name} first, and name its file with --onto"
        raise DataError(calibration.where, f"no {name}", f"one, on which {step} builds", remedy)
    return part


def sensor_size(calibration: Calibration) -> tuple[int, int] | None:
    """(H, W) of the sensor, if a step has seen it."""
    found = calibration.about["camera"].get("sensor")
    return None if found is None else (int(found[0]), int(found[1]))


def read_patterns(path: str | Path, device: tuple[int, int] | None = None) -> Array:
    """(P, h, w) patterns that were shown, zeros and ones, from a folder of pictures or a stack.

    Raises:
        DataError: grey patterns, or a size that is not the device's.
    """
    values = read_frames(path).values
    top = float(values.max())
    if not top > 0 or not np.isin(values, (0, top)).all():
        raise DataError(path, "grey patterns", "pictures of two levels: dark and open", "save them without smoothing")
    if device is not None and values.shape[1:] != tuple(device):
        found, known = ("×".join(map(str, n)) for n in (values.shape[1:], device))
        raise DataError(path, f"patterns of {found} pixels", f"{known}, those of the device", "name what was shown")
    return np.asarray(values, dtype=np.float64) / top


def shown_pattern(path: str | Path, index: int, registration: Registration) -> Array:
    """One of the patterns that were shown, of the size that was registered."""
    shown = read_patterns(path, registration.codes)
    if not 0 <= index < len(shown):
        raise SettingError("pattern", str(index), f"0 to {len(shown) - 1}")
    share = shown[index].mean()
    if share in (0.0, 1.0):
        raise SettingError("pattern", f"{index}, which is all {'open' if share else 'dark'}", "a coded one")
    return shown[index]
