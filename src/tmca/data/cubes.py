"""`read`: a spectral cube or a light field from any supported file, labelled and in relative irradiance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.arrays import IRRADIANCE
from tmca.data.formats.limits import check_array
from tmca.data.formats.opening import open_contents
from tmca.data.formats.stored import Contents, Stored
from tmca.data.formats.wavelengths import (
    check,
    divisor,
    few_counts,
    find_cube,
    find_known,
    from_argument,
    metres_to_nm,
    nm_to_metres,
    read_sidecar,
    sidecar_paths,
    spectral_axis,
)
from tmca.data.in_memory import SceneWarning
from tmca.data.light_fields import find_light_field, load_views
from tmca.data.pixels import refuse_not_finite, refuse_pixels
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

    Warns:
        SceneWarning: integers of more than 8 bits whose largest leaves two bits of their type free.
    """
    given = None if wavelengths is None else np.asarray(list(wavelengths), dtype=np.float64)
    refuse_rgbd(path)
    with open_contents(path) as contents:
        views = find_light_field(contents, variable)
        if views is not None:
            for name, value in (("wavelengths", given), ("bands", bands)):
                if value is not None:
                    raise SettingError(name, f"some for {path}", "none: it is a light field", "leave them out")
            return load_views(contents, views, divide_by=scale)
        stored, axis, metres, origin = locate_cube(contents, variable, given)
        chosen = _band_indices(bands, stored.shape[axis])
        pixels = _load(contents.path, stored, axis, chosen)
        check_pixels(pixels, contents.path, negative)
        by, scaled = divisor(stored, axis, scale, pixels if bands is None else None)
        coords = _other_coords(stored, axis)
    if bands is None and scaled == "integer type" and (hint := few_counts(stored.dtype, float(pixels.max()))):
        warn(f"{path}: {hint}", SceneWarning, stacklevel=2)
    pixels /= np.float32(by)
    about = {
        "source": str(path),
        "variable": stored.name,
        "scale": by,
        "scale_from": scaled,
        "wavelengths_from": origin,
    }
    return label(pixels, metres[chosen], about, coords)


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
    return xarray.DataArray(
        pixels,
        dims=("wavelength", "y", "x"),
        coords={"wavelength": wavelength, "wavelength_nm": in_nm, **(coords or {})},
        name="cube",
        attrs={**IRRADIANCE, **(attrs or {})},
    )


class Located(NamedTuple):
    """The cube of an open file.

    Attributes:
        stored: the array.
        axis: over wavelength.
        metres: wavelengths, one per band.
        origin: where they come from.
    """

    stored: Stored
    axis: int
    metres: NDArray[np.float64]
    origin: str


def locate_cube(
    contents: Contents, variable: str | None = None, wavelengths: NDArray[np.float64] | None = None
) -> Located:
    """The cube of an open file with its wavelengths, nothing loaded; arguments as in `read`.

    Raises:
        DataError: no cube, several, no spectral axis, or not one wavelength per band.
        SettingError: wavelengths that are not in metres.
    """
    path = contents.path
    sidecar = None if wavelengths is not None else read_sidecar(path)
    listed = sidecar if wavelengths is None else wavelengths
    count = None if listed is None else listed.size
    stored = find_cube(contents, variable, count)
    axis = spectral_axis(stored, count)
    if listed is None and stored.wavelengths is None and stored.misfit:
        found = f"{stored.misfit} beside {stored.name} of {'×'.join(map(str, stored.shape))}"
        remedy = "name them with wavelengths= (--wavelengths in nm)"
        raise DataError(path, found, "one wavelength for each band", remedy)
    if contents.format == "picture" and listed is None:
        remedy = "make up its spectra with tmca.data.spectral_from_rgb, or pass wavelengths= if its channels are bands"
        raise DataError(path, f"a picture of {stored.shape[-1]} colour channels", "a spectral cube", remedy)
    if axis is None:
        there = f"{stored.name} of shape {stored.shape}, in which no axis stands out as the spectral one"
        raise DataError(path, there, "one axis as long as the wavelengths", "pass wavelengths= (--wavelengths)")
    return Located(stored, axis, *_wavelengths(stored, stored.shape[axis], path, wavelengths, sidecar))


def _wavelengths(
    stored: Stored,
    bands: int,
    path: Path,
    given: NDArray[np.float64] | None,
    sidecar: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], str]:
    """Those of the bands of a cube, metres, and where they come from."""
    if given is not None:
        return from_argument(given, bands, path), "argument"
    if sidecar is not None:
        return check(sidecar, bands, path, "the sidecar file"), "sidecar"
    if stored.wavelengths is not None:
        return check(stored.wavelengths, bands, path, "the file"), "file"
    if (known := find_known(stored.name, bands)) is not None:
        return nm_to_metres(known.nm), known.label
    remedy = f"pass wavelengths= (--wavelengths in nm), or list them in nm in {sidecar_paths(path)[0].name}"
    raise DataError(path, f"{bands} bands without wavelengths", f"{bands} wavelengths", remedy)


def _band_indices(bands: Sequence[int] | None, count: int) -> NDArray[np.int64]:
    if bands is None:
        return np.arange(count)
    chosen = np.asarray(list(bands), dtype=np.int64)
    if not chosen.size or chosen.min() < 0 or chosen.max() >= count or np.unique(chosen).size != chosen.size:
        raise SettingError("bands", str(chosen.tolist()), f"different band indices from 0 to {count - 1}")
    return chosen


def _load(path: Path, stored: Stored, axis: int, chosen: NDArray[np.int64]) -> NDArray[np.float32]:
    """``(L, y, x)`` float32 of the chosen bands; all at once only where every band is wanted."""
    turn = _spatial_dims(stored, axis) == ["x", "y"]
    check_array(path, stored.name, (len(chosen), stored.size // stored.shape[axis]), 4)
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
    refuse_not_finite(cube, where, ("band", "y", "x"))
    if negative == "error":
        remedy = 'set them to 0 in the file, or read it with negative="clip" (--negative clip)'
        refuse_pixels(cube, cube < 0, where, "negative", ("band", "y", "x"), remedy)
    elif negative == "clip":
        np.maximum(cube, 0, out=cube)
