"""Recordings: a Zarr group that grows as frames come, whole up to its last frame whatever ends the process."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from warnings import catch_warnings, simplefilter

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.attributes import OpenAttributes, attributes_of
from tmca.cameras import CAMERAS, Camera, Snapshot
from tmca.data import atomic_path, read_dataset
from tmca.data.atomic import check_target
from tmca.data.folders import output_error, sole_process
from tmca.data.formats.stored import whole_file
from tmca.errors import DataError, OutputError, TmcaError, check_choice
from tmca.lab.live.loop import Shown
from tmca.stored_numbers import check_finite

if TYPE_CHECKING:
    import xarray as xr

FORMAT = "tmca recording 1"
_BLOCK = 64
"""Frames by which arrays grow."""
_FRAMES, _WHOLE, _REMEDY = "frames", "a whole recording", "take an unchanged copy"
_STAGES = ("capture", "wait", "decode", "residual")
FIELDS = ("number", "saturated", "residual", "dropped", *(f"{stage}_s" for stage in _STAGES), "time")
"""Of a frame in ``log``; the time, seconds since 1970, is written last: of a frame that is not whole it is NaN."""


class _About(OpenAttributes):
    """Attributes of a recording."""

    recording: Literal["tmca recording 1"]
    camera: str


_MEANINGS = {
    "snapshot": {"units": "relative irradiance", "long_name": "snapshots, 1 = one channel of a white scene"},
    "estimate": {"units": "1", "long_name": "scenes estimated by the decoder"},
    "log": {"long_name": "what was measured of a frame, see field"},
}


class Recording:
    """``with Recording(path, camera) as recording: recording.add(shown)``.

    The folder holds the camera's variables, and in its group ``frames`` the arrays ``snapshot (frame, …)`` in snapshot
    units, ``log (frame, field)``, see ``FIELDS``, and, if asked for, ``estimate (frame, …)``:
    ``xarray.open_zarr(path, group="frames")``. Where the process was killed, up to 64 rows at the end are NaN: frames
    whose ``log`` has no time are not there.

    Args:
        path: new folder, ``.zarr``.
        camera: that takes the snapshots.
        estimates: record these too.
        scene_shape: of an estimate, ``decoder.scene_shape(camera)``; frames of a scene that moves, (K,
            *camera.scene_shape), have the axis ``slot``. The camera's if None.
        overwrite: replace a recording that is there.

    Raises:
        OutputError: it exists, is no recording, another process records into it, or it cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        camera: Camera,
        *,
        estimates: bool = False,
        scene_shape: tuple[int, ...] | None = None,
        overwrite: bool = False,
    ) -> None:
        self.scene_shape = tuple(scene_shape or camera.scene_shape)
        self.path, self.camera, self.estimates, self.overwrite = Path(path), camera, estimates, overwrite
        self.frames = self._room = 0
        self._arrays: dict[str, Any] = {}
        self._held = ExitStack()
        check_recording(path, overwrite)

    def __enter__(self) -> Recording:
        with ExitStack() as held:
            lock = self.path.with_name(f".{self.path.name}.lock")
            held.enter_context(sole_process(lock, self.path, "a recording"))
            self._begin()
            self._held = held.pop_all()
        return self

    def _begin(self) -> None:
        """Write what is known before the first frame."""
        import xarray as xr
        import zarr

        with atomic_path(self.path, overwrite=self.overwrite) as temporary:
            fields = ("field", list(FIELDS), {"long_name": "what a column of the log is"})
            dataset = self.camera.variables().assign_coords(field=fields).assign_attrs(recording=FORMAT)
            dataset.to_zarr(temporary, mode="w-", consolidated=False, zarr_format=2)
            coordinates = {"field": dataset["field"]} | (self._coordinates() if self.estimates else {})
            frames = xr.Dataset(coords=coordinates)
            frames.to_zarr(temporary, group=_FRAMES, mode="a", consolidated=False, zarr_format=2)
            self._make_arrays(zarr.open_group(temporary / _FRAMES, mode="r+", zarr_format=2))
            _consolidate(temporary)
        group = zarr.open_group(self.path / _FRAMES, mode="r+", zarr_format=2)
        self._arrays = {name: group[name] for name in self._shapes()}

    def __exit__(self, *error: object) -> None:
        with self._held, _writing(self.path):
            self._resize(self.frames)

    def add(self, shown: Shown) -> None:
        """Append a frame.

        Raises:
            OutputError: no room.
        """
        record = [shown.number, shown.saturated, shown.residual, shown.dropped]
        record += [shown.seconds[stage] for stage in _STAGES]
        values = {"snapshot": shown.values[0], "log": torch.tensor([*record, time.time()], dtype=torch.float64)}
        if self.estimates:
            values["estimate"] = shown.estimate.values[0]
        with _writing(self.path):
            if self.frames == self._room:
                self._resize(self._room + _BLOCK)
            for name in sorted(values, key=lambda name: name == "log"):
                self._arrays[name][self.frames] = values[name].numpy(force=True)
        self.frames += 1

    def _resize(self, room: int) -> None:
        """Give all arrays another length; the consolidated metadata, one file, has them change at once."""
        for array in self._arrays.values():
            array.resize((room, *array.shape[1:]))
        _consolidate(self.path)
        self._room = room

    def _coordinates(self) -> dict[Any, Any]:
        """Of the axes of an estimate."""
        labelled = self.camera.label(torch.zeros(1, *self.camera.scene_shape))
        return {name: one.variable for name, one in labelled.coords.items() if one.dims == (name,)}

    def _shapes(self) -> dict[str, tuple[tuple[int, ...], tuple[str, ...]]]:
        """Shape and axes of a frame in every array."""
        seen, still = self.camera.snapshot_shape, tuple(self.camera.scene_shape)
        arrays: dict[str, tuple[tuple[int, ...], tuple[str, ...]]] = {
            "snapshot": (seen, ("channel", *self.camera.snapshot_axes(torch.empty(1, *seen))[-2:]))
        }
        if self.estimates:
            axes = [str(axis) for axis in self.camera.label(torch.zeros(1, *still)).dims]
            slots = ["slot"] if len(self.scene_shape) > len(still) else []
            arrays["estimate"] = (self.scene_shape, (*slots, *axes))
        return {**arrays, "log": ((len(FIELDS),), ("field",))}

    def _make_arrays(self, group: Any) -> None:
        for name, (shape, axes) in self._shapes().items():
            kind = "f8" if name == "log" else "f4"
            array = group.create_array(name, shape=(0, *shape), chunks=(1, *shape), dtype=kind, fill_value=float("nan"))
            array.attrs["_ARRAY_DIMENSIONS"] = ["frame", *axes]
            array.attrs.update(_MEANINGS[name])


