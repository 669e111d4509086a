"""What a file holds, for people and programs: the content behind ``tmca inspect``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.cubes import locate_cube
from tmca.data.depth_maps import label_depth, read_depth_map, stored_metres
from tmca.data.files import plain
from tmca.data.fitting import said_mapped
from tmca.data.formats.opening import open_contents
from tmca.data.formats.stored import Contents, Stored, from_array
from tmca.data.formats.wavelengths import divisor, few_counts, metres_to_nm
from tmca.data.light_fields import (
    VIEW_DIMS,
    find_disparity,
    find_light_field,
    has_colour,
    load_views,
    open_light_field,
    read_disparity,
)
from tmca.data.pixels import wrong_size
from tmca.data.rgbd import holds_rgbd, read_rgbd
from tmca.data.spectral_depth import scene_parts
from tmca.errors import DataError, ShapeError, TmcaError

if TYPE_CHECKING:
    import xarray as xr


def describe(
    path: str | Path, variable: str | None = None, *, pattern: str | None = None, lens: tuple[int, int] | None = None
) -> dict[str, Any]:
    """Shape, type, wavelengths and statistics of a file and of every variable in it.

    The statistics are of the stored values; ``zero_share`` and ``saturated_share`` are the shares of elements
    at 0 and at or above full scale (the type's maximum, a known set's, or the array's own maximum above 1).

    Args:
        path: any file that `read` or `read_array` opens.
        variable: the array to put first, where the file has several.
        pattern: of the file names of a folder of views, as in `read_light_field`.
        lens: (rows, columns) of the views under a lens of a lenslet picture, as in `read_light_field`.

    Returns:
        Plain JSON types: ``kind`` ("cube", "light field", "RGB-D scene", "spectral-depth scene" of a folder with both,
        "dataset" with named axes, "array" or "arrays"), ``format``,
        ``variables``, ``attrs``; for a cube or a single array its own entry of ``variables`` again at the top
        level, with ``wavelengths`` (None without), and for a light field ``light_field``: its ``views``, ``size``,
        ``colour``, naming, ``shifts`` between views and ``disparity`` (None without). What has depth has ``depth``: its
        range in metres if it is ``metric``, and unknown pixels. ``note`` says why a file with
        a three-axis array is no cube, a light field cannot be read whole, or a cube's scale may be another.

    Raises:
        DataError: missing, damaged or unknown file, or no such variable.
    """
    views = pattern is not None or lens is not None
    if variable is None and not views and holds_rgbd(path):
        return dict(plain(_scene(path, read_rgbd(path))))
    parts = None if variable is not None or views else scene_parts(Path(path))
    if parts is not None:
        return dict(plain(_folder(path, *parts)))
    with open_light_field(path, pattern, lens) if views else open_contents(path) as contents:
        about: dict[str, Any] = {"path": str(path), "format": contents.format, "kind": "", "variables": {}}
        about["attrs"] = {key: value for key, value in contents.attrs.items() if np.size(value) <= 64}
        for name, stored in contents.arrays.items():
            about["variables"][name] = _variable(stored)
        main = _main(contents, variable, pattern)
        if main["variable"]:
            about |= {k: v for k, v in about["variables"][main["variable"]].items() if k != "attrs"}
        about |= main
        if main["kind"] == "light field":
            about["depth"] = light_field_depth(contents.path) if main["light_field"]["disparity"] else None
        elif main["kind"] == "cube":
            about["depth"] = depth_in(contents)
            about |= _said_of_scale(contents.arrays[main["variable"]], about)
    return dict(plain(about))


def is_prior(description: Mapping[str, Any]) -> bool:
    """Whether it is that of a file written by `tmca.priors.Prior.save`."""
    return str(description.get("attrs", {}).get("format", "")).startswith("tmca prior")


def _scene(path: str | Path, scene: xr.Dataset) -> dict[str, Any]:
    """An RGB-D scene."""
    arrays = {name: from_array(str(name), v.values, dims=v.dims, attrs=v.attrs) for name, v in scene.data_vars.items()}
    about: dict[str, Any] = {"path": str(path), "format": scene.attrs["format"], "kind": "RGB-D scene"}
    about["variables"] = {str(name): _variable(stored) for name, stored in arrays.items()}
    attrs = {key: value for key, value in scene.attrs.items() if key not in ("source", "format")}
    facts = depth_facts(scene["depth"], bool(scene.attrs["metric"]))
    return {**about, "attrs": attrs, "variable": None, "wavelengths": None, "depth": facts}


def _folder(path: str | Path, cube: Path, depth: Path) -> dict[str, Any]:
    """A folder with a cube and its depth map."""
    about, metres = describe(cube), read_depth_map(depth)
    size = [n for axis, n in enumerate(about.get("shape", ())) if axis != about.get("spectral_axis")]
    if about["kind"] == "cube" and sorted(size) != sorted(metres.shape):
        raise wrong_size(depth, "a depth map", metres.shape, size, f"{cube.name} has")
    about["variables"]["depth"] = _variable(from_array("depth", metres.values, dims=("y", "x"), attrs=metres.attrs))
    kind = {"path": str(path), "kind": "spectral-depth scene", "depth": depth_facts(metres, True)}
    return {**about, **kind, "format": f"{about['format']} with {depth.name}"}


def _main(contents: Contents, variable: str | None, pattern: str | None) -> dict[str, Any]:
    """Kind, main variable and wavelengths: a light field or cube if `read` would take it, else why not."""
    views = find_light_field(contents, variable)
    if views is not None:
        return describe_light_field(contents, views, pattern)
    try:
        stored, axis, metres, origin = locate_cube(contents, variable)
    except DataError as error:
        return _not_a_cube(contents, variable, error)
    nm = metres_to_nm(metres)
    dims = list(stored.dims) or ["y", "x"]
    if not stored.dims:
        dims.insert(axis, "wavelength")
    waves = {"count": nm.size, "first_nm": nm[0], "last_nm": nm[-1], "from": origin, "nm": nm}
    steps = np.round(np.diff(nm), 6)
    waves["spacing_nm"] = [steps.min(), steps.max()] if steps.size else None
    return {
        "kind": "cube",
        "variable": stored.name,
        "dims": dims,
        "spectral_axis": axis,
        "wavelengths": waves,
        "scale": divisor(stored, axis, None, None)[0],
    }


def _said_of_scale(stored: Stored, about: Mapping[str, Any]) -> dict[str, str]:
    """A note on the scale of integers that leave bits of their type free."""
    whole = stored.dtype.kind in "iu" and about["scale"] == float(np.iinfo(stored.dtype).max)
    hint = few_counts(stored.dtype, about["max"]) if whole else ""
    return {"note": hint} if hint else {}


def _not_a_cube(contents: Contents, variable: str | None, error: DataError) -> dict[str, Any]:
    numeric = [s for s in contents.arrays.values() if s.numeric]
    kind = "dataset" if contents.labelled else "array" if len(numeric) == 1 else "arrays"
    about: dict[str, Any] = {"kind": kind, "variable": variable, "wavelengths": None}
    if variable is not None:
        contents.get(variable)
    elif len(numeric) == 1:
        about["variable"] = numeric[0].name
    if any(len(s.shape) == 3 for s in numeric):
        about["note"] = str(error)
    return about


def _variable(stored: Stored) -> dict[str, Any]:
    """Shape, dims, type, attributes and statistics of one array."""
    about: dict[str, Any] = {"shape": stored.shape, "dims": stored.dims, "dtype": str(stored.dtype)}
    if stored.numeric and stored.size:
        about |= _statistics(stored)
    attrs = {key: value for key, value in stored.attrs.items() if np.size(value) <= 64 and _is_plain(value)}
    return about | {"attrs": attrs}


def _is_plain(value: Any) -> bool:
    return isinstance(value, str | bytes | int | float | bool | np.number | np.bool_ | list | tuple) or (
        isinstance(value, np.ndarray) and value.dtype.kind in "buif"
    )


def _statistics(stored: Stored) -> dict[str, Any]:
    """Minimum, maximum and mean of the finite values and shares of special ones, slice by slice."""
    low, high, total, count, zeros, at_high = np.inf, -np.inf, 0.0, 0, 0, 0
    for values in _slices(stored):
        good = values[np.isfinite(values)] if values.dtype.kind == "f" else values
        if not good.size:
            continue
        top = float(good.max())
        if top >= high:
            at_high = int(np.count_nonzero(good == good.max())) + (at_high if top == high else 0)
        low, high = min(low, float(good.min())), max(high, top)
        total, count = total + float(good.sum(dtype=np.float64)), count + good.size
        zeros += int(np.count_nonzero(good == 0))
    if not count:
        return {"min": None, "max": None, "mean": None, "not_finite": stored.size}
    full = float(np.iinfo(stored.dtype).max) if stored.dtype.kind in "iu" else max(high, 1.0)
    shares = {"zero_share": zeros / stored.size, "saturated_share": at_high / stored.size if high >= full else 0.0}
    return {"min": low, "max": high, "mean": total / count, **shares, "not_finite": stored.size - count}


def _slices(stored: Stored) -> Any:
    if len(stored.shape) < 3:
        yield stored.whole()
    else:
        yield from (stored.plane(0, i) for i in range(stored.shape[0]))


def depth_facts(depth: xr.DataArray, metric: bool) -> dict[str, Any]:
    """Range in metres where they are metric, pixels, how many are unknown and why, and whether they are metric."""
    counts = {key: int(depth.attrs[key]) for key in depth.attrs if key.startswith("unknown_")}
    facts: dict[str, Any] = {"pixels": depth.size, **counts, "metric": metric}
    if not metric:
        return facts
    metres = depth.values[np.isfinite(depth.values)]
    near, median, far = (float(v) for v in np.percentile(metres, [0, 50, 100]))
    return {"near": near, "median": median, "far": far, **facts}


def depth_in(contents: Contents) -> dict[str, Any] | None:
    """Facts of the depth map in a file beside its cube; None without, a ``note`` where it cannot be used."""
    if "depth" not in contents.arrays:
        return None
    try:
        depth = label_depth(stored_metres(contents.path)[0], contents.path)
    except TmcaError as error:
        return {"note": str(error)}
    facts = depth_facts(depth, bool(contents.attrs.get("metric", True)))
    mapped = said_mapped(contents.attrs, facts["near"], facts["far"]) if facts["metric"] else ""
    return facts | ({"mapped": mapped} if mapped else {})


def light_field_depth(folder: Path) -> dict[str, Any] | None:
    """Facts of the depth that a light field's true disparity gives; None where it is no RGB-D scene."""
    try:
        scene = read_rgbd(folder) if folder.is_dir() else None
    except TmcaError:
        return None
    return None if scene is None else depth_facts(scene["depth"], bool(scene.attrs["metric"]))


def describe_light_field(contents: Contents, stored: Stored, pattern: str | None = None) -> dict[str, Any]:
    """Kind and facts of a light field: views, size, colour, naming, shifts between views, true disparity.

    The shifts are those of `tmca.data.view_shifts` where the grid is 3×3 or more. ``pattern`` is the one that the views
    were opened with.
    """
    size = dict(zip(stored.dims, stored.shape, strict=True))
    rows, columns, height, width = (size[dim] for dim in VIEW_DIMS)
    facts: dict[str, Any] = {
        "views": [rows, columns],
        "size": [height, width],
        "colour": has_colour(stored),
        "pattern": contents.attrs.get("pattern") or stored.attrs.get("pattern") or contents.format,
        "shifts": None,
        "disparity": _disparity(contents, pattern),
    }
    if min(rows, columns) >= 3:
        facts["shifts"] = shift_facts(load_views(contents, stored, views=3)) or None
    about = {"kind": "light field", "variable": stored.name, "dims": stored.dims, "light_field": facts}
    notes = [facts["shifts"].pop("note", None)] if facts["shifts"] else []
    if rows != columns or rows % 2 == 0:
        notes.append(f"{rows}×{columns} views: read the centre n×n, n odd, with views= (--views)")
    if any(notes):
        about["note"] = "; ".join(note for note in notes if note)
    return {**about, "wavelengths": None}


def _disparity(contents: Contents, pattern: str | None) -> dict[str, Any] | None:
    """Range and file of the true disparity, None without."""
    source = find_disparity(contents.path)
    if source is None:
        return None
    try:
        values = read_disparity(contents.path, pattern=pattern)
    except DataError as error:
        return {"source": source.name, "min": None, "max": None, "note": str(error)}
    return {"source": source.name, "min": float(values.min()), "max": float(values.max())}


_BLOCKS = 6
"""Blocks per axis, at most: enough to tell signs, few enough to take a second."""


def view_shifts(light_field: xr.DataArray, block: int = 64) -> NDArray[np.float64]:
    """Disparity of blocks of the centre view, once from its neighbours in the column and once from those in the row.

    By phase correlation of the views one step before and one after. In the package's orientation both are
    equal up to noise and occlusion; opposite signs mean that one axis of the grid runs the other way.

    Args:
        light_field: grey, ``(view_v, view_u, y, x)``, 3×3 views or more.
        block: pixels per side, at most those of a view.

    Returns:
        ``(N, 2)`` in px per view step: along view rows and y, along view columns and x; blocks without texture are
        left out.

    Raises:
        ShapeError: fewer than 3×3 views, or in colour.
    """
    if light_field.ndim != 4 or min(light_field.shape[:2]) < 3:
        raise ShapeError("light_field", f"{light_field.dims} {light_field.shape}", "3×3 grey views or more")
    views = light_field.values
    v, u = (n // 2 for n in views.shape[:2])
    size = min(block, *views.shape[2:])
    window = np.hanning(size + 2)[1:-1]
    shifts = []
    for y in _starts(views.shape[2], size):
        for x in _starts(views.shape[3], size):
            part = views[v - 1 : v + 2, u - 1 : u + 2, y : y + size, x : x + size].astype(np.float64)
            if part[1, 1].std() > 0.01:
                part = (part - part.mean(axis=(2, 3), keepdims=True)) * window[:, None] * window
                shifts.append((_shift(part[0, 1], part[2, 1])[0] / 2, _shift(part[1, 0], part[1, 2])[1] / 2))
    return np.array(shifts, dtype=np.float64).reshape(-1, 2)


def _starts(length: int, size: int) -> list[int]:
    count = min(_BLOCKS, length // size)
    return sorted({round(start) for start in np.linspace(0, length - size, count)})


def _shift(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far (y, x) one must move ``after`` to bring it onto ``before``, in px to a twentieth."""
    from skimage.registration import phase_cross_correlation

    return np.asarray(phase_cross_correlation(before, after, upsample_factor=20)[0])


def agreement(shifts: NDArray[np.float64]) -> float | None:
    """Correlation about zero of the two columns of `view_shifts`: 1 where they are equal, -1 where one axis runs the
    other way, None where nothing is shifted."""
    power = float(np.sqrt(np.prod((shifts**2).sum(axis=0))))
    return float((shifts[:, 0] * shifts[:, 1]).sum()) / power if power else None


def shift_facts(light_field: xr.DataArray) -> dict[str, Any]:
    """Median and range of the disparity along each axis, and whether the axes agree; {} where nothing is shifted."""
    shifts = view_shifts(light_field)
    agree = agreement(shifts)
    if agree is None:
        return {}
    low, high = np.percentile(shifts, [5, 95])
    facts: dict[str, Any] = {
        "median_rows": float(np.median(shifts[:, 0])),
        "median_columns": float(np.median(shifts[:, 1])),
        "low": float(low),
        "high": float(high),
        "agreement": agree,
    }
    if agree < -0.5:
        facts["note"] = (
            "rows and columns run in opposite senses: read it with {-row} or {-column} in pattern= (--pattern)"
        )
    return facts
