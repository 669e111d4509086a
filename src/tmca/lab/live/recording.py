"""Recordings: a Zarr group that grows as frames come, whole up to its last frame whatever ends the process."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal
from warnings import catch_warnings, simplefilter

import numpy as np
import torch

from tmca.attributes import OpenAttributes, attributes_of
from tmca.cameras import CAMERAS, Camera, Snapshot
from tmca.data import atomic_path, read_dataset
from tmca.data.folders import output_error
from tmca.data.formats.stored import whole_file
from tmca.data.formats.zarr_metadata import check_store
from tmca.errors import DataError, OutputError, check_choice
from tmca.lab.live.loop import Shown
from tmca.stored_numbers import check_finite

FORMAT = "tmca recording 1"
_BLOCK = 64
"""Frames by which arrays grow: they are seldom of unequal length, for a moment."""
_FRAMES, _WHOLE = "frames", "a whole recording"
FIELDS = ("number", "saturated", "residual", "dropped", "capture_s", "wait_s", "decode_s", "time")
"""Of a frame in ``log``; the time, seconds since 1970, is written last: of a frame that is not whole it is NaN."""


class _About(OpenAttributes):
    """Attributes of a recording."""

    recording: Literal["tmca recording 1"]
    camera: str


class Recording:
    """``with Recording(path, camera) as recording: recording.add(shown)``.

    The folder holds the camera's variables, and in its group ``frames`` the arrays ``snapshot (frame, …)`` in snapshot
    units, ``log (frame, field)``, see ``FIELDS``, and, if asked for, ``estimate (frame, …)``:
    ``xarray.open_zarr(path, group="frames")``. Rows of ``log`` without a time are frames that are not there.

    Args:
        path: new folder, ``.zarr``.
        camera: that takes the snapshots.
        estimates: record these too.
        overwrite: replace a recording that is there.

    Raises:
        OutputError: it exists, or cannot be written.
    """

    def __init__(self, path: str | Path, camera: Camera, *, estimates: bool = False, overwrite: bool = False) -> None:
        self.path, self.camera, self.estimates, self.overwrite = Path(path), camera, estimates, overwrite
        self.frames = self._room = 0
        self._arrays: dict[str, Any] = {}
        if self.path.suffix != ".zarr":
            raise OutputError(self.path, f"the suffix {self.path.suffix!r}", ".zarr", "name it so")

    def __enter__(self) -> Recording:
        import zarr

        with atomic_path(self.path, overwrite=self.overwrite) as temporary:
            dataset = self.camera.variables().assign_coords(field=list(FIELDS)).assign_attrs(recording=FORMAT)
            dataset.to_zarr(temporary, mode="w-", consolidated=False, zarr_format=2)
            self._make_arrays(zarr.open_group(temporary, mode="r+", zarr_format=2).create_group(_FRAMES))
        group = zarr.open_group(self.path / _FRAMES, mode="r+", zarr_format=2)
        self._arrays = {name: group[name] for name in self._shapes()}
        return self

    def __exit__(self, *error: object) -> None:
        import zarr

        for array in self._arrays.values():
            array.resize((self.frames, *array.shape[1:]))
        with catch_warnings():
            simplefilter("ignore")  # that version 3 of the format has no such metadata yet
            zarr.consolidate_metadata(self.path)

    def add(self, shown: Shown) -> None:
        """Append a frame.

        Raises:
            OutputError: no room.
        """
        record = [shown.number, shown.saturated, shown.residual, shown.dropped]
        record += [shown.seconds[name] for name in ("capture", "wait", "decode")]
        values = {"snapshot": shown.values[0], "log": torch.tensor([*record, time.time()], dtype=torch.float64)}
        if self.estimates:
            values["estimate"] = shown.estimate.values[0]
        try:
            self._grow()
            for name in sorted(values, key=lambda name: name == "log"):
                self._arrays[name][self.frames] = values[name].numpy(force=True)
        except OSError as error:
            raise output_error(self.path, error) from error
        self.frames += 1

    def _grow(self) -> None:
        if self.frames == self._room:
            self._room += _BLOCK
            for array in self._arrays.values():
                array.resize((self._room, *array.shape[1:]))

    def _shapes(self) -> dict[str, tuple[tuple[int, ...], tuple[str, ...]]]:
        """Shape and axes of a frame in every array."""
        seen, scene = self.camera.snapshot_shape, tuple(self.camera.scene_shape)
        arrays = {"snapshot": (seen, ("channel", *self.camera.snapshot_axes(torch.empty(1, *seen))[-2:]))}
        if self.estimates:
            arrays["estimate"] = (scene, self.camera.label(torch.zeros(1, *scene)).dims)
        return {**arrays, "log": ((len(FIELDS),), ("field",))}

    def _make_arrays(self, group: Any) -> None:
        for name, (shape, axes) in self._shapes().items():
            kind = "f8" if name == "log" else "f4"
            array = group.create_array(name, shape=(0, *shape), chunks=(1, *shape), dtype=kind, fill_value=float("nan"))
            array.attrs["_ARRAY_DIMENSIONS"] = ["frame", *axes]


def recorded(path: str | Path) -> Iterator[Snapshot[Any]]:
    """The snapshots of a recording, one after the other, with what is known of each in their notes.

    Raises:
        DataError: no recording, or one that is damaged.
    """
    path = Path(path)
    dataset = read_dataset(path, ["field"])
    about = attributes_of(_About, dataset.attrs, path)
    check_choice("camera", about.camera, CAMERAS)
    camera = CAMERAS[about.camera].from_variables(dataset, str(path))
    snapshots, log = _frames(path, camera)
    for place in range(min(snapshots.shape[0], log.shape[0])):
        with whole_file(path, _WHOLE):
            row, values = np.asarray(log[place], dtype=np.float64), np.asarray(snapshots[place], dtype=np.float32)
        if not np.isfinite(row[-1]):
            continue  # the process was ended within it
        check_finite(values, path, f"frame {place}")
        yield Snapshot(torch.from_numpy(values)[None], camera, dict(zip(FIELDS, row.tolist(), strict=True)))


def _frames(path: Path, camera: Camera) -> tuple[Any, Any]:
    """The arrays of snapshots and of the log, not yet read."""
    import zarr

    place = path / _FRAMES
    if not place.is_dir():
        raise DataError(path, f"no group {_FRAMES}", "a recording of `tmca live`")
    check_store(place)
    with whole_file(path, _WHOLE):
        group = zarr.open_group(place, mode="r")
        snapshots, log = group["snapshot"], group["log"]
        shapes = [tuple(array.shape[1:]) for array in (snapshots, log)]
        kinds = {np.dtype(array.dtype).kind for array in (snapshots, log)}
    if shapes != [tuple(camera.snapshot_shape), (len(FIELDS),)] or kinds != {"f"}:
        expected = f"{[tuple(camera.snapshot_shape), (len(FIELDS),)]} numbers"
        raise DataError(place, f"frames of {shapes}", expected, "take an unchanged copy")
    return snapshots, log
