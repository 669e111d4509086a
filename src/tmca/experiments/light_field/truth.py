"""The true light field of a snapshot or an estimate: read as its scene was read, and what the estimate errs by."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import LightFieldCamera, Snapshot
from tmca.data.light_field_scenes import load_light_field, true_disparity
from tmca.data.scene_names import READING
from tmca.errors import DataError, SettingError
from tmca.plots.light_field import light_field_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr

Told = Callable[[str], None]
_FILES = ("scale", "pattern", "lens")
"""Of a reading, what applies to files alone."""


def true_light_field(
    source: str, snapshot: Snapshot[LightFieldCamera], *, told: Told | None = None, **given: Any
) -> xr.DataArray:
    """The light field of a snapshot, at its views, size and colours, read as `truth_reading` says.

    Raises:
        SettingError: the snapshot's own scene with another ``scale``, ``pattern`` or ``lens``.
        DataError: it is smaller than the snapshot's scene, or has fewer views.
    """
    camera = snapshot.camera
    own: dict[str, Any] = {"views": camera.views[0], "size": camera.size, "colour": len(snapshot.values) > 1}
    return _load_as_large(source, own, truth_reading(snapshot.notes, source, told, **given))


def _load_as_large(source: str, own: Mapping[str, Any], reading: Mapping[str, Any]) -> xr.DataArray:
    """The views and pixels of a light field that a snapshot or an estimate has.

    Raises:
        DataError: it has fewer.
    """
    try:
        return load_light_field(source, **own, **reading)
    except SettingError as error:
        if error.where not in ("views", "crop") or not Path(source).exists():
            raise
        (rows, columns), (height, width) = _extent(source, reading)
        scale, views, size = reading.get("scale") or 1, own["views"], own["size"]
        found = f"{rows}×{columns} views of {height // scale}×{width // scale} pixels"
        found += "" if scale == 1 else f" at scale {scale}"
        wanted = f"at least the {views}×{views} views of {size[0]}×{size[1]} pixels that are compared with it"
        raise DataError(source, found, wanted, "name the scene of the snapshot") from error


def _extent(source: str, reading: Mapping[str, Any]) -> tuple[tuple[int, int], tuple[int, int]]:
    """(Rows, columns) of the views of a light field from files, and (height, width) of each."""
    from tmca.data.light_fields import VIEW_DIMS, find_light_field, no_light_field, open_light_field

    with open_light_field(source, reading.get("pattern"), reading.get("lens")) as contents:
        stored = find_light_field(contents)
        if stored is None:
            raise no_light_field(contents)
        rows, columns, height, width = (stored.shape[stored.dims.index(dim)] for dim in VIEW_DIMS)
    return (rows, columns), (height, width)


def truth_reading(notes: Mapping[str, Any], source: str, told: Told | None = None, **given: Any) -> dict[str, Any]:
    """Arguments of ``load_light_field`` for the truth of a scene whose reading is noted.

    The noted ``scale``, ``pattern`` and ``lens`` are the default for the same source, the noted ``scale`` for every
    other one from files: its pixels have to be as large as the estimate's.

    Args:
        notes: of a snapshot, or attributes of an estimate.
        source: the truth, a path or the name of a rendered scene.
        told: hears one line where the truth is not the noted scene.
        given: arguments that are known.

    Raises:
        SettingError: one of ``given`` is not as noted for the same source.
    """
    noted, known = _noted(notes), {name: value for name, value in given.items() if value is not None}
    same = bool(noted) and same_source(str(noted.get("source", "")), source)
    if not noted or not (same or Path(source).exists()):
        return known
    kept = {name: noted[name] for name in (_FILES if same else ("scale",)) if noted.get(name) is not None}
    for name, value in known.items():
        if same and name in kept and value != kept[name]:
            raise SettingError(
                name, _text(value), f"{_text(kept[name])}, as the snapshot's scene was read", "leave it out"
            )
    found = {**kept, **known}
    if told is not None and not same:
        told(f"{source} is not the snapshot's scene, {noted.get('source')}; read with scale {found.get('scale', 1)}")
    return found


def same_source(noted: str, source: str) -> bool:
    """Whether the two name one scene; a path that is gone is known by its last part."""
    one, other = Path(noted), Path(source)
    if not (one.exists() or other.exists()):
        return noted == source
    return one.resolve() == other.resolve() or (not one.exists() and one.name == other.resolve().name)


def _noted(notes: Mapping[str, Any]) -> dict[str, Any]:
    """The reading of a scene as it was noted, {} without."""
    try:
        noted = json.loads(notes.get(READING, "{}"))
        return {**noted, "lens": tuple(noted["lens"])} if noted.get("lens") else dict(noted)
    except (TypeError, ValueError, AttributeError) as error:
        found = repr(notes[READING])
        raise DataError(f"attribute {READING}", found, "JSON as `tmca simulate` writes it", "delete it") from error


def _text(value: Any) -> str:
    return "×".join(map(str, value)) if isinstance(value, tuple) else str(value)


def evaluate_light_field(
    estimate: str | Path,
    truth: str,
    *,
    figure: Path | None = None,
    overwrite: bool = False,
    told: Told | None = None,
    **given: Any,
) -> dict[str, float]:
    """Metrics of one light-field file against another: quality, and disparity where the truth's is known.

    The centre views and the middle of the truth are taken, read as `truth_reading` says of the estimate's attributes.

    Raises:
        DataError: a truth that is smaller than the estimate, or has fewer views.
        SettingError: the truth is the estimate's own scene with another ``scale``, ``pattern`` or ``lens``.
    """
    from tmca.metrics import light_field_metrics

    if figure is not None and Path(estimate).resolve() == figure.resolve():
        raise SettingError("--figure", str(figure), "another file than the estimate")
    own = stored_estimate(estimate)
    reading = truth_reading(own.attrs, truth, told, **given)
    reference = _load_as_large(truth, like(own), reading)
    found = light_field_metrics(own.values, reference.values)
    found |= geometry(own, truth, reading.get("scale"), reading.get("pattern"))
    if figure is not None:
        drawing = light_field_figure({Path(estimate).stem: own.values}, reference.values)
        save_figure(drawing, figure, overwrite=overwrite)
    return found


def stored_estimate(path: str | Path) -> xr.DataArray:
    """A reconstructed light field as it is stored: all views, its colours, values above 1 as they are, and as an
    attribute how its scene was read.

    Raises:
        DataError: none is in the file, or its views are no odd square.
    """
    from tmca.data import light_fields

    with light_fields.open_light_field(path) as contents:
        stored = light_fields.find_light_field(contents)
        if stored is None:
            raise light_fields.no_light_field(contents)
        kept, colour = 1.0 if stored.dtype.kind == "f" else None, light_fields.has_colour(stored)
        found = light_fields.load_views(contents, stored, colour=colour, divide_by=kept)
        noted = {READING: contents.attrs[READING]} if READING in contents.attrs else {}
    return found.assign_attrs(noted)


def like(light_field: xr.DataArray) -> dict[str, Any]:
    """Arguments of ``load_light_field`` for the same views, size and colours."""
    size = (light_field.sizes["y"], light_field.sizes["x"])
    return {"views": light_field.sizes["view_v"], "size": size, "colour": "colour" in light_field.dims}


def geometry(
    light_field: xr.DataArray, source: str, scale: int | None = None, pattern: str | None = None
) -> dict[str, float]:
    """Error of the disparity that the views show, against the true one of their source; nothing without one."""
    from tmca.metrics import disparity_error, estimate_disparity

    truth = true_disparity(source, light_field, scale, pattern)
    if truth is None:
        return {}
    found = disparity_error(estimate_disparity(light_field.values), truth.values)
    return {"disparity_mae": found["mae"], "disparity_badpix": found["badpix"]}
