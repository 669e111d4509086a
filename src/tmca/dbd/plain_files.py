"""Samples of one's own: plain arrays in an ``.npz``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from tmca.dbd.problem import Problem, Units
from tmca.dbd.source import Source
from tmca.errors import DataError, TmcaError

_NPZ = ("y", "sigma", "delay_s", "doppler_hz", "carrier_hz", "spacing")


def read_plain(path: Path) -> Problem:
    """Reads ``y``, ``basis_NAME`` and what else :func:`tmca.dbd.files.load_problem` tells of.

    Raises:
        DataError: no such arrays.
        ShapeError, SettingError: arrays that do not fit each other.
    """
    try:
        with np.load(path) as opened:
            arrays = dict(opened)
    except (OSError, ValueError, EOFError, TypeError, BadZipFile) as error:
        raise DataError(path, "no .npz of plain arrays", "np.savez(path, y=…, basis_radar=…, …)") from error
    names = [name.removeprefix("basis_") for name in arrays if name.startswith("basis_")]
    if "y" not in arrays or not names:
        raise DataError(path, ", ".join(arrays) or "nothing", "y and one basis_NAME or more")
    unknown = [name for name in arrays if name not in _NPZ and name.split("_", 1)[-1] not in names]
    if unknown:
        raise DataError(
            path, ", ".join(unknown), f"{', '.join(_NPZ)}, and basis_, message_ and weight_NAME of a source"
        )
    try:
        y = _numbers(arrays, "y")
        sources = [_npz_source(name, arrays, y) for name in names]
        sigma = _single(arrays, "sigma") if "sigma" in arrays else None
        return Problem(y, tuple(sources), sigma, units=_npz_units(arrays))
    except TmcaError as error:
        raise type(error)(f"{path}, {error.where}", error.found, error.expected, error.remedy) from error


def _npz_source(name: str, arrays: dict[str, Any], y: Any) -> Source:
    rows = _numbers(arrays, f"basis_{name}")
    if y.ndim < 2 and rows.ndim < 3:
        raise DataError("y", f"{y.ndim} dimension", "(P, M) or (A, P, M), or bases of (P, M, J)")
    pulses = len(rows) if rows.ndim == 3 else y.shape[-2]
    plain = np.arange(pulses) if rows.ndim == 3 else np.zeros(pulses, np.int64)
    message = _numbers(arrays, f"message_{name}") if f"message_{name}" in arrays else plain
    weight = {"weight": _single(arrays, f"weight_{name}")} if f"weight_{name}" in arrays else {}
    return Source(name, rows, message, **weight)


def _npz_units(arrays: dict[str, Any]) -> Units | None:
    """Physical scales, all of them or none; half a wavelength between antennas unless ``spacing`` says otherwise."""
    needed = ("delay_s", "doppler_hz", "carrier_hz")
    there = [name for name in needed if name in arrays]
    if not there:
        return None
    if len(there) < len(needed):
        raise DataError("units", ", ".join(there), f"{', '.join(needed)}, or none of them")
    return Units(*(_single(arrays, name) for name in (*needed, *(["spacing"] if "spacing" in arrays else []))))


def _single(arrays: Mapping[str, Any], name: str) -> float:
    value = np.asarray(arrays[name])
    if value.size != 1 or value.dtype.kind not in "iuf":
        raise DataError(name, f"{value.dtype} of shape {value.shape}", "one number")
    return float(value.reshape(()))


def _numbers(arrays: Mapping[str, Any], name: str) -> Any:
    """A numerical array of a file."""
    value = np.asarray(arrays[name])
    if value.dtype.kind not in "iufc":
        raise DataError(name, f"{value.dtype}", "numbers")
    return value
