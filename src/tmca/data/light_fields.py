"""`read_light_field`: the views of a light field from any supported file or folder, labelled, in one orientation.

Disparity d (px per view step, positive = nearer than the plane in focus) has the sign of the HCI benchmark along both
axes: what the centre view shows at (y, x), view (v, u) shows at (y - v·d, x - u·d).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.axes import COLOURS, colour_axis, view_axes
from tmca.data.files import SUFFIXES as LABELLED
from tmca.data.files import write_dataset
from tmca.data.fitting import centre_window
from tmca.data.formats.arrays import IRRADIANCE, open_labelled
from tmca.data.formats.limits import check_array
from tmca.data.formats.opening import is_picture, is_zarr, open_contents
from tmca.data.formats.stored import Contents, Stored
from tmca.data.formats.views import DIMS, LENS, open_lenslet, open_views
from tmca.data.formats.wavelengths import divisor
from tmca.data.pixels import area_average, nearest, refuse_not_finite, wrong_size
from tmca.errors import DataError, SettingError, ShapeError

if TYPE_CHECKING:
    import xarray

VIEW_DIMS = DIMS
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of ITU-R BT.709."""
NAMES = ("light_field", "estimate")
"""Under which tmca's own files keep a light field, beside others that also run over views."""
IN_FRAMES = "slot"
"""Axis of an estimate of several light fields, one after the other."""


def read_light_field(
    path: str | Path,
    *,
    views: int | None = None,
    crop: tuple[int, int] | None = None,
    scale: int | None = None,
    colour: bool = False,
    pattern: str | None = None,
    lens: tuple[int, int] | None = None,
    variable: str | None = None,
) -> xarray.DataArray:
    """Read a light field as relative irradiance.

    Reads folders with one picture per view (HCI benchmark with or without ``parameters.cfg``, Stanford's archive,
    INRIA's and plain names with row and column), lenslet pictures (``*_eslf.png``; of their 14×14 views the centre 7×7
    that are not vignetted unless ``views`` asks for others), and labelled files (NetCDF, HDF5, Zarr). Values stay as
    stored, without a change of gamma: integers are divided by their type's maximum, floats above 1 by theirs.

    Args:
        path: the folder, picture or file.
        views: n for the centre n×n views, n odd; all of a square odd grid by default. An even grid has no centre
            view: of its two middle rows and columns the later ones are the centre.
        crop: centre (H, W) in pixels of the result, after ``scale``.
        scale: whole number of pixels per axis that are averaged into one; what is left over at the end is dropped.
        colour: red, green and blue instead of their luminance (Rec. 709 weights of the stored values).
        pattern: of a folder's file names where they are not recognised, such as ``view_{row}_{column}.png``; see
            `tmca.data.formats.view_names.find_views`.
        lens: views under a lens of a lenslet picture, (rows, columns); 14×14 by default.
        variable: which array, where a labelled file has several light fields.

    Returns:
        dims ``(view_v, view_u, y, x)``, or ``(colour, view_v, view_u, y, x)``, float32; coordinates ``view_v`` and
        ``view_u`` centred on 0; attrs ``name``, ``source``, ``pattern``, ``grid`` (rows and columns of the source)
        and ``source_colours`` (3 or 1).

    Raises:
        DataError: missing, extra, broken or unequal views, a grid that is not square or even, or not-finite pixels.
        SettingError: impossible ``views``, ``crop``, ``scale``, ``pattern`` or ``lens``.
    """
    with open_light_field(path, pattern, lens) as contents:
        stored = find_light_field(contents, variable)
        if stored is None:
            contents.refuse_snapshot()
            raise no_light_field(contents, variable)
        return load_views(contents, stored, views=views, crop=crop, scale=scale, colour=colour)


@contextmanager
def open_light_field(
    path: str | Path, pattern: str | None = None, lens: tuple[int, int] | None = None
) -> Iterator[Contents]:
    """Look into a light field without loading it; arguments as in `read_light_field`."""
    path = Path(path)
    if pattern is not None and not path.is_dir():
        raise SettingError("pattern", f"{pattern!r} for {path}", "a folder of views")
    if lens is not None and not is_picture(path):
        raise SettingError("lens", f"{'×'.join(map(str, lens))} for {path}", "a lenslet picture")
    if pattern is not None and (opened := open_views(path, pattern)) is not None:
        yield opened
    elif is_picture(path) and path.is_file():
        yield open_lenslet(path, lens or LENS)
    else:
        with open_contents(path) as contents:
            yield contents