def _consolidate(path: Path) -> None:
    """Gather what is said of all arrays of a store in one file."""
    import zarr

    with catch_warnings():
        simplefilter("ignore")  # that version 3 of the format has no such metadata yet
        zarr.consolidate_metadata(path)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """What cannot be written is told in one line."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from error


def check_recording(path: str | Path, overwrite: bool = False) -> None:
    """Say before long work that nothing could be recorded there.

    Raises:
        OutputError: another suffix, no such folder, or what is there must not be replaced.
    """
    path = Path(path)
    if path.suffix != ".zarr":
        raise OutputError(path, f"the suffix {path.suffix!r}", ".zarr", "name it so")
    check_target(path, overwrite)
    if path.exists() and not _is_recording(path):
        raise OutputError(path, "something that is no recording", "a recording, or a new name", "choose another")


def _is_recording(path: Path) -> bool:
    """Whether a folder is one of ours, or empty."""
    try:
        attributes_of(_About, read_dataset(path, ["field"]).attrs, path)
    except TmcaError:
        return path.is_dir() and not any(path.iterdir())
    return True


def recorded(path: str | Path) -> Iterator[Snapshot[Any]]:
    """The snapshots of a recording, one after the other, with what is known of each in their notes.

    Raises:
        DataError: no recording, or one that is damaged.
    """
    path = Path(path)
    camera = _camera(path)
    snapshots, log = _frames(path, camera)
    for place, row in _whole(path, snapshots, log):
        yield _snapshot(path, camera, snapshots, place, row)


def is_recording(attributes: Mapping[str, Any]) -> bool:
    """Whether the attributes of a file are those of a recording."""
    return bool(attributes.get("recording") == FORMAT)


def frames_recorded(path: str | Path) -> int:
    """How many whole frames a recording has; errors as of ``recorded``."""
    path = Path(path)
    return sum(1 for _ in _whole(path, *_frames(path, _camera(path))))


def last_recorded(path: str | Path) -> tuple[Snapshot[Any], xr.DataArray | None]:
    """The last snapshot of a recording, and its estimate, labelled, if estimates were recorded; of a scene that moves
    that of the slot in the middle.

    Raises:
        DataError: no frame, no recording, or one that is damaged.
    """
    path = Path(path)
    camera = _camera(path)
    snapshots, log = _frames(path, camera)
    place, row = next(_whole(path, snapshots, log, backwards=True), (-1, log))
    if place < 0:
        raise DataError(path, "no frame", "one or more", "record again")
    estimates = _estimates(path, camera)
    estimate = None if estimates is None else _estimate(path, camera, estimates, place)
    return _snapshot(path, camera, snapshots, place, row), estimate


def _camera(path: Path) -> Any:
    dataset = read_dataset(path, ["field"])
    about = attributes_of(_About, dataset.attrs, path)
    check_choice("camera", about.camera, CAMERAS)
    return CAMERAS[about.camera].from_variables(dataset, str(path))


def _whole(path: Path, snapshots: Any, log: Any, backwards: bool = False) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Place and log of the frames within which the process was not ended."""
    places = range(min(snapshots.shape[0], log.shape[0]))
    for place in reversed(places) if backwards else places:
        with whole_file(path, _WHOLE):
            row = np.asarray(log[place], dtype=np.float64)
        if np.isfinite(row[-1]):
            yield place, row


