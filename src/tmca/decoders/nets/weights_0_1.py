"""The camera of weights that version 0.1 wrote."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.attributes import Attributes, attributes_of
from tmca.cameras import CAMERAS
from tmca.codes.files import Frame
from tmca.errors import check_choice
from tmca.optics import PhaseAttributes, check_stated, restored_maps

if TYPE_CHECKING:
    import xarray as xr


class _Sized(Attributes):
    size: Frame


def of_version_0_1(about: Any, arrays: dict[str, np.ndarray], path: Path) -> xr.Dataset:
    """A camera's variables of a file that holds its arguments as JSON values and its codes as tensors."""
    kind, where = about.application, str(path)
    check_choice("camera", kind, _ARGUMENTS)
    attributes_of(_Sized, about.camera, path)
    settings: dict[str, Any] = {name: torch.from_numpy(values.astype(np.float32)) for name, values in arrays.items()}
    settings = _ARGUMENTS[kind]({**settings, **about.camera}, about, where)
    return CAMERAS[kind](**settings, slots=len(settings["shutter"])).variables(tiled=True)


def _masks(settings: dict[str, Any], about: Any, where: str) -> dict[str, Any]:
    given = {name: value for name, value in settings.items() if name != "slots"}
    (near, far), texts = given["depth"], {name: json.dumps(given.get(name)) for name in ("bench", "stroke")}
    planes = json.dumps({"near": near, "far": far, "count": given["planes"]})
    stated = attributes_of(PhaseAttributes, {**given, **texts, "depth": planes}, where)
    given.pop("stroke", None)
    family = {str(name): given.pop(name) for name in ("coefficients", "noll", "radii") if name in given}
    heights = given.pop("heights")
    check_stated(stated, heights.shape, len(given["bands"]), where)
    given |= {"mask": restored_maps(heights, family, stated.stroke), "bench": stated.bench}
    return given | {"channels": given.pop("response"), "cells": given["cells"].long()}


_ARGUMENTS: dict[str, Callable[[dict[str, Any], Any, str], dict[str, Any]]] = {
    "spectral": lambda settings, about, where: {**settings, "bands": about.wavelengths},
    "light-field": lambda settings, about, where: settings,
    "spectral-depth": _masks,
}
"""Arguments of the cameras of version 0.1 from what their files hold."""