def find_light_field(contents: Contents, variable: str | None = None) -> Stored | None:
    """The array that runs over views, or None: the one asked for, one of `NAMES`, or the only one.

    Raises:
        DataError: several run over views and none is named.
    """
    over = [s for s in contents.arrays.values() if set(VIEW_DIMS) <= set(s.dims) and s.numeric and s.size]
    over = [s for s in over if IN_FRAMES not in s.dims]
    if variable is not None:
        return next((s for s in over if s.name == variable), None)
    named = [s for s in over if s.name in NAMES]
    return contents.only(named[:1] or over, "light field") if over else None


def has_colour(stored: Stored) -> bool:
    """Whether every view has three colours."""
    size = dict(zip(stored.dims, stored.shape, strict=True))
    return max(size.get("channel", 1), size.get("colour", 1)) >= len(COLOURS)


def load_views(
    contents: Contents,
    stored: Stored,
    *,
    views: int | None = None,
    crop: tuple[int, int] | None = None,
    scale: int | None = None,
    colour: bool = False,
    divide_by: float | None = None,
) -> xarray.DataArray:
    """The chosen views of an open light field; arguments as in `read_light_field`.

    ``divide_by`` is the divisor to relative irradiance, where it is not the usual one.

    Raises:
        DataError, SettingError: as `read_light_field`.
    """
    size = {dim: stored.shape[stored.dims.index(dim)] for dim in VIEW_DIMS}
    grid = size["view_v"], size["view_u"]
    wanted = stored.attrs.get("default_views") if views is None else views
    rows, columns = centre_views(grid, wanted, contents.path)
    window = centre_window((size["y"], size["x"]), crop, scale, contents.path)
    shown = (len(rows), len(columns), window[0].stop - window[0].start, window[1].stop - window[1].start)
    check_array(contents.path, stored.name, shown, 4)
    by, scaled = divisor(stored, 0, divide_by, None)
    pixels = np.stack([np.stack([_view(stored, v, u, colour, window, scale or 1) for u in columns]) for v in rows])
    pixels /= np.float32(by)
    refuse_not_finite(pixels, contents.path, ("view row", "column", "y", "x"))
    about = {
        "name": stored.attrs.get("name") or (contents.path.name if contents.path.is_dir() else contents.path.stem),
        "source": str(contents.path),
        "pattern": contents.attrs.get("pattern") or stored.attrs.get("pattern") or contents.format,
        "grid": list(grid),
        "source_colours": len(COLOURS) if has_colour(stored) else 1,
        "scale": by,
        "scale_from": scaled,
    }
    geometry = {key: value for key, value in contents.attrs.items() if key.endswith("_m") and isinstance(value, float)}
    return label_light_field(np.moveaxis(pixels, -1, 0) if colour else pixels[..., 0], {**geometry, **about})


def label_light_field(pixels: NDArray[Any], attrs: dict[str, Any] | None = None) -> xarray.DataArray:
    """A labelled light field from ``(V, U, H, W)`` or ``(3, V, U, H, W)`` pixels in relative irradiance.

    Raises:
        ShapeError: another number of axes or of colours.
    """
    import xarray

    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    if pixels.ndim not in (4, 5) or (pixels.ndim == 5 and len(pixels) != len(COLOURS)):
        raise ShapeError("light field", f"shape {pixels.shape}", "(V, U, H, W) or (3, V, U, H, W)")
    dims = ("colour", *VIEW_DIMS)[-pixels.ndim :]
    rows, columns = pixels.shape[-4:-2]
    coords: dict[str, Any] = view_axes((rows, columns))
    if pixels.ndim == 5:
        coords["colour"] = colour_axis()
    return xarray.DataArray(pixels, coords, dims, name="light_field", attrs={**IRRADIANCE, **(attrs or {})})


