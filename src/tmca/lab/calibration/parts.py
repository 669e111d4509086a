"""Measured parts of a calibration as labelled variables, and back."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.errors import DataError
from tmca.lab.calibration.measurements.dark_flat import DarkField, FlatField
from tmca.lab.calibration.measurements.dispersion import MeasuredDispersion
from tmca.lab.calibration.measurements.linearity import Linearity
from tmca.lab.calibration.measurements.psf import PsfStack
from tmca.lab.calibration.measurements.registration import Registration
from tmca.lab.calibration.measurements.shear import MeasuredShear
from tmca.lab.calibration.measurements.timing import Timing
from tmca.lab.calibration.measurements.zernike_fit import ZernikeFit

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
    "psf": PsfStack,
    "wavefront": ZernikeFit,
}
"""Name of a part → what it holds; of ``psf`` and ``wavefront`` there is one per slot, with its number at the end."""

_AXES = ("axis",)
DIMS: dict[str, dict[str, tuple[str, ...]]] = {
    "dark": dict.fromkeys(("mean", "read_noise", "defects"), ("y", "x")),
    "flat": dict.fromkeys(("gain", "defects"), ("y", "x")),
    "linearity": dict.fromkeys(("exposures", "levels", "variances", "deviations"), ("exposure",)),
    "registration": {
        **dict.fromkeys(("matrix", "std"), ("axis", "row_column_shift")),
        **dict.fromkeys(("codes", "sensor"), _AXES),
    },
    "dispersion": {
        **dict.fromkeys(("shifts", "std"), ("wavelength", "axis")),
        **dict.fromkeys(("wavelengths", "response", "misfit"), ("wavelength",)),
        "coefficients": ("power", "axis"),
        "residual": _AXES,
    },
    "shear": {
        **dict.fromkeys(("places", "shifts"), ("view", "axis")),
        **dict.fromkeys(("step", "std", "cross"), _AXES),
        "light": ("view",),
    },
    "timing": {"std": ("delay_ratio",)},
    "psf": {
        "values": ("depth", "psf_wavelength", "psf_y", "psf_x"),
        "depths": ("depth",),
        "wavelengths": ("psf_wavelength",),
        "centres": ("depth", "axis"),
        "noise": ("depth", "psf_wavelength"),
    },
    "wavefront": {
        "modes": ("mode", "n_m"),
        **dict.fromkeys(("coefficients", "std"), ("mode",)),
        "tilts": ("depth", "tilt"),
    },
}
_OF_SLOT = ("psf", "wavefront")


def kind_of(name: str) -> str:
    """``psf`` of ``psf0``."""
    return re.sub(r"\d+$", "", name)


def to_variables(name: str, part: Any) -> tuple[dict[str, Any], dict[str, str]]:
    """Variables ``NAME_FIELD`` of a part, each (dims, values, attributes), and texts, which become attributes."""
    kind, found, texts = kind_of(name), {}, {}
    for field in fields(part):
        value = getattr(part, field.name)
        if isinstance(value, str):
            texts[f"{name}_{field.name}"] = value
        elif value is not None:
            dims = tuple(_own(dim, name) for dim in DIMS[kind].get(field.name, ()))
            found[f"{name}_{field.name}"] = (dims, np.asarray(value), _meaning(kind, field.name))
    return found, texts


def _own(dim: str, name: str) -> str:
    """Dimensions of parts that there are several of bear the part's name."""
    own = kind_of(name) in _OF_SLOT and dim not in ("axis", "n_m", "tilt")
    return f"{dim}_{name}" if own else dim


def _meaning(kind: str, field: str) -> dict[str, str]:
    units = {
        ("registration", "matrix"): "sensor pixels per code pixel, and sensor pixels",
        ("dispersion", "shifts"): "sensor pixels",
        ("shear", "step"): "sensor pixels per view",
        ("timing", "delay"): "slots of the aperture",
        ("wavefront", "coefficients"): "m rms of height",
    }
    named = {"wavelengths": "m", "depths": "m", "exposures": "s"}
    unit = units.get((kind, field)) or named.get(field)
    return {} if unit is None else {"units": unit}


def from_variables(name: str, data: xr.Dataset, where: object) -> Any:
    """The part of this name.

    Raises:
        DataError: a variable of it is missing or of another shape.
    """
    kind = KINDS[kind_of(name)]
    values: dict[str, Any] = {}
    for field in fields(kind):
        key, optional = f"{name}_{field.name}", "None" in str(field.type)
        if key in data.variables:
            values[field.name] = _typed(data[key].values, str(field.type))
        elif key in data.attrs:
            values[field.name] = str(data.attrs[key])
        elif optional:
            values[field.name] = None
        elif field.default is MISSING:
            raise DataError(where, f"no {key}", f"all of {name}", "measure it again")
    return kind(**values)


def _typed(value: np.ndarray, kind: str) -> Any:
    if kind == "bool":
        return bool(value)
    if kind.startswith("tuple[Mode"):
        return tuple((int(n), int(m)) for n, m in value)
    if kind.startswith("tuple"):
        return tuple(int(n) for n in value)
    if kind.startswith(("float", "int")):
        return int(value) if kind == "int" else float(value)
    return value
