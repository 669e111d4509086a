"""Grey levels of a display and the light that they give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError
from tmca.lab.devices.descriptions import DeviceDescription

LEVELS = 256
_WANTED = "lines GREY,LIGHT below the heading grey,light or none, or GREY,PHASE below the heading grey,phase_rad"


def response(device: DeviceDescription) -> NDArray[np.float64]:
    """(256,) share of the light at every grey level, from 0 to 1.

    A table of ``grey,light`` rises; of ``grey,phase_rad`` it is the retardance φ of a liquid crystal between crossed
    polarisers, which pass sin²(φ/2) and may pass their maximum before grey 255.

    Raises:
        DataError: a table that is none, that does not rise, or whose phase does not change.
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
    levels = np.argsort(known, kind="stable")
    rising = known[levels]
    above = np.searchsorted(rising, light).clip(1, LEVELS - 1)
    nearer = light - rising[above - 1] < rising[above] - light
    return np.asarray(levels[above - nearer], dtype=np.uint8)


def light_of(grey: NDArray[np.uint8], device: DeviceDescription) -> NDArray[np.float32]:
    """Share of the light that grey levels give."""
    return response(device)[grey].astype(np.float32)


def step_of(device: DeviceDescription) -> float:
    """Largest step of light between neighbouring levels of it."""
    return float(np.diff(np.sort(response(device))).max())


def _table(file: Path) -> NDArray[np.float64]:
    heading, grey, values = _columns(file)
    phase = heading == "phase_rad"
    rises = phase or bool((np.diff(values) > 0).all())
    if not rises or (np.diff(grey) <= 0).any() or grey[0] > 0 or grey[-1] < LEVELS - 1:
        raise DataError(file, "a response that does not rise from grey 0 to 255", "one that does", "measure it again")
    found = np.interp(np.arange(LEVELS), grey, values)
    found = np.sin(found / 2) ** 2 if phase else found
    if not np.ptp(found) > 0:
        raise DataError(file, "the same light at every grey level", "a response that changes", "measure it again")
    return np.asarray((found - found.min()) / np.ptp(found))


def _columns(file: Path) -> tuple[str, NDArray[np.float64], NDArray[np.float64]]:
    """Heading of the second of two columns of numbers, and both by rising grey level."""
    if not file.is_file():
        raise DataError(file, "no such file", _WANTED, "check the path")
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        raise DataError(file, "no table of numbers", _WANTED, "see docs/devices.md") from None
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    heading, *below = [line for line in lines if line] or [""]
    names = [name.strip().lower() for name in heading.split(",")]
    named = names[0] == "grey"
    if named and (len(names) != 2 or names[1] not in ("light", "phase_rad")):
        raise DataError(file, f"the heading {heading!r}", _WANTED, "give light, or the phase in radians")
    rows = np.array([_row(line, file) for line in (below if named else [heading, *below])]).reshape(-1, 2)
    if len(rows) < 2:
        raise DataError(file, f"{len(rows)} lines of numbers", f"{_WANTED}, two or more")
    grey, values = rows[np.argsort(rows[:, 0])].T
    return names[1] if named else "light", grey, values


def _row(line: str, file: Path) -> tuple[float, float]:
    try:
        grey, value = (float(part) for part in line.split(","))
    except ValueError:
        grey = value = np.nan
    if not np.isfinite([grey, value]).all():
        raise DataError(file, f"the line {line!r}", _WANTED, "two numbers in every line")
    return grey, value
