"""Snapshot files: a capture together with everything that is needed to reconstruct it.

A NetCDF file with the variables ``snapshot`` (y, x_sensor), ``aperture`` (slot, y, x), ``shutter`` (slot, y, x_sensor),
``displacement`` and ``response`` (wavelength), for a coloured aperture ``coloured_aperture`` (wavelength, y, x), and as
attributes the exposure convention, the direction and origin of the dispersion, and the sensor. Behind a dual disperser
the aperture is the wider plane (x_mask), the snapshot is on x.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras.spectral import DISPERSERS, SpectralCamera
from tmca.errors import DataError
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

NEEDED = ("snapshot", "aperture", "shutter", "displacement", "response", "wavelength")
SAID = ("exposure", "disperser", "origin", "full_scale", "sensor")
"""Attributes without which nobody knows what the values mean."""


@dataclass
class Snapshot:
    """A capture and the camera that took it.

    Args:
        values: (1, 1, H, W') snapshot.
        camera: with the codes of the exposure, its dispersion and its sensor.
        notes: what else is known (scene, seed, …), kept as attributes of the file.
    """

    values: Tensor
    camera: SpectralCamera
    notes: dict[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a NetCDF file.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(to_dataset(self), path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Snapshot:
        """Read a file written by ``save``, or laid out like it by other software.

        Raises:
            DataError: not such a file, or a part of it is missing; the message names the part.
        """
        from tmca.data import read_dataset

        return from_dataset(read_dataset(path), str(path))


def to_dataset(snapshot: Snapshot) -> xr.Dataset:
    """The snapshot as a labelled data set."""
    import xarray as xr

    camera = snapshot.camera
    x_aperture, x_sensor = ("x", "x_sensor") if camera.disperser == "single" else ("x_mask", "x")
    aperture, shutter = (_compact(plane.detach()) for plane in camera.codes())
    units = {"units": "relative irradiance", "long_name": "1 = one band of a white scene, everything open"}
    dataset = xr.Dataset(
        {
            "snapshot": (("y", x_sensor), snapshot.values[0, 0].detach().cpu().numpy(), units),
            "aperture": (("slot", "y", x_aperture), aperture, {"long_name": "aperture codes T", "units": "1 = open"}),
            "shutter": (("slot", "y", x_sensor), shutter, {"long_name": "shutter codes S", "units": "1 = open"}),
            "displacement": (
                "wavelength",
                np.array(camera.dispersion.displacement),
                {"units": "pixel", "direction": "along x, towards larger x"},
            ),
            "response": ("wavelength", camera.response.detach().cpu().numpy(), {"long_name": "sensor response"}),
        },
        coords={
            "wavelength": ("wavelength", np.array(camera.wavelengths), {"units": "m"}),
            "wavelength_nm": ("wavelength", np.array(camera.wavelengths) * 1e9, {"units": "nm"}),
        },
        attrs={**snapshot.notes, **_attributes(camera)},
    )
    if camera.coloured is not None:
        values = camera.coloured.detach().cpu().numpy()
        dataset["coloured_aperture"] = (("wavelength", "y", "x"), values, {"long_name": "transmittance", "units": "1"})
    if camera.disperser == "single":
        columns = camera.dispersion.origin + np.arange(camera.snapshot_shape[2])
        dataset = dataset.assign_coords(x_sensor=("x_sensor", columns, {"units": "pixel", "long_name": "scene column"}))
    return dataset


def from_dataset(dataset: xr.Dataset, where: str) -> Snapshot:
    """The snapshot in a data set that was read from ``where``.

    Raises:
        DataError: a variable is missing or does not fit the others.
    """
    missing = [name for name in NEEDED if name not in dataset.variables]
    if missing:
        raise DataError(
            where,
            f"no {', '.join(missing)} (there is: {', '.join(map(str, dataset.variables)) or 'nothing'})",
            "a snapshot with the codes that made it",
            "write it with `tmca simulate` or add the missing variables",
        )
    unsaid = [name for name in SAID if name not in dataset.attrs]
    if unsaid:
        raise DataError(
            where, f"no attribute {', '.join(unsaid)}", f"attributes {', '.join(SAID)}",
            "write it with `tmca simulate` or add them; docs/spectral.md says what they mean",
        )  # fmt: skip
    snapshot = torch.from_numpy(np.array(dataset["snapshot"].values, dtype=np.float32))[None, None]
    if snapshot.ndim != 4 or not bool(torch.isfinite(snapshot).all()):
        raise DataError(where, "a snapshot that is not a finite (y, x) image", "one value per sensor pixel", "mend it")
    _check_geometry(dataset, where)
    camera = _camera(dataset, where)
    _check_origin(dataset, camera, where)
    stated = float(dataset.attrs["full_scale"])
    if abs(stated - camera.full_scale) > 1e-3 * camera.full_scale:
        wanted = f"{camera.full_scale:g}, the sum of the response (times K at per-slot exposure)"
        raise DataError(where, f"full_scale {stated:g}", wanted, "correct the attribute or the response")
    if tuple(snapshot.shape[1:]) != camera.snapshot_shape:
        found, expected = tuple(snapshot.shape[2:]), camera.snapshot_shape[1:]
        raise DataError(where, f"a snapshot of {found} pixels", f"{expected} from its codes and displacement")
    own = {*_attributes(camera)}
    return Snapshot(snapshot, camera, {str(k): v for k, v in dataset.attrs.items() if k not in own})


def _origin(camera: SpectralCamera) -> int:
    """Scene column on which sensor column 0 lies; a dual disperser displaces nothing on the sensor."""
    return camera.dispersion.origin if camera.disperser == "single" else 0


def _check_geometry(dataset: xr.Dataset, where: str) -> None:
    for name, choices in (("disperser", DISPERSERS), ("dispersion_axis", ("x",)), ("camera", ("spectral",))):
        found = dataset.attrs.get(name, choices[0])
        if found not in choices:
            raise DataError(where, f"{name} = {found!r}", f"one of {', '.join(choices)}", "correct the attribute")


def _check_origin(dataset: xr.Dataset, camera: SpectralCamera, where: str) -> None:
    """What the file says of its origin must be what its displacement says."""
    said = [dataset.attrs["origin"]] if "origin" in dataset.attrs else []
    if "x_sensor" in dataset.coords:
        said.append(dataset["x_sensor"].values[0])
    for value in said:
        if value != _origin(camera):
            raise DataError(
                where,
                f"origin {value}",
                f"{_origin(camera)} from the displacement",
                "correct the displacement or the origin (and x_sensor)",
            )


def _camera(dataset: xr.Dataset, where: str) -> SpectralCamera:
    aperture, shutter = (
        torch.from_numpy(np.array(dataset[name].values, dtype=np.float32)) for name in ("aperture", "shutter")
    )
    attrs = dataset.attrs
    dual = attrs.get("disperser", "single") == "dual"
    try:
        height, width = (shutter if dual else aperture).shape[-2:]
        camera = SpectralCamera(
            bands=dataset["wavelength"].values.tolist(),
            size=(height, width),
            slots=aperture.shape[0],
            aperture=aperture,
            shutter=shutter,
            exposure=str(attrs.get("exposure", "equal")),
            dispersion=dataset["displacement"].values.tolist(),
            disperser="dual" if dual else "single",
            response=torch.from_numpy(np.array(dataset["response"].values, dtype=np.float32)),
            relay_blur=_json(attrs, "relay_blur", 0.0, where),
            period=_period(_json(attrs, "period", None, where)),
            sensor=Sensor(**_json(attrs, "sensor", {}, where)),
            coloured=_coloured(dataset),
        )
    except (ValueError, TypeError, IndexError, RuntimeError) as error:
        raise DataError(
            where, f"codes that make no camera ({error})", "aperture, shutter and displacement that fit"
        ) from error
    return camera


def _coloured(dataset: xr.Dataset) -> Tensor | None:
    if "coloured_aperture" not in dataset.variables:
        return None
    ordered = dataset["coloured_aperture"].transpose("wavelength", "y", "x")
    return torch.from_numpy(np.array(ordered.values, dtype=np.float32))


def _attributes(camera: SpectralCamera) -> dict[str, Any]:
    from tmca import __version__

    return {
        "camera": "spectral",
        "exposure": camera.exposure,
        "disperser": camera.disperser,
        "dispersion_axis": "x",
        "origin": _origin(camera),
        "full_scale": camera.full_scale,
        "relay_blur": json.dumps(camera.relay_blur),
        "period": json.dumps(camera.multiplexed.aperture.period),
        "sensor": json.dumps(camera.sensor.settings()),
        "tmca_version": __version__,
    }


def _json(attrs: Mapping[Any, Any], name: str, default: Any, where: str) -> Any:
    try:
        return json.loads(attrs[name]) if name in attrs else default
    except (TypeError, json.JSONDecodeError) as error:
        raise DataError(where, f"attribute {name} = {attrs[name]!r}", "JSON", "correct or delete it") from error


def _period(value: list[int] | None) -> tuple[int, int] | None:
    return None if value is None else (int(value[0]), int(value[1]))


def _compact(codes: Tensor) -> np.ndarray:
    """Binary codes as bytes, grey ones as they are."""
    values = codes.cpu().numpy()
    return values.astype(np.uint8) if np.isin(values, (0, 1)).all() else values
