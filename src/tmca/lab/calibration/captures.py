"""Captures for calibration: all there, known by name, not saturated, of one size; corrected for the sensor."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.errors import DataError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.codes_date import CAPTURES
from tmca.lab.frames import Frames, check_distinct, read_frames

_SATURATED = 0.01
RED_WIDER = "red_wider"
"""Kept with the frames of a dispersion where the camera as drawn spreads red light wider than blue."""

VIEW = re.compile(r"view_(-?\d+)_(-?\d+)(?:_|$)")
SLOTS = re.compile(r"aperture_(\d+)_shutter_(\d+)(?:_|$)")
POINT = re.compile(r"(\d+(?:\.\d+)?)m_(\d+(?:\.\d+)?)nm(?:_|$)")
WAVE = re.compile(r"(\d+(?:\.\d+)?)nm(?:_|$)")
EXPOSURE = re.compile(r"(\d+(?:\.\d+)?)ms(?:_|$)")


def read_captures(
    path: str | Path,
    *,
    saturation: float | None = None,
    may_saturate: bool = False,
    sensor: Sequence[int] | None = None,
) -> Frames:
    """Frames of a folder or stack; those that a bench took have to be as it kept them.

    Args:
        path: see `tmca.lab.frames.read_frames`.
        saturation: see there; that of the bench that took them where it was kept.
        may_saturate: whether saturated frames are wanted.
        sensor: (H, W) they have to have.

    Raises:
        DataError: no frames, another size, frames that are missing, changed or in another's place, one more than a
            hundredth of which is saturated, or one that repeats another value by value.
    """
    kept = kept_with(Path(path))
    frames = read_frames(path, kept.get("saturation") if saturation is None else saturation)
    size = frames.values.shape[1:]
    if sensor is not None and tuple(sensor) != size:
        found, known = ("×".join(map(str, n)) for n in (size, sensor))
        raise DataError(path, f"frames of {found} pixels", f"{known} as calibrated before", "use the same sensor")
    share = frames.saturated.mean(axis=(1, 2))
    if not may_saturate and share.max() > _SATURATED:
        found = f"{share.max():.0%} of the pixels saturated in {frames.names[int(share.argmax())]}"
        raise DataError(path, found, f"{_SATURATED:.0%} at most", "expose for less time")
    if kept.get("driver") != "simulated":
        check_distinct(frames)
    return frames


def kept_with(path: Path) -> dict[str, Any]:
    """What the bench whose frames, checked, are in a folder was taken with; nothing of other frames."""
    if not (path / CAPTURES).is_file():
        return {}
    from tmca.lab.devices.captures import read_captures as kept_captures

    return dict(kept_captures(path)["taken_with"])


def named(frames: Frames, pattern: re.Pattern[str], example: str) -> list[tuple[float, ...]]:
    """The numbers in every frame's name.

    Raises:
        DataError: a name without them.
    """
    found = []
    for name in frames.names:
        match = pattern.search(name)
        if match is None:
            raise DataError(frames.source, f"a frame named {name}", f"names such as {example}", "rename the frames")
        found.append(tuple(float(part) for part in match.groups()))
    return found


def averaged(values: Array, keys: Sequence[tuple[float, ...]]) -> tuple[Array, list[tuple[float, ...]]]:
    """Mean of the frames of every key, and the keys in ascending order."""
    distinct = sorted(set(keys))
    return np.stack([values[[k == key for k in keys]].mean(axis=0) for key in distinct]), distinct


def in_order(frames: Frames, count: int, what: str) -> Array:
    """(count, H, W) frames in the order of their names.

    Raises:
        DataError: another number of them.
    """
    if len(frames.names) != count:
        remedy = "capture the missing ones, in the order of the patterns"
        raise DataError(frames.source, f"{len(frames.names)} frames", f"{count}, one for each {what}", remedy)
    return frames.values.astype(np.float64)


def corrected(values: ArrayLike, calibration: Calibration) -> Array:
    """Frames (…, H, W) without dark, over the flat field, defects replaced by the median of their neighbours; steps
    that were not measured are left out."""
    dark, flat = calibration.part("dark"), calibration.part("flat")
    found = np.asarray(values, dtype=np.float64)
    if dark is not None:
        found = found - dark.mean
    if flat is not None:
        found = found / np.where(flat.defects == 0, np.maximum(flat.gain, 1e-3), 1.0)
    bad = defects(calibration)
    return found if bad is None or not bad.any() else _mended(found, bad)


def defects(calibration: Calibration) -> np.ndarray | None:
    """(H, W) hot and dead pixels; None without dark and flat."""
    known = [part.defects > 0 for part in map(calibration.part, ("dark", "flat")) if part is not None]
    return np.asarray(np.logical_or.reduce(known)) if known else None


def _mended(values: Array, bad: np.ndarray) -> Array:
    found = values.copy()
    padded = np.pad(
        np.where(bad, np.nan, values), [(0, 0)] * (values.ndim - 2) + [(1, 1), (1, 1)], constant_values=np.nan
    )
    for y, x in np.argwhere(bad):
        around = padded[..., y : y + 3, x : x + 3].reshape(*values.shape[:-2], 9)
        with np.errstate(all="ignore"):
            middle = np.nanmedian(around, axis=-1)
        found[..., y, x] = np.nan_to_num(middle)
    return found
