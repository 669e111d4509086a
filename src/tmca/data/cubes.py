"""`read`: a spectral cube or a light field from any supported file, labelled and in relative irradiance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.arrays import QUANTITY
from tmca.data.formats.opening import open_contents
from tmca.data.formats.stored import Contents, Stored
from tmca.data.formats.wavelengths import (
    check,
    divisor,
    find_cube,
    find_known,
    from_argument,
    metres_to_nm,
    nm_to_metres,
    read_sidecar,
    sidecar_paths,
    spectral_axis,
)
from tmca.data.light_fields import find_light_field, load_views
from tmca.data.rgbd import refuse_rgbd
from tmca.errors import DataError, SettingError, check_choice

if TYPE_CHECKING:
    import xarray


def read(
    path: str | Path,
    *,
    wavelengths: Iterable[float] | None = None,
    variable: str | None = None,
    scale: float | None = None,
    bands: Sequence[int] | None = None,
    negative: Negative = "error",
) -> xarray.DataArray:
    """Read a spectral cube as relative irradiance with its wavelengths, or a light field in grey.

    Reads CAVE folders, MATLAB 5 and 7.3, ENVI, multi-page TIFF, ``.npy``, NetCDF, HDF5 and Zarr, and finds
    the variable and the spectral axis. Integers are divided by their type's maximum, ICVL's 12-bit ``rad`` by
    4095, floats above 1 by their maximum over all bands. What has views instead of bands is read as by
    `tmca.data.read_light_field` with its defaults, which has the options of light fields.

    Args:
        path: the file or folder.
        wavelengths: metres, one per band of the file. By default, in this order:
            ``<name>.wavelengths.txt|csv`` beside it (nm), the file itself, a known data set of the same
            signature.
        variable: the array to read, where the file has several.
        scale: the divisor instead of the one above.
        bands: indices of the bands to load, all by default; their order is kept.
        negative: ``"error"``, ``"clip"`` to 0, or ``"keep"``.

    Returns:
        dims ``(wavelength, y, x)``, float32; coordinates ``wavelength`` (m) and ``wavelength_nm``; attrs
        ``source``, ``variable``, ``scale`` (the divisor) and ``scale_from``, ``wavelengths_from``. Of a light field:
        see `tmca.data.read_light_field`.

    Raises:
        DataError: the file is missing, damaged, no cube, without wavelengths, or has NaN, infinite or
            negative pixels.
        SettingError: an impossible argument.
    """
    given = None if wavelengths is None else np.asarray(list(wavelengths), dtype=np.float64)
    refuse_rgbd(path)
    with open_contents(path) as contents:
        views = find_light_field(contents, variable)
        if views is not None:
            _no_bands(path, given, bands)
            return load_views(contents, views, divide_by=scale)
        stored = find_cube(contents, variable, None if given is None else given.size)
        sidecar = None if given is not None else read_sidecar(contents.path)
        if given is None and sidecar is None:
            _no_colour_picture(contents, stored)
        axis = _axis(contents, stored, given if given is not None else sidecar)
        metres, origin = find_wavelengths(contents, stored, axis, given, sidecar)
        chosen = _band_indices(bands, stored.shape[axis])
        pixels = _load(stored, axis, chosen)
        complete = pixels if bands is None else None
        check_pixels(pixels, contents.path, negative)
        by, scaled = divisor(stored, axis, scale, complete)
        coords = _other_coords(stored, axis)
    pixels /= np.float32(by)
    about = {
        "source": str(path),
        "variable": stored.name,
        "scale": by,
        "scale_from": scaled,
        "wavelengths_from": origin,
    }
    return label(pixels, metres[chosen], about, coords)


def _no_bands(path: str | Path, wavelengths: object, bands: object) -> None:
    for name, value in (("wavelengths", wavelengths), ("bands", bands)):
        if value is not None:
            raise SettingError(name, f"some for {path}", "none: it is a light field", "leave them out")


def _no_colour_picture(contents: Contents, stored: Stored) -> None:
    if contents.format == "picture" and stored.dims[-1:] == ("channel",):
        remedy = "make up its spectra with tmca.data.spectral_from_rgb, or pass wavelengths= if its channels are bands"
        raise DataError(contents.path, f"a picture of {stored.shape[-1]} colour channels", "a spectral cube", remedy)


def label(
    pixels: NDArray[np.float32],
    metres: NDArray[np.float64],
    attrs: dict[str, Any] | None = None,
    coords: dict[str, NDArray[Any]] | None = None,
) -> xarray.DataArray:
    """A labelled cube from ``(L, H, W)`` pixels in relative irradiance and L wavelengths in metres."""
    import xarray

    nm = metres_to_nm(metres)
    wavelength = ("wavelength", np.asarray(metres, dtype=np.float64), {"units": "m", "long_name": "wavelength"})
    in_nm = ("wavelength", nm, {"units": "nm", "long_name": "wavelength"})
    units = {"quantity": QUANTITY, "units": "1", "long_name": QUANTITY}
    return xarray.DataArray(
        pixels,
        dims=("wavelength", "y", "x"),
        coords={"wavelength": wavelength, "wavelength_nm": in_nm, **(coords or {})},
        name="cube",
        attrs={**units, **(attrs or {})},
    )


def read_array(path: str | Path, variable: str | None = None) -> NDArray[Any]:
    """Read one array as it is: masks, captures, codes. Axes as in `read`, values and dtype untouched.

    Args:
        path: any file that `read` opens, or a picture.
        variable: its name, where the file has several.

    Raises:
        DataError: missing or damaged file, no such variable, or several to choose from.
    """
    with open_contents(path) as contents:
        if variable is None:
            numeric = [s for s in contents.arrays.values() if s.numeric and s.size]
            if len(numeric) != 1:
                names = ", ".join(f"{s.name} {s.shape}" for s in numeric) or "nothing numeric"
                raise DataError(path, names, "one array", "choose it with variable= (--variable)")
            variable = numeric[0].name
        return contents.get(variable).whole()


def _axis(contents: Contents, stored: Stored, given: NDArray[np.float64] | None) -> int:
    axis = spectral_axis(stored, None if given is None else given.size)
    if axis is None:
        raise DataError(
            contents.path,
            f"{stored.name} of shape {stored.shape}, in which no axis stands out as the spectral one",
            "one axis as long as the wavelengths",
            "pass wavelengths= (--wavelengths)",
        )
    return axis


def find_wavelengths(
    contents: Contents,
    stored: Stored,
    axis: int,
    given: NDArray[np.float64] | None,
    sidecar: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], str]:
    """Metres, one per band, and where they come from.

    Raises:
        DataError: there are none, or not one per band.
    """
    path, count = contents.path, stored.shape[axis]
    if given is not None:
        return from_argument(given, count, path), "argument"
    if sidecar is not None:
        return check(sidecar, count, path, "the sidecar file"), "sidecar"
    if stored.wavelengths is not None:
        return check(stored.wavelengths, count, path, "the file"), "file"
    known = find_known(stored.name, count)
    if known is not None:
        return nm_to_metres(known.nm), known.label
    raise DataError(
        path,
        f"{count} bands without wavelengths",
        f"{count} wavelengths",
        f"pass wavelengths= (--wavelengths in nm), or list them in nm in {sidecar_paths(path)[0].name}",
    )


def _band_indices(bands: Sequence[int] | None, count: int) -> NDArray[np.int64]:
    if bands is None:
        return np.arange(count)
    chosen = np.asarray(list(bands), dtype=np.int64)
    if not chosen.size or chosen.min() < 0 or chosen.max() >= count or np.unique(chosen).size != chosen.size:
        raise SettingError("bands", str(chosen.tolist()), f"different band indices from 0 to {count - 1}")
    return chosen


def _load(stored: Stored, axis: int, chosen: NDArray[np.int64]) -> NDArray[np.float32]:
    """``(L, y, x)`` float32 of the chosen bands; all at once only where every band is wanted."""
    turn = _spatial_dims(stored, axis) == ["x", "y"]
    if len(chosen) == stored.shape[axis] and (np.diff(chosen) == 1).all():
        cube = np.moveaxis(stored.whole(), axis, 0)
        return np.array(cube.swapaxes(1, 2) if turn else cube, dtype=np.float32, order="C")
    planes = (stored.plane(axis, int(band)) for band in chosen)
    rows, columns = (n for i, n in enumerate(stored.shape) if i != axis)
    pixels = np.empty((len(chosen), columns, rows) if turn else (len(chosen), rows, columns), dtype=np.float32)
    for band, plane in zip(pixels, planes, strict=True):
        band[...] = plane.T if turn else plane
    return pixels


def _spatial_dims(stored: Stored, axis: int) -> list[str]:
    return [dim for i, dim in enumerate(stored.dims) if i != axis]


def _other_coords(stored: Stored, axis: int) -> dict[str, NDArray[Any]]:
    """The file's own ``y`` and ``x`` coordinates, if the cube's two other axes carry them."""
    others = _spatial_dims(stored, axis)
    return {dim: stored.coords[dim] for dim in others if sorted(others) == ["x", "y"] and dim in stored.coords}


Negative = Literal["error", "clip", "keep"]


def check_pixels(cube: NDArray[np.float32], where: object, negative: Negative = "error") -> None:
    """Refuse a cube with NaN, infinite or negative pixels; with ``negative="clip"`` set the negative ones to
    0.

    Args:
        cube: ``(L, H, W)``, changed in place when clipping.
        where: the file, for the message.
        negative: ``"error"``, ``"clip"``, or ``"keep"`` (reconstructions may have negative pixels).

    Raises:
        DataError: with how many there are and the first position, counted from 0.
        SettingError: an unknown ``negative``.
    """
    check_choice("negative", negative, ("error", "clip", "keep"))
    for name, bad in (("NaN", np.isnan), ("infinite", np.isinf)):
        _refuse(cube, bad(cube), where, name, "mask or repair them first")
    if negative == "error":
        _refuse(
            cube,
            cube < 0,
            where,
            "negative",
            'set them to 0 in the file, or read it with negative="clip" (--negative clip)',
        )
    elif negative == "clip":
        np.maximum(cube, 0, out=cube)


def _refuse(cube: NDArray[np.float32], bad: NDArray[np.bool_], where: object, name: str, remedy: str) -> None:
    count = int(np.count_nonzero(bad))
    if count:
        band, y, x = (int(i) for i in np.unravel_index(int(bad.argmax()), bad.shape))
        first = f"band {band}, y {y}, x {x} ({cube[band, y, x]:g})"
        found = f"{count} {name} pixel{'s' if count > 1 else ''}, the first at {first}"
        raise DataError(where, found, "finite values from 0 up", remedy)
