"""Choosing bands of a labelled cube by wavelength."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.wavelengths import metres_to_nm
from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    import xarray


def select_bands(cube: xarray.DataArray, count: int, low: float = 400e-9, high: float = 700e-9) -> xarray.DataArray:
    """The ``count`` bands nearest to even spacing from ``low`` to ``high``.

    For CAVE's 31 bands and ``count=12`` these are 0, 3, 5, 8, 11, 14, 16, 19, 22, 25, 27, 30.

    Args:
        cube: with a ``wavelength`` coordinate in metres.
        count: how many bands, 1 or more; one band is the one nearest to the middle.
        low: metres.
        high: metres.

    Raises:
        SettingError: an impossible count or range, or so many bands that one would be taken twice.
        DataError: the cube has no wavelengths or does not cover the range.
    """
    if count < 1:
        raise SettingError("bands", str(count), "1 band or more")
    if not 0 < low < high:
        raise SettingError("low, high", f"{low:g} m to {high:g} m", "0 < low < high, in metres")
    _require_covered(cube, np.array([low, high]))
    targets = np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
    return nearest_bands(cube, targets)


def nearest_bands(cube: xarray.DataArray, wavelengths: Iterable[float]) -> xarray.DataArray:
    """The band nearest to each wavelength (metres), in the order given; of two equally near the shorter one.

    Raises:
        SettingError: two wavelengths have the same nearest band, or there are none.
        DataError: the cube has no wavelengths or a wavelength lies outside its bands.
    """
    targets = np.asarray(list(wavelengths), dtype=np.float64)
    if not targets.size:
        raise SettingError("wavelengths", "an empty list", "one wavelength or more")
    _require_covered(cube, targets)
    index = nearest_index(cube, targets)
    if np.unique(index).size != index.size:
        raise SettingError(
            cube.attrs.get("source", "bands"),
            f"{targets.size} wavelengths for which only {np.unique(index).size} different bands are nearest",
            "a band of its own for each",
            "ask for fewer bands or a wider range",
        )
    return cube.isel(wavelength=index)


def nearest_index(cube: xarray.DataArray, targets: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the band nearest to each target in metres; of two equally near the shorter wavelength."""
    nm = _nm(cube)
    order = np.argsort(nm, kind="stable")
    distance = np.round(np.abs(nm[order][None, :] - metres_to_nm(targets)[:, None]), 4)
    return order[distance.argmin(axis=1)]


def _nm(cube: xarray.DataArray) -> NDArray[np.float64]:
    if "wavelength" not in cube.coords or cube.coords["wavelength"].dims != ("wavelength",):
        raise DataError(cube.attrs.get("source", "cube"), "no wavelength coordinate", "a cube from tmca.data.read")
    return metres_to_nm(cube.coords["wavelength"].values)


def _require_covered(cube: xarray.DataArray, targets: NDArray[np.float64]) -> None:
    """A wavelength counts as covered up to half a band beyond the outermost centres."""
    nm = np.sort(_nm(cube))
    wanted = metres_to_nm(targets)
    low, high = nm[0], nm[-1]
    if nm.size > 1:
        low, high = low - (nm[1] - nm[0]) / 2, high + (nm[-1] - nm[-2]) / 2
    if wanted.min() < low - 1e-3 or wanted.max() > high + 1e-3:
        raise DataError(
            cube.attrs.get("source", "cube"),
            f"bands from {nm[0]:g} to {nm[-1]:g} nm",
            f"bands that cover {wanted.min():g} to {wanted.max():g} nm",
            "ask for a range inside the cube's",
        )


def at_bands(cube: xarray.DataArray, wavelengths: Sequence[float]) -> xarray.DataArray:
    """The cube's nearest band for every wavelength.

    Raises:
        DataError: a wavelength farther from every band than half their spacing.
    """
    own = cube["wavelength"].values
    wanted = np.asarray(wavelengths)
    if len(own) == len(wanted) and np.allclose(own, wanted, rtol=1e-6):
        return cube
    chosen = np.abs(own[:, None] - wanted).argmin(0)
    spacing = np.diff(own).max() if len(own) > 1 else 20e-9
    worst = int(np.abs(own[chosen] - wanted).argmax())
    if abs(own[chosen][worst] - wanted[worst]) > spacing / 2 * (1 + 1e-6) or len(set(chosen)) < len(wanted):
        found = f"bands from {own[0] * 1e9:.0f} to {own[-1] * 1e9:.0f} nm"
        raise DataError(cube.attrs.get("source", "cube"), found, f"one near {wanted[worst] * 1e9:.0f} nm")
    return cube.isel(wavelength=chosen).assign_coords(wavelength=("wavelength", wanted, {"units": "m"}))
