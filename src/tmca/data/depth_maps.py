"""Depth maps: what is known in them, disparity to metres, files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.opening import is_picture, open_contents
from tmca.data.formats.stored import Contents, Stored
from tmca.errors import DataError, ShapeError, check_range

if TYPE_CHECKING:
    import xarray as xr

UNKNOWN = "unknown"
"""Coordinate of a depth map: why a pixel is unknown, its place in ``UNKNOWN_KINDS``, 0 where it is known."""
UNKNOWN_KINDS = ("zero", "negative", "not_finite")
_UNITS = {"m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "cm": 1e-2, "mm": 1e-3}


def label_depth(values: NDArray[Any], where: object, attrs: dict[str, Any] | None = None) -> xr.DataArray:
    """A labelled depth map in metres whose unknown pixels are NaN and counted.

    Args:
        values: ``(H, W)`` metres. Zeros (holes), negative, NaN and infinite values are unknown; none is clamped.
        where: the file, for the message.
        attrs: attributes besides those below.

    Returns:
        dims ``(y, x)``, float32; attrs ``units``, ``unknown_pixels`` and of them ``unknown_zero``,
        ``unknown_negative``, ``unknown_not_finite``; where some are zero or negative also the coordinate ``unknown``
        (y, x), 0 where depth is known, else 1 to 3 in this order, so that they can be counted in a part of the map.

    Raises:
        ShapeError: not two axes.
        DataError: no pixel is known.
    """
    if values.ndim != 2 or not values.size:
        raise ShapeError(where, f"a depth map of shape {values.shape}", "(H, W)")
    with np.errstate(over="ignore"):
        values = values.astype(np.float32)
    return labelled_kinds(values, _kinds_of(values), where, attrs)


def labelled_kinds(
    values: NDArray[Any], kinds: NDArray[np.int8], where: object, attrs: dict[str, Any] | None = None
) -> xr.DataArray:
    """As `label_depth`, of values whose kinds (H, W) are known already.

    Raises:
        DataError: no pixel is known.
    """
    import xarray as xr

    valid = kinds == 0
    if not valid.any():
        raise DataError(where, f"no known depth in {values.size} pixels", "some positive, finite metres")
    about = {"units": "m", "long_name": "depth", "unknown_pixels": int(np.sum(~valid))}
    about |= {f"unknown_{name}": int(np.sum(kinds == place)) for place, name in enumerate(UNKNOWN_KINDS, 1)}
    depth = np.where(valid, values, np.nan).astype(np.float32)
    flags = {"long_name": "why depth is unknown", "flag_meanings": " ".join(("known", *UNKNOWN_KINDS))}
    coords = {UNKNOWN: (("y", "x"), kinds, flags)} if ((kinds == 1) | (kinds == 2)).any() else {}
    return xr.DataArray(depth, coords, dims=("y", "x"), name="depth", attrs={**about, **(attrs or {})})


def unknown_kinds(depth: xr.DataArray) -> NDArray[np.int8]:
    """(H, W) why pixels of a labelled depth map are unknown: 0 where known, else 1 and on (``UNKNOWN_KINDS``)."""
    kinds = _kinds_of(depth.values)
    if UNKNOWN not in depth.coords:
        return kinds
    stated = depth.coords[UNKNOWN].values.astype(np.int8)
    return np.where((kinds == 3) & (stated > 0), stated, kinds)


def _kinds_of(values: NDArray[Any]) -> NDArray[np.int8]:
    return np.select([values == 0, np.isfinite(values) & (values < 0), ~np.isfinite(values)], [1, 2, 3], 0).astype(
        np.int8
    )


def disparity_to_depth(
    disparity: NDArray[Any], focal_px: float, baseline_m: float, offset_px: float = 0.0
) -> NDArray[np.float64]:
    """Depth in metres, ``Z = f B / (d + offset)``; infinite or NaN disparities, and those behind infinity, give NaN.

    Args:
        disparity: any shape, pixels, larger for what is nearer.
        focal_px: focal length in pixels.
        baseline_m: distance of the two cameras, metres.
        offset_px: disparity that the stored ones leave out: ``cx₁ - cx₀`` of a stereo pair, ``f B / Z`` of the plane in
            focus of a light field.
    """
    total = np.asarray(disparity, dtype=np.float64) + offset_px
    usable = np.isfinite(total) & (total > 0)
    return np.where(usable, focal_px * baseline_m / np.where(usable, total, 1.0), np.nan)


def relative_depth(disparity: NDArray[Any]) -> NDArray[np.float64]:
    """Depth of disparities without any calibration: inverse depth grows with them, from 2 m to 1 m.

    Metres only in name: right up to an affine map of inverse depth, which `tmca.data.fitting` replaces.
    """
    values = np.asarray(disparity, dtype=np.float64)
    valid = np.isfinite(values)
    if not valid.any():
        return np.full(values.shape, np.nan)
    low, high = values[valid].min(), values[valid].max()
    share = (np.where(valid, values, low) - low) / (high - low) if high > low else np.full(values.shape, 0.5)
    return np.where(valid, 1 / (0.5 + 0.5 * share), np.nan)


def read_depth_map(path: str | Path, *, scale: float | None = None) -> xr.DataArray:
    """Read a depth map: NetCDF, HDF5, Zarr, ``.npy``, PFM, TIFF, 16-bit PNG or ``.mat``.

    Args:
        path: the file; of several arrays ``depth`` is taken, else the only one of two axes.
        scale: metres per stored unit. By default what the file's ``units`` say; else integers are millimetres and
            floats metres.

    Returns:
        As `label_depth`, with attrs ``source`` and ``depth_scale`` too.

    Raises:
        DataError: missing, damaged, no depth map, 8 bits deep, or without any known pixel.
        SettingError: an impossible scale.
    """
    values, by = stored_metres(path, scale)
    return label_depth(values, path, {"source": str(path), "depth_scale": by})


def stored_metres(path: str | Path, scale: float | None = None) -> tuple[NDArray[np.float64], float]:
    """The values of a depth map in metres, none left out, and the metres per stored unit; see `read_depth_map`."""
    with open_contents(path) as contents:
        stored = find_depth(contents)
        return _in_metres(contents.path, upright(stored), stored.attrs.get("units"), scale)


def find_depth(contents: Contents) -> Stored:
    """The array called ``depth``, or the only one of two axes.

    Raises:
        DataError: neither.
    """
    if "depth" in contents.arrays:
        return contents.get("depth")
    maps = [s for s in contents.arrays.values() if s.numeric and sum(n > 1 for n in s.shape) == 2]
    if len(maps) != 1:
        expected = "depth (y, x), or one array of two axes"
        raise DataError(contents.path, f"no depth map ({contents.listing()})", expected, "name the map depth")
    return maps[0]


def upright(stored: Stored) -> NDArray[Any]:
    """The stored map with its rows first; axes of length one are dropped."""
    values = stored.whole()
    dims = [dim for dim, n in zip(stored.dims, stored.shape, strict=False) if n > 1]
    values = values.squeeze() if values.ndim > 2 else values
    return values.T if dims == ["x", "y"] else values


def _in_metres(path: Path, values: NDArray[Any], unit: Any, scale: float | None) -> tuple[NDArray[np.float64], float]:
    if is_picture(path) and (values.dtype == np.uint8 or values.ndim != 2):
        found = f"a picture of type {values.dtype} and shape {values.shape}"
        raise DataError(path, found, "one channel of 16 bits in millimetres", "store it as .npy or NetCDF in metres")
    if values.dtype.kind not in "uif" or values.ndim != 2:
        raise DataError(path, f"an array of type {values.dtype} and shape {values.shape}", "a depth map (y, x)")
    if scale is None:
        scale = _UNITS.get(str(unit).strip().lower(), 1.0 if values.dtype.kind == "f" else 1e-3)
    check_range("scale", scale, above=0, unit="metres per stored unit")
    return values.astype(np.float64) * scale, float(scale)