def write_light_field(light_field: xarray.DataArray, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a light field as NetCDF4/HDF5 (``.nc``, ``.h5``) or Zarr, whole or not at all; see `write_dataset`.

    Raises:
        ShapeError: dims other than those of `read_light_field`.
        OutputError: see `atomic_path`.
    """
    if light_field.dims not in (VIEW_DIMS, ("colour", *VIEW_DIMS)):
        expected = f"{VIEW_DIMS}, with colour before them if it has any"
        raise ShapeError("light field", f"dims {light_field.dims}", expected)
    return write_dataset(light_field, path, overwrite=overwrite)


def centre_views(grid: tuple[int, int], views: int | None, where: object) -> tuple[range, range]:
    """Rows and columns of the centre n×n views of a grid.

    Raises:
        DataError: all views are wanted of a grid that is not square or even.
        SettingError: n even, below 1 or larger than the grid.
    """
    if views is None:
        if grid[0] != grid[1] or grid[0] % 2 == 0:
            most = min(grid) - (min(grid) % 2 == 0)
            remedy = f"take the centre n×n of them, n odd, with views= (--views), such as {most}"
            raise DataError(where, f"{grid[0]}×{grid[1]} views", "a square grid with an odd number a side", remedy)
        views = grid[0]
    if isinstance(views, bool) or not isinstance(views, (int, np.integer)) or views < 1 or views % 2 == 0:
        raise SettingError("views", repr(views), "an odd number n, for the centre n×n views")
    if views > min(grid):
        most = min(grid) - (min(grid) % 2 == 0)
        found = f"{views} of the {grid[0]}×{grid[1]} views of {where}"
        raise SettingError("views", found, f"an odd number, at most {most}", f"give views={most} (--views {most})")
    top, left = ((n - views + 1) // 2 for n in grid)
    return range(top, top + views), range(left, left + views)


def _view(stored: Stored, v: int, u: int, colour: bool, window: tuple[slice, slice], scale: int) -> NDArray[np.float32]:
    """One view ``(H, W, C)`` with C = 3 in colour and 1 in grey, in stored units."""
    at: dict[str, int | slice] = {"view_v": v, "view_u": u, "y": window[0], "x": window[1]}
    pixels = stored.load(tuple(at.get(dim, slice(None)) for dim in stored.dims)).astype(np.float32)
    others = [dim for dim in stored.dims if dim not in ("view_v", "view_u")]
    pixels = np.moveaxis(pixels, (others.index("y"), others.index("x")), (0, 1))
    if pixels.ndim > 3:
        raise DataError(stored.name, f"dims {stored.dims}", f"{VIEW_DIMS} and at most colour")
    coloured = np.moveaxis(_coloured(np.atleast_3d(pixels), colour, stored), -1, 0)
    size = coloured.shape[1] // scale, coloured.shape[2] // scale
    return np.moveaxis(coloured if scale == 1 else area_average(coloured, size), 0, -1)


def _coloured(pixels: NDArray[np.float32], colour: bool, stored: Stored) -> NDArray[np.float32]:
    """Three colours or their luminance; an alpha channel is dropped."""
    pixels = pixels[..., : 1 if pixels.shape[2] < 3 else 3]
    if colour and pixels.shape[2] == 1:
        remedy = "take one in colour, or leave out colour= (--colour)"
        raise DataError(stored.name, "grey views", "red, green and blue", remedy)
    if colour or pixels.shape[2] == 1:
        return pixels
    return pixels @ np.array(LUMINANCE, dtype=np.float32)[:, None]


def no_light_field(contents: Contents, variable: str | None = None) -> DataError:
    """The error for a file or folder without one."""
    found = f"no light field{'' if variable is None else f' {variable!r}'} ({contents.format}: {contents.listing()})"
    expected = "pictures named by row and column, a lenslet picture, or a file with view_v and view_u"
    return DataError(contents.path, found, expected, "give the names' pattern= (--pattern) for a folder of views")


def not_spectral(source: object) -> DataError:
    """The error for a light field in the place of a spectral scene."""
    remedy = 'take it for the light-field camera: tmca simulate light-field, tmca.read(…, "light-field")'
    return DataError(source, "a light field", "a spectral scene", remedy)


USUAL = "gt_disp_lowres.pfm"
"""The HCI benchmark's disparity at the size of its views."""
ESTIMATED = "estimated"
"""Attribute, 1, of a disparity that was matched from the views beside it: it is not the true one."""
_MEND = "mend the map, or take it away to go without"


def find_disparity(folder: str | Path) -> Path | None:
    """The disparity map of a folder of views: `USUAL`, or the only ``.pfm`` with ``disp`` in its name; of a labelled
    file, the file itself if it holds ``disparity`` that is not estimated from its own views."""
    folder = Path(folder)
    if folder.suffix.lower() in LABELLED or not folder.is_dir():
        return folder if _holds_disparity(folder) else None
    if (folder / USUAL).is_file():
        return folder / USUAL
    others = [file for file in sorted(folder.glob("*.pfm")) if "disp" in file.name.lower()]
    return others[0] if len(others) == 1 else None


def _holds_disparity(path: Path) -> bool:
    if path.suffix.lower() not in LABELLED or not path.exists():
        return False
    with open_labelled(path) as stored:
        return "disparity" in stored.data_vars and not stored["disparity"].attrs.get(ESTIMATED)


def read_disparity(
    path: str | Path,
    *,
    crop: tuple[int, int] | None = None,
    scale: int | None = None,
    pattern: str | None = None,
) -> xarray.DataArray:
    """Disparity of the centre view in px per view step, brought to the pixels of `read_light_field`.

    A reduced map is sampled at the middle of each new pixel, so that no two sides of an edge are mixed, and its
    values are divided by the scale.

    Args:
        path: a folder of views with its map, a ``.pfm`` or ``.npy`` map, or a labelled file with ``disparity``.
        crop: as in `read_light_field`.
        scale: as in `read_light_field`.
        pattern: of the views' names in a folder, as in `read_light_field`.

    Returns:
        dims ``(y, x)``, float32, positive = nearer than the plane in focus; attrs ``source`` and ``units``.

    Raises:
        DataError: there is none, it is broken, of another size than the views, or has NaN or infinite values.
        SettingError: an impossible crop or scale.
    """
    import xarray

    path = Path(path)
    values, source = _values(path)
    expected = _size_of_views(path, pattern)
    if expected is not None and values.shape != expected:
        raise wrong_size(source, "a map", values.shape, expected, "the views have")
    refuse_not_finite(values, source, ("y", "x"))
    height, width = values.shape
    window = centre_window((height, width), crop, scale, source)
    step = scale or 1
    chosen = values[window]
    reduced = nearest(chosen, (chosen.shape[0] // step, chosen.shape[1] // step)) / np.float32(step)
    about = {"units": "px per view step", "long_name": "disparity, positive = nearer", "source": str(source)}
    return xarray.DataArray(reduced.astype(np.float32), dims=("y", "x"), name="disparity", attrs=about)


def _values(path: Path) -> tuple[NDArray[np.float32], Path]:
    """The stored map ``(H, W)`` and the file it lies in."""
    if path.is_dir() and not is_zarr(path):
        file = find_disparity(path)
        if file is None:
            raise DataError(path, "no disparity map", f"{USUAL} or one *disp*.pfm", "give the map's own path")
        path = file
    with open_contents(path) as contents:
        maps = [stored for stored in contents.arrays.values() if stored.numeric and len(stored.shape) == 2]
        named = [stored for stored in maps if stored.name == "disparity"]
        values = contents.only(named or maps, "disparity map", "write it as .pfm, .npy or a variable disparity").whole()
    if values.dtype.kind != "f":
        raise DataError(path, f"{values.dtype} of shape {values.shape}", "a map (y, x) of floats", _MEND)
    return values.astype(np.float32), path


def _size_of_views(path: Path, pattern: str | None) -> tuple[int, int] | None:
    """Height and width of the views in a folder, None for anything else."""
    opened = open_views(path, pattern) if path.is_dir() and path.suffix.lower() not in LABELLED else None
    return None if opened is None else next((s.shape[2], s.shape[3]) for s in opened.arrays.values())
