"""Snapshots: a capture together with everything that is needed to reconstruct it, in memory and as a file."""

from __future__ import annotations

import json
from collections.abc import Collection
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import torch
from pydantic import InstanceOf, Json

from tmca.arguments import checked, described
from tmca.attributes import Attributes, FiniteJson, attributes_of
from tmca.cameras.camera import CAMERAS, Camera, in_a_line
from tmca.codes.arrays import Array
from tmca.codes.files import tensors
from tmca.devices import device_of, enough_memory
from tmca.errors import DataError, SettingError, check_shape
from tmca.plugins import load_plugins
from tmca.summaries import Summary, as_numpy, sizes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Kind = TypeVar("Kind", bound=Camera)
_MEANING = {"units": "relative irradiance", "long_name": "snapshot, 1 = one channel of a white scene, everything open"}
_OF_EVERY_CAMERA = ("camera", "tmca_version")
"""Attributes of `Camera.variables` beside those that its model names."""
_JSON, _SIMPLE = "json_notes", (str, int, float)
"""Attribute that names the notes in JSON, and the types of those that are not."""


@checked
@dataclass(repr=False, eq=False)
class Snapshot(Summary, Generic[Kind]):
    """A capture and the camera that took it.

    Args:
        values: (B, C, H, W') snapshot, B = 1 or the three colours of a light field, in snapshot units.
        camera: with the codes of the exposure, its optics and its sensor.
        notes: what else there is to say (scene, seed, …), attributes of the file.

    Raises:
        SettingError: values that are no numbers, or no camera.
    """

    values: Array
    camera: Kind
    notes: InstanceOf[dict[str, Any]] = field(default_factory=dict)

    def to(self, device: str | torch.device) -> Snapshot[Kind]:
        """The snapshot on a device, its camera a copy there.

        Raises:
            SettingError: a device that is not there, or has too little memory.
        """
        there = device_of(device)
        with enough_memory(there):
            return replace(self, values=self.values.to(there), camera=deepcopy(self.camera).to(there))

    def to_xarray(self) -> xr.Dataset:
        """The snapshot with the codes, optics and sensor that made it, labelled.

        Notes are attributes, those that files cannot hold as JSON; those named as the camera's give way.

        Raises:
            ShapeError: several snapshots, or another size than the camera's.
            SettingError: values that are not finite.
        """
        from tmca.data.axes import colour_axis

        dataset, axes = self.camera.variables(), self.camera.snapshot_axes(self.values)
        colours = 3 if "colour" in axes else 1
        remedy = "several snapshots are saved one by one"
        check_shape("values", self.values, (colours, *self.camera.snapshot_shape), remedy)
        values = self.values.numpy(force=True)
        if unknown := int((~np.isfinite(values)).sum()):
            raise SettingError("values", f"{unknown} that are not finite", "finite numbers", "fill them in")
        dataset["snapshot"] = (axes, values.reshape(_shape(values, axes, self.camera.buckets)), _MEANING)
        if colours == 3:
            dataset = dataset.assign_coords(colour=colour_axis())
        dataset.attrs = {**_stored_notes(self.notes), **dataset.attrs}
        return dataset

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a NetCDF file.

        Raises:
            ShapeError, SettingError: as ``to_xarray``.
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(self.to_xarray(), path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Snapshot[Any]:
        """Read a file written by ``save``, or laid out like it by other software.

        Raises:
            DataError: not such a file, or a part of it is missing; the message names the part.
        """
        from tmca.data import read_dataset

        return cls.from_dataset(read_dataset(path), path)

    @classmethod
    def from_dataset(cls, dataset: xr.Dataset, path: str | Path) -> Snapshot[Any]:
        """The snapshot in the contents of a file; errors as of ``load``."""
        kind = attributes_of(_SnapshotAttributes, dataset.attrs, path).camera
        if kind not in CAMERAS:
            load_cameras()
        if kind not in CAMERAS:
            found = f"camera = {described(kind)}"
            raise DataError(path, found, f"one of {', '.join(CAMERAS)}", "correct the attribute")
        _check_complete(dataset, path, CAMERAS[kind])
        camera = CAMERAS[kind].from_variables(dataset, str(path))
        stated = attributes_of(camera.attributes, dataset.attrs, path).full_scale
        if abs(stated - camera.full_scale) > 1e-3 * camera.full_scale:
            wanted = f"{camera.full_scale:g}, the sum of the response (times K at per-slot exposure)"
            raise DataError(path, f"attribute full_scale {stated:g}", wanted, "correct the attribute or the response")
        values = _values(dataset, camera, str(path))
        of_camera = {*camera.attributes.model_fields, *_OF_EVERY_CAMERA}
        notes = {str(name): value for name, value in dataset.attrs.items() if name not in of_camera}
        return Snapshot(values, camera, _read_notes(notes, str(path)))

    @property
    def averaged(self) -> str:
        """What `image` is the mean of, for its title; nothing of one channel."""
        if len(self.values) == 3 and "colour" in self.camera.snapshot_axes(self.values):
            return ", mean of red, green and blue"
        channels = self.camera.snapshot_shape[0] // self.camera.buckets
        return f", mean of {channels} channels" if channels > 1 else ""

    def image(self) -> np.ndarray:
        """(H, W') mean of its colours or channels; of several buckets (R, H, W')."""
        buckets = self.values.unflatten(1, (self.camera.buckets, -1)).mean((0, 2)).numpy(force=True)
        return buckets if self.camera.buckets > 1 else buckets[0]

    def plot(self) -> Figure:
        """The snapshot as a picture."""
        from tmca.plots.codes import snapshot_figure

        title = f"{self.camera.kind}, K = {self.camera.slots}{self.averaged}"
        return snapshot_figure(self.image(), self.camera.full_scale, self.camera.channel, title)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray[Any, Any]:
        """The values (B, C, H, W') for NumPy."""
        return as_numpy(self.values, dtype, copy)

    def _facts(self) -> dict[str, str]:
        return {
            "camera": in_a_line(self.camera),
            "values": f"{sizes(self.values.shape)}, full scale {self.camera.full_scale:.4g}",
            "noise": self.camera.noise.in_words(),
            "scene": f"{self.notes.get('scene', '')}{self._some_bands()}",
        }

    def _some_bands(self) -> str:
        """How many of the scene's bands were imaged, where it has more."""
        there = self.notes.get("source_bands")
        return f", {len(self.camera.wavelengths)} of {there} bands" if there else ""

    def _picture(self) -> Figure:
        from tmca.plots.thumbnails import Panel, row_figure

        image = self.image()
        shown = image if image.ndim == 2 else np.concatenate([*image], -1)
        return row_figure([Panel("snapshot", shown, bar="snapshot units"), *self.camera._panels()])


def _stored_notes(notes: dict[str, Any]) -> dict[str, Any]:
    """Notes as attributes; what is no text and no number as JSON, which a list of names says."""
    from tmca.data.files import plain as in_json

    values = {name: in_json(value) for name, value in notes.items()}
    coded = [name for name, value in values.items() if isinstance(value, bool) or not isinstance(value, _SIMPLE)]
    stored = {name: json.dumps(value, ensure_ascii=False) if name in coded else value for name, value in values.items()}
    return {**stored, **({_JSON: json.dumps(coded)} if coded else {})}


class _SnapshotAttributes(Attributes):
    camera: str = "spectral"
    json_notes: Json[tuple[str, ...]] = ()


class _Note(Attributes):
    note: FiniteJson


class _JsonNote(_Note):
    note: Json[FiniteJson]


def _read_notes(attributes: dict[str, Any], where: str) -> dict[str, Any]:
    coded = attributes_of(_SnapshotAttributes, attributes, where).json_notes
    kinds: dict[str, type[_Note]] = {name: _JsonNote if name in coded else _Note for name in attributes}
    return {
        name: attributes_of(kinds[name], {"note": value}, where, f"attribute {name}:").note
        for name, value in attributes.items()
        if name != _JSON
    }


def load_cameras() -> None:
    """Import the cameras of other packages, each with its application."""
    load_plugins("tmca.cameras", _registered, "a module with a subclass of Camera that has a kind")


def _registered() -> Collection[type[Camera]]:
    return CAMERAS.values()


def holds_snapshot(variables: set[str]) -> bool:
    """Whether these are the variables of a snapshot file, coordinates apart."""
    return "snapshot" in variables and any(set(kind.needed) - {"wavelength"} <= variables for kind in CAMERAS.values())


def _check_complete(dataset: xr.Dataset, where: str | Path, kind: type[Camera]) -> None:
    """Raises DataError unless a snapshot and all variables of a kind of camera are there."""
    if missing := [name for name in ("snapshot", *kind.needed) if name not in dataset.variables]:
        there = f"no {', '.join(missing)} (there is: {', '.join(map(str, dataset.variables)) or 'nothing'})"
        remedy = "write it with `tmca simulate` or add the missing variables"
        raise DataError(where, there, "a snapshot with the codes that made it", remedy)


def _shape(values: np.ndarray, axes: tuple[str, ...], buckets: int) -> tuple[int, ...]:
    """Shape of snapshots (B, R·C, H, W') on these axes: of batch, buckets and channels what is named."""
    batch, channels, *frame = values.shape
    sizes = {"colour": batch, "bucket": buckets, "channel": channels // buckets}
    return (*(size for name, size in sizes.items() if name in axes), *frame)


def _values(dataset: xr.Dataset, camera: Camera, where: str) -> torch.Tensor:
    """(B, C, H, W') of a file.

    Raises:
        DataError: other axes or sizes than the camera's, or values that are not finite.
    """
    stored, values = dataset["snapshot"], tensors(dataset, where, "snapshot")["snapshot"]
    colours = "colour" in stored.dims
    batch = values if colours else values[None]
    batch = batch.flatten(1, 2) if {"bucket", "channel"} <= {*stored.dims} and batch.ndim == 5 else batch
    channels, height, width = camera.snapshot_shape
    batch = batch if "channel" in stored.dims or channels > 1 else batch[:, None]
    if batch.ndim != 4 or tuple(batch.shape[1:]) != camera.snapshot_shape:
        there = f"a snapshot of {'×'.join(map(str, batch.shape[1:]))} (channels, rows, columns)"
        raise DataError(where, there, f"{channels}×{height}×{width} from its codes and geometry")
    return batch
