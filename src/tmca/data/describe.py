"""What a file holds, for people and programs: the content behind ``tmca inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.checks import divisor
from tmca.data.cubes import find_wavelengths
from tmca.data.depth_facts import depth_facts, depth_in, light_field_depth
from tmca.data.depth_maps import read_depth_map
from tmca.data.formats.axes import find_cube, spectral_axis
from tmca.data.formats.opening import open_contents
from tmca.data.formats.stored import Contents, Stored, from_array
from tmca.data.formats.wavelengths import metres_to_nm, read_sidecar
from tmca.data.light_field_facts import describe_light_field
from tmca.data.light_fields import find_light_field, open_light_field
from tmca.data.rgbd import holds_rgbd, read_rgbd
from tmca.data.spectral_depth import scene_parts
from tmca.data.write import plain
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray


def describe(
    path: str | Path,
    variable: str | None = None,
    *,
    pattern: str | None = None,
    lens: tuple[int, int] | None = None,
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
        a three-axis array is no cube, or a light field cannot be read whole.

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
    return dict(plain(about))


def _scene(path: str | Path, scene: xarray.Dataset) -> dict[str, Any]:
    """An RGB-D scene."""
    arrays = {name: from_array(str(name), v.values, dims=v.dims, attrs=v.attrs) for name, v in scene.data_vars.items()}
    about: dict[str, Any] = {"path": str(path), "format": scene.attrs["format"], "kind": "RGB-D scene"}
    about["variables"] = {str(name): _variable(stored) for name, stored in arrays.items()}
    attrs = {key: value for key, value in scene.attrs.items() if key not in ("source", "format")}
    facts = depth_facts(scene["depth"], bool(scene.attrs["metric"]))
    return {**about, "attrs": attrs, "variable": None, "wavelengths": None, "depth": facts}


def _folder(path: str | Path, cube: Path, depth: Path) -> dict[str, Any]:
    """A folder with a cube and its depth map."""
    found, known = describe(cube), read_depth_map(depth)
    size = [n for axis, n in enumerate(found.get("shape", ())) if axis != found.get("spectral_axis")]
    if found["kind"] == "cube" and sorted(size) != sorted(known.shape):
        sizes = [f"{height}×{width}" for height, width in (known.shape, size)]
        raise DataError(depth, f"{sizes[0]} pixels", f"{sizes[1]} as {cube.name} has", "crop one of them")
    stored = from_array("depth", known.values, dims=("y", "x"), attrs=known.attrs)
    found["variables"]["depth"] = _variable(stored)
    about = {"path": str(path), "kind": "spectral-depth scene", "depth": depth_facts(known, True)}
    return {**found, **about, "format": f"{found['format']} with {depth.name}"}


def _main(contents: Contents, variable: str | None, pattern: str | None) -> dict[str, Any]:
    """Kind, main variable and wavelengths: a light field or cube if `read` would take it, else why not."""
    views = find_light_field(contents, variable)
    if views is not None:
        return describe_light_field(contents, views, pattern)
    sidecar = read_sidecar(contents.path)
    try:
        stored = find_cube(contents, variable, None if sidecar is None else sidecar.size)
        axis = spectral_axis(stored, None if sidecar is None else sidecar.size)
        if axis is None:
            raise DataError(contents.path, f"no spectral axis in {stored.name} {stored.shape}")
        metres, origin = find_wavelengths(contents, stored, axis, None, sidecar)
    except DataError as error:
        return _not_a_cube(contents, variable, error)
    nm = metres_to_nm(metres)
    dims = [dim for dim in stored.dims] or ["y", "x"]
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
    low, high, total, count, zeros, top = np.inf, -np.inf, 0.0, 0, 0, 0
    full = float(np.iinfo(stored.dtype).max) if stored.dtype.kind in "iu" else None
    for values in _slices(stored):
        good = values[np.isfinite(values)] if values.dtype.kind == "f" else values
        if not good.size:
            continue
        low, high = min(low, float(good.min())), max(high, float(good.max()))
        total, count = total + float(good.sum(dtype=np.float64)), count + good.size
        zeros += int(np.count_nonzero(good == 0))
        top += int(np.count_nonzero(good >= full)) if full is not None else 0
    if not count:
        return {"min": None, "max": None, "mean": None, "not_finite": stored.size}
    if full is None:
        full = max(high, 1.0)
        top = sum(int(np.count_nonzero(values >= full)) for values in _slices(stored)) if high >= full else 0
    shares = {"zero_share": zeros / stored.size, "saturated_share": top / stored.size}
    return {"min": low, "max": high, "mean": total / count, **shares, "not_finite": stored.size - count}


def _slices(stored: Stored) -> Any:
    if len(stored.shape) < 3:
        yield stored.whole()
    else:
        yield from (stored.plane(0, i) for i in range(stored.shape[0]))
