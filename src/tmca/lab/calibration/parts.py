"""Parts of a calibration as variables of a file, and back: of their axes, sizes and finite."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Json

from tmca.attributes import Attributes, FiniteJson
from tmca.data import plain
from tmca.errors import DataError
from tmca.lab.calibration.buckets import BucketMixing
from tmca.lab.calibration.displacement import MeasuredDispersion, MeasuredShear
from tmca.lab.calibration.meanings import about_field
from tmca.lab.calibration.psf import PsfStack, ZernikeFit
from tmca.lab.calibration.registration import Registration
from tmca.lab.calibration.sensor import DarkField, FlatField, Linearity
from tmca.lab.calibration.timing import Timing
from tmca.stored_numbers import check_finite

if TYPE_CHECKING:
    import xarray as xr

KINDS: dict[str, Any] = {
    "dark": DarkField,
    "flat": FlatField,
    "linearity": Linearity,
    "registration": Registration,
    "dispersion": MeasuredDispersion,
    "shear": MeasuredShear,
    "timing": Timing,
    "buckets": BucketMixing,
    "psf": PsfStack,
    "wavefront": ZernikeFit,
}
"""Name of a part → what it holds; of ``psf`` and ``wavefront`` there is one per slot, with its number at the end."""
DIMS: dict[str, dict[str, str]] = {
    "dark": {"mean": "y x", "read_noise": "y x", "defects": "y x"},
    "flat": {"gain": "y x", "defects": "y x"},
    "linearity": dict.fromkeys(("exposures", "levels", "variances", "deviations"), "exposure"),
    "registration": {
        "matrix": "axis row_column_shift", "std": "axis row_column_shift", "codes": "axis", "sensor": "axis",
    },
    "dispersion": {
        "shifts": "wavelength axis", "std": "wavelength axis", "wavelengths": "wavelength", "response": "wavelength",
        "misfit": "wavelength", "coefficients": "power axis", "residual": "axis",
    },
    "shear": {
        "places": "view axis", "shifts": "view axis", "light": "view", "step": "axis", "std": "axis", "cross": "axis",
    },
    "timing": {"std": "delay_ratio"},
    "buckets": {"levels": "shown bucket", "predicted": "shown bucket", "std": "leakage_transfer"},
    "psf": {
        "values": "depth wavelength y x", "depths": "depth", "wavelengths": "wavelength", "centres": "depth axis",
        "noise": "depth wavelength",
    },
    "wavefront": {"modes": "mode n_m", "coefficients": "mode", "std": "mode", "tilts": "depth tilt"},
}  # fmt: skip
_MAY_LACK = ("saturation", "deviations", "residual", "std", "leakage_std")
"""Fields that are NaN where they were not measured, or where as few values were fitted as there are unknowns."""
_OF_STEP = ("residuals", "sources", "settings")
_SIZES = {"leakage_transfer": 2, "axis": 2, "row_column_shift": 3, "n_m": 2, "delay_ratio": 2}
"""Of axes that are of one size."""
_REMEDY = "take an unchanged copy, or measure it again"


class _Source(Attributes):
    """A file that a part was measured from; its path is a note, never opened."""

    path: str
    sha256: str | None = None


class StatedStep(Attributes):
    """What a step says of itself, in the JSON file of version 0.1."""

    residuals: dict[str, float | None]
    sources: list[_Source]
    settings: dict[str, FiniteJson]
    measured: str


class StoredStep(Attributes):
    """The same as attributes of a group."""

    residuals: Json[dict[str, float | None]]
    sources: Json[list[_Source]]
    settings: Json[dict[str, FiniteJson]]
    measured: str


def kind_of(name: str) -> str:
    """``psf`` of ``psf0``."""
    return name.rstrip("0123456789")


def group_of(name: str, part: Any, step: Mapping[str, Any]) -> xr.Dataset:
    """Variables of a part with their units, and what its step says as attributes."""
    import xarray as xr

    values = {field.name: getattr(part, field.name) for field in fields(part)}
    attrs = {key: json.dumps(plain(step[key])) for key in _OF_STEP} | {"measured": step["measured"]}
    attrs |= {key: value for key, value in values.items() if isinstance(value, str)}
    variables = {
        key: (_dims_of(name, key, np.asarray(value)), np.asarray(value), about_field(kind_of(name), key))
        for key, value in values.items()
        if value is not None and not isinstance(value, str)
    }
    return xr.Dataset(variables, attrs=attrs)


def part_of(name: str, data: xr.Dataset, where: object, before: str = "") -> Any:
    """The part in a group, or of variables whose names begin with ``before``.

    Raises:
        DataError: no such part, or a variable that is missing, of other axes or sizes, no numbers, or not finite.
    """
    if (kind := KINDS.get(kind_of(name))) is None:
        raise DataError(where, f"a part {name}", f"one of {', '.join(KINDS)}", _REMEDY)
    values: dict[str, Any] = {}
    sizes = dict(_SIZES)
    for field in fields(kind):
        key = before + field.name
        if key in data.variables:
            values_there = np.asarray(data[key].values)
            dims = _dims_of(name, field.name, values_there)
            array = _checked(values_there, field.name, dims, sizes, f"{where}: {name}")
            values[field.name] = _typed(array, str(field.type))
        elif key in data.attrs:
            values[field.name] = str(data.attrs[key])
        elif field.default is MISSING:
            raise DataError(where, f"no {key}", f"all of {name}", "measure it again")
    return kind(**values)


def _dims_of(name: str, field: str, array: np.ndarray) -> list[str]:
    """Axes of a field; maps of a sensor with several buckets have one more."""
    dims = DIMS[kind_of(name)].get(field, "").split()
    return ["bucket", *dims] if name in ("dark", "flat") and dims and array.ndim == 3 else dims


def _checked(array: np.ndarray, name: str, dims: list[str], sizes: dict[str, int], where: str) -> np.ndarray:
    """An array of these axes; ``sizes`` holds what the arrays before it say of them."""
    if array.dtype.kind not in "biuf" or array.ndim != len(dims):
        found = f"{name} of shape {array.shape} and type {array.dtype}"
        raise DataError(where, found, f"numbers by {', '.join(dims) or 'none'}", _REMEDY)
    for dim, size in zip(dims, array.shape, strict=True):
        if sizes.setdefault(dim, size) != size or (not size and dim != "power"):
            raise DataError(where, f"{name} of {size} along {dim}", f"{sizes[dim] or 'some'}", _REMEDY)
    if name not in _MAY_LACK:
        check_finite(array, where, name, _REMEDY)
    return array


def _typed(value: np.ndarray, kind: str) -> Any:
    if kind.startswith("tuple[Mode"):
        return tuple((int(n), int(m)) for n, m in value)
    if kind.startswith("tuple"):
        return tuple(int(n) for n in value)
    plain_types = {"bool": bool, "int": int, "float": float, "float | None": float}
    return plain_types[kind](value) if kind in plain_types else value
