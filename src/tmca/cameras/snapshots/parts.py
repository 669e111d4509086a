"""What snapshot files of every camera share: codes, sensor, exposure, and the checks of what is read."""

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

UNITS = {"units": "relative irradiance"}
Kind = TypeVar("Kind", bound=Camera)


def tile_attribute(camera: CodedCamera) -> dict[str, str]:
    """The tile of the codes."""
    return {"period": json.dumps(camera.codes.aperture.period)}


def code_planes(camera: CodedCamera, aperture_on: Sequence[str], shutter_on: Sequence[str]) -> dict[str, Any]:
    """Variables ``aperture`` and ``shutter``, slot by slot on these axes; binary codes as bytes."""
    aperture, shutter = (compact(plane.detach()) for plane in camera.codes())
    return {
        "aperture": (("slot", *aperture_on), aperture, {"long_name": "aperture codes T", "units": "1 = open"}),
        "shutter": (("slot", *shutter_on), shutter, {"long_name": "shutter codes S", "units": "1 = open"}),
    }


def common_attributes(camera: Camera) -> dict[str, Any]:
    """Attributes of every snapshot file."""
    from tmca import __version__

    return {
        "camera": camera.kind,
        "exposure": camera.exposure,
        "full_scale": camera.full_scale,
        "sensor": json.dumps(camera.sensor.settings()),
        "tmca_version": __version__,
    }


def check_said(dataset: xr.Dataset, where: str, needed: Sequence[str], said: Sequence[str], page: str) -> None:
    """Raises DataError unless the variables and attributes are there."""
    missing = [name for name in needed if name not in dataset.variables]
    if missing:
        raise DataError(
            where,
            f"no {', '.join(missing)} (there is: {', '.join(map(str, dataset.variables)) or 'nothing'})",
            "a snapshot with the codes that made it",
            "write it with `tmca simulate` or add the missing variables",
        )
    unsaid = [name for name in said if name not in dataset.attrs]
    if unsaid:
        remedy = f"write it with `tmca simulate` or add them; {page} says what they mean"
        raise DataError(where, f"no attribute {', '.join(unsaid)}", f"attributes {', '.join(said)}", remedy)


def check_values(dataset: xr.Dataset, where: str, axes: Sequence[str]) -> Tensor:
    """The snapshot as (B, 1, H, W'), B the colours of a snapshot (colour, y, x), else 1.

    Raises:
        DataError: other axes, or values that are not finite.
    """
    values = torch.from_numpy(np.array(dataset["snapshot"].values, dtype=np.float32))
    if values.ndim != len(axes) or not bool(torch.isfinite(values).all()):
        found = f"a snapshot that is not a finite ({', '.join(axes)}) image"
        raise DataError(where, found, "one value per sensor pixel", "mend it")
    return values.reshape(-1, 1, *values.shape[-2:])


def read_planes(dataset: xr.Dataset) -> dict[str, Any]:
    """``aperture`` and ``shutter`` (K, …) and ``slots``."""
    planes = {n: torch.from_numpy(np.array(dataset[n].values, dtype=np.float32)) for n in ("aperture", "shutter")}
    return {**planes, "slots": planes["aperture"].shape[0]}


def settings_of(attrs: Mapping[Any, Any], where: str) -> dict[str, Any]:
    """Arguments of a camera that are the same for all: ``exposure``, ``period``, ``sensor``."""
    period = json_attribute(attrs, "period", None, where)
    try:
        sensor = Sensor(**json_attribute(attrs, "sensor", {}, where))
    except (ValueError, TypeError) as error:
        raise DataError(where, f"a sensor that is none ({error})", "settings of a sensor", "correct it") from error
    tile = None if period is None else (int(period[0]), int(period[1]))
    return {"exposure": str(attrs.get("exposure", "equal")), "period": tile, "sensor": sensor}


def camera_from(kind: type[Kind], where: str, wanted: str, **settings: Any) -> Kind:
    """The camera of these settings.

    Raises:
        DataError: they make none.
    """
    try:
        return kind(**settings)
    except (ValueError, TypeError, IndexError, RuntimeError) as error:
        raise DataError(where, f"codes that make no camera ({error})", wanted) from error


def check_full_scale(dataset: xr.Dataset, camera: Camera, where: str) -> None:
    """Raises DataError unless snapshot and stated full scale are those of the camera."""
    stated, known = float(dataset.attrs["full_scale"]), camera.full_scale
    if abs(stated - known) > 1e-3 * known:
        wanted = f"{known:g}, the sum of the response (times K at per-slot exposure)"
        raise DataError(where, f"full_scale {stated:g}", wanted, "correct the attribute or the response")
    found, expected = tuple(dataset["snapshot"].shape[-2:]), camera.snapshot_shape[1:]
    if found != expected:
        raise DataError(where, f"a snapshot of {found} pixels", f"{expected} from its codes and geometry")


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
