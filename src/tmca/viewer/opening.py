"""From files, folders, names of rendered scenes and things in memory to items."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from tmca.applications.moving import refuse_frames
from tmca.arguments import described
from tmca.cameras import Snapshot, holds_snapshot
from tmca.data import Contents, from_array, holds_rgbd, read_scene, read_spectral_depth
from tmca.data.formats.opening import open_contents
from tmca.data.formats.stored import Stored
from tmca.data.in_memory import bare_cube
from tmca.data.light_fields import find_light_field
from tmca.data.rendering import is_rendered
from tmca.data.spectral_depth import scene_parts
from tmca.data.unlabelled import of_array
from tmca.decoders import Estimate
from tmca.errors import DataError, SettingError
from tmca.lab.display.manifest import NAME as MANIFEST
from tmca.viewer.arrays import array_items
from tmca.viewer.cubes import cube_item
from tmca.viewer.depths import rgbd_item, with_depth
from tmca.viewer.items import Item
from tmca.viewer.light_fields import light_field_item
from tmca.viewer.planes import holds_planes, plane_items
from tmca.viewer.snapshots import export_item, snapshot_items

_VIEWS = 5
"""Views of a side of a rendered light field."""


def open_items(thing: Any, stack: ExitStack, variable: str | None = None, role: str = "") -> list[Item]:
    """What is shown of a file, a folder, a rendered scene's name, labelled data, or an estimate or snapshot.

    Args:
        thing: to be shown.
        stack: closes its file.
        variable: which array, where the file has several.
        role: ``truth`` where it is one.

    Raises:
        DataError: nothing that can be shown, or a damaged or unknown file.
        SettingError: something else.
    """
    if isinstance(thing, str | Path):
        return _from_path(thing, stack, variable, role)
    if isinstance(thing, Snapshot):
        return snapshot_items(thing, str(thing.notes.get("scene") or "snapshot"), role=role)
    if isinstance(thing, Estimate):
        thing = thing.to_xarray().assign(thing.maps)
    return in_memory_items(thing.to_xarray() if hasattr(thing, "to_xarray") else thing, "", role, variable)


def in_memory_items(thing: Any, title: str = "", role: str = "", variable: str | None = None) -> list[Item]:
    """What is shown of labelled data; errors as of `open_items`."""
    contents = memory_contents(thing, title)
    return _items(contents, contents.path.name, variable, {"role": role})


def _from_path(path: str | Path, stack: ExitStack, variable: str | None, role: str) -> list[Item]:
    if is_rendered(str(path).partition(":")[0]):
        return in_memory_items(_rendered(str(path)), str(path), role, variable)
    if (Path(path) / MANIFEST).is_file():
        return [export_item(Path(path), role=role)]
    if variable is None and holds_rgbd(path):
        return [rgbd_item(path, Path(path).name, role=role)]
    if variable is None and scene_parts(Path(path)) is not None:
        return in_memory_items(read_spectral_depth(path, negative="keep"), Path(path).name, role)
    contents = stack.enter_context(open_contents(path))
    if variable is None and _of_live(contents):
        return _recording(contents.path, role)
    return _items(contents, contents.path.name, variable, {"role": role, "check": unchanged(contents.path)})


def _of_live(contents: Contents) -> bool:
    """Whether `tmca live` recorded it."""
    if "recording" not in contents.attrs:
        return False
    from tmca.lab.live import is_recording

    return is_recording(contents.attrs)


def _recording(path: Path, role: str) -> list[Item]:
    """The last frame of what `tmca live` recorded: its estimate if there is one, the snapshot, the codes."""
    from tmca.lab.live import last_recorded

    snapshot, estimate = last_recorded(path)
    shown = [] if estimate is None else in_memory_items(estimate, f"{path.name}, last estimate", role)
    return shown + snapshot_items(snapshot, path.name)


def _rendered(name: str) -> Any:
    """A rendered scene by its name; with a seed after a colon a light field."""
    if ":" in name:
        return read_scene(name, "light-field", views=_VIEWS, colour=True)
    return read_scene(name, bands=None)


def _items(contents: Contents, title: str, variable: str | None, about: dict[str, Any]) -> list[Item]:
    """The items of an open file, by what it holds."""
    if holds_snapshot({*contents.arrays, *_coordinates(contents)}) and variable is None:
        return snapshot_items(Snapshot.load(contents.path), title, **about)
    if variable is None and holds_planes(contents):
        return plane_items(contents, title, **about)
    if variable is None and "estimate" in contents.arrays:
        refuse_frames(contents.path, contents.arrays["estimate"].dims)
    views = find_light_field(contents, variable)
    if views is not None:
        return [light_field_item(contents, views, title, **about)]
    try:
        return [with_depth(cube_item(contents, title, variable, **about), contents)]
    except DataError:
        arrays = array_items(contents, title, variable, **about)
        if not arrays:
            raise
        return arrays


def _coordinates(contents: Contents) -> set[str]:
    return {name for stored in contents.arrays.values() for name in stored.coords}


def memory_contents(thing: Any, name: str = "") -> Contents:
    """Labelled data as if they were in a file.

    Raises:
        SettingError: something without labelled axes.
    """
    import xarray
    from torch import Tensor

    if isinstance(thing, np.ndarray | Tensor):
        thing = of_array(thing, name or "array")
    if (bare := bare_cube(thing)) is not None:
        thing = of_array(bare, name or "array")
    if isinstance(thing, xarray.DataArray):
        thing = thing.to_dataset(name=thing.name or "cube").assign_attrs(thing.attrs)
    if not isinstance(thing, xarray.Dataset):
        expected = "a file's path, labelled data (xarray), an array, an Estimate or a Snapshot"
        raise SettingError("view", described(thing), expected, "label it with tmca.data.label")
    arrays = {str(key): _stored(str(key), array) for key, array in thing.data_vars.items()}
    title = name or str(thing.attrs.get("decoder") or thing.attrs.get("name") or "scene")
    return Contents(Path(title), "in memory", arrays, dict(thing.attrs), labelled=True)


def _stored(name: str, array: Any) -> Stored:
    """An array of labelled data, with its own coordinates and wavelengths."""
    waves = array.coords.get("wavelength")
    metres = None if waves is None or waves.ndim != 1 else np.asarray(waves.values, np.float64)
    dims = tuple(map(str, array.dims))
    coords = {dim: array.indexes[dim].to_numpy() for dim in dims if dim in array.indexes}
    about = {"dims": dims, "coords": coords, "wavelengths": metres, "usual_axis": 0, "full_scale": 1.0}
    return from_array(name, array.values, attrs=dict(array.attrs), **about)


def unchanged(path: Path) -> Callable[[], None]:
    """A check that a file is there, and as large and old as when it was opened."""

    def stamp() -> tuple[int, int] | None:
        try:
            about = path.stat()
        except OSError:
            return None
        return about.st_size, about.st_mtime_ns

    first = stamp()

    def check() -> None:
        now = stamp()
        if now != first:
            found = "it is gone" if now is None else "it was written again since it was opened"
            raise DataError(path, found, "the file that was opened", "start the viewer again")

    return check
