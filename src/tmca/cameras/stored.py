"""What descriptions of every camera on disk share: codes, sensor, exposure, and the checks of what is read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from tmca.cameras.camera import Camera
from tmca.cameras.coded import CodedCamera
from tmca.errors import DataError
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

Kind = TypeVar("Kind", bound=Camera)


def code_planes(camera: CodedCamera, aperture_axes: Sequence[str], shutter_axes: Sequence[str]) -> dict[str, Any]:
    """Variables ``aperture`` and ``shutter``, slot by slot on these axes; binary codes as bytes."""
    aperture, shutter = (compact(plane.detach()) for plane in camera.codes())
    return {
        "aperture": (("slot", *aperture_axes), aperture, {"long_name": "aperture codes T", "units": "1 = open"}),
        "shutter": (("slot", *shutter_axes), shutter, {"long_name": "shutter codes S", "units": "1 = open"}),
    }


def common_attributes(camera: Camera) -> dict[str, Any]:
    """Attributes of every camera in a file."""
    from tmca import __version__

    attributes = {
        "camera": camera.kind,
        "exposure": camera.exposure,
        "full_scale": camera.full_scale,
        "sensor": json.dumps(camera.sensor.settings()),
        "tmca_version": __version__,
    }
    if isinstance(camera, CodedCamera):
        attributes["period"] = json.dumps(camera.codes.aperture.period)
    return attributes


def wavelength_coordinates(wavelengths: Sequence[float]) -> dict[str, Any]:
    """Coordinates ``wavelength`` in metres and ``wavelength_nm``."""
    metres = np.array(wavelengths)
    return {
        "wavelength": ("wavelength", metres, {"units": "m"}),
        "wavelength_nm": ("wavelength", metres * 1e9, {"units": "nm"}),
    }


def check_complete(dataset: xr.Dataset, where: str, kind: type[Camera]) -> None:
    """Raises DataError unless all variables and attributes of a kind of camera are there."""
    missing = [name for name in kind.needed if name not in dataset.variables]
    if missing:
        there = f"no {', '.join(missing)} (there is: {', '.join(map(str, dataset.variables)) or 'nothing'})"
        remedy = "write it with `tmca simulate` or add the missing variables"
        raise DataError(where, there, "a snapshot with the codes that made it", remedy)
    unstated = [name for name in kind.stated if name not in dataset.attrs]
    if unstated:
        remedy = f"write it with `tmca simulate` or add them; {kind.page} says what they mean"
        raise DataError(where, f"no attribute {', '.join(unstated)}", f"attributes {', '.join(kind.stated)}", remedy)


def tensors(dataset: xr.Dataset, *names: str) -> dict[str, Tensor]:
    """Variables as float32 tensors."""
    return {name: torch.from_numpy(np.array(dataset[name].values, dtype=np.float32)) for name in names}


def common_settings(attrs: Mapping[Any, Any], where: str) -> dict[str, Any]:
    """Arguments that all cameras have: ``exposure`` and ``sensor``.

    Raises:
        DataError: no sensor.
    """
    try:
        sensor = Sensor(**json_attribute(attrs, "sensor", {}, where))
    except (ValueError, TypeError) as error:
        raise DataError(where, f"a sensor that is none ({error})", "settings of a sensor", "correct it") from error
    return {"exposure": str(attrs.get("exposure", "equal")), "sensor": sensor}


def code_settings(dataset: xr.Dataset, where: str) -> dict[str, Any]:
    """Arguments of a coded camera: ``aperture``, ``shutter``, ``slots``, ``period``, and the common ones."""
    period = json_attribute(dataset.attrs, "period", None, where)
    planes = tensors(dataset, "aperture", "shutter")
    tile = None if period is None else (int(period[0]), int(period[1]))
    common = common_settings(dataset.attrs, where)
    return {**planes, "slots": planes["aperture"].shape[0], "period": tile, **common}


def made_from(kind: type[Kind], dataset: xr.Dataset, where: str, expected: str, **settings: Any) -> Kind:
    """The camera of these settings, its full scale the stated one.

    Raises:
        DataError: they make none, or one of another full scale.
    """
    try:
        camera = kind(**settings)
    except (ValueError, TypeError, IndexError, RuntimeError) as error:
        raise DataError(where, f"codes that make no camera ({error})", expected) from error
    stated = float(dataset.attrs["full_scale"])
    if abs(stated - camera.full_scale) > 1e-3 * camera.full_scale:
        wanted = f"{camera.full_scale:g}, the sum of the response (times K at per-slot exposure)"
        raise DataError(where, f"full_scale {stated:g}", wanted, "correct the attribute or the response")
    return camera


def json_attribute(attrs: Mapping[Any, Any], name: str, default: Any, where: str) -> Any:
    """An attribute that holds JSON.

    Raises:
        DataError: it does not.
    """
    try:
        return json.loads(attrs[name]) if name in attrs else default
    except (TypeError, json.JSONDecodeError) as error:
        raise DataError(where, f"attribute {name} = {attrs[name]!r}", "JSON", "correct or delete it") from error


def compact(codes: Tensor) -> np.ndarray:
    """Binary codes as bytes, grey ones as they are."""
    values = codes.cpu().numpy()
    return values.astype(np.uint8) if np.isin(values, (0, 1)).all() else values