def _snapshot(path: Path, camera: Any, snapshots: Any, place: int, row: NDArray[np.float64]) -> Snapshot[Any]:
    values = _values(path, snapshots, place)
    check_finite(row, path, f"log of frame {place}")
    return Snapshot(values[None], camera, dict(zip(FIELDS, row.tolist(), strict=True)))


def _values(path: Path, array: Any, place: int) -> torch.Tensor:
    with whole_file(path, _WHOLE):
        values = np.asarray(array[place], dtype=np.float32)
    check_finite(values, path, f"frame {place}")
    return torch.from_numpy(values)


def _estimates(path: Path, camera: Any) -> Any:
    """The array of estimates, not yet read; None where they were not recorded."""
    from tmca.data.formats.zarr_codecs import open_store

    with whole_file(path, _WHOLE):
        group: Any = open_store(path / _FRAMES)
        array = group.get("estimate")
    if array is not None:
        still = tuple(camera.scene_shape)
        moving = getattr(array, "ndim", 0) == len(still) + 2
        _check_frames(array, (*tuple(array.shape)[1:2], *still) if moving else still, path)
    return array


def _estimate(path: Path, camera: Any, estimates: Any, place: int) -> xr.DataArray:
    values = _values(path, estimates, place)
    moving = values.ndim > len(camera.scene_shape)
    return camera.label(values[len(values) // 2][None] if moving else values[None])


def _frames(path: Path, camera: Camera) -> tuple[Any, Any]:
    """The arrays of snapshots and of the log, not yet read."""
    from tmca.data.formats.zarr_codecs import open_store

    place, shape = path / _FRAMES, tuple(camera.snapshot_shape)
    if not place.is_dir():
        raise DataError(path, f"no group {_FRAMES}", "a recording of `tmca live`")
    with whole_file(path, _WHOLE):
        group: Any = open_store(place)
        arrays = {name: group[name] for name in ("snapshot", "log")}
    for array, one in zip(arrays.values(), (shape, (len(FIELDS),)), strict=True):
        _check_frames(array, one, place)
    return arrays["snapshot"], arrays["log"]


def _check_frames(array: Any, shape: tuple[int, ...], path: Path) -> None:
    """Raise DataError unless an array holds floating point numbers of this shape, a chunk a frame."""
    import zarr

    if not isinstance(array, zarr.Array):
        raise DataError(path, f"a group {array.basename}", "an array", _REMEDY)
    chunks, kind = tuple(array.chunks), np.dtype(array.dtype).kind
    if tuple(array.shape[1:]) != shape or chunks != (1, *shape) or kind != "f":
        found = f"{array.basename} of shape {array.shape} in chunks {chunks}, {array.dtype}"
        raise DataError(path, found, f"frames {shape} of floating point numbers, a chunk each", _REMEDY)
