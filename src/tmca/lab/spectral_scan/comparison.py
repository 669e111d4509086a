"""Spectra of points of a cube against a spectrometer's, by spectral angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError
from tmca.lab.spectral_scan.spectra_files import Spectra
from tmca.metrics import sam

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """One point: its mean spectrum, its spread over the box and the reference at ``nm``, all ``(L,)``.

    ``angle`` is the SAM in degrees, ``rmse`` the root mean square difference; ``filters`` has per filter response
    what it sees of (spectrum, reference).
    """

    name: str
    place: tuple[int, int]
    nm: Array
    spectrum: Array
    spread: Array
    reference: Array
    angle: float
    rmse: float
    filters: dict[str, tuple[float, float]]

    @property
    def scale(self) -> float:
        """By what the spectrum is multiplied to come nearest to the reference; 1 where both have the same units."""
        return float(self.spectrum @ self.reference / (self.spectrum @ self.spectrum))

    def row(self) -> dict[str, Any]:
        """For a table or JSON."""
        seen = {f"filter {name}": values for name, values in self.filters.items()}
        y, x = self.place
        return {"point": self.name, "y": y, "x": x, "bands": self.nm.size, "sam": self.angle, "rmse": self.rmse, **seen}


def compare_spectra(
    cube: xr.DataArray,
    references: Spectra,
    points: Mapping[str, tuple[int, int]],
    *,
    box: int = 5,
    width_nm: float = 0.0,
    filters: Spectra | None = None,
) -> list[Comparison]:
    """Compare boxes of a cube with the reference spectra of the same names, as in figure 30 of the thesis.

    Args:
        cube: ``(wavelength, y, x)``; NaN is left out, and a band with nothing else is not compared.
        references: of a spectrometer.
        points: (row, column) of a box's middle, by the name of its reference.
        box: pixels along each side, odd.
        width_nm: of the scan's bands, by which the references are smoothed; see `Spectra.at`.
        filters: responses through which both are seen too.

    Raises:
        SettingError: an even box, no points, or one without reference.
        DataError: a point outside, or whose box has no spectrum; references that do not cover the bands.
    """
    if box < 1 or box % 2 == 0:
        raise SettingError("box", str(box), "an odd number of pixels")
    if not points:
        raise SettingError("points", "none", "NAME=ROW,COLUMN for each reference")
    nm = metres_to_nm(cube["wavelength"].values)
    known = dict(zip(references.names, references.at(nm, width_nm), strict=True))
    for name in points:
        if name not in known:
            raise SettingError("points", name, f"a reference in {references.source} ({', '.join(known)})")
    responses = {} if filters is None else dict(zip(filters.names, filters.at(nm), strict=True))
    return [_compared(cube, nm, name, place, known[name], box, responses) for name, place in points.items()]


def _compared(
    cube: xr.DataArray,
    nm: Array,
    name: str,
    place: tuple[int, int],
    reference: Array,
    box: int,
    responses: Mapping[str, Array],
) -> Comparison:
    half, (y, x), size = box // 2, place, cube.shape[1:]
    where = cube.attrs.get("source", "cube")
    if not (half <= y < size[0] - half and half <= x < size[1] - half):
        found = f"point {name} at {y},{x} with a box of {box}"
        raise DataError(where, found, f"a box inside {size[0]}×{size[1]} pixels")
    pixels = cube.values[:, y - half : y + half + 1, x - half : x + half + 1].reshape(len(nm), -1).astype(np.float64)
    seen = np.isfinite(pixels).any(axis=1)
    if seen.sum() < 2:
        raise DataError(where, f"{seen.sum()} bands measured at {name} ({y},{x})", "2 or more", "choose another point")
    nm, reference, pixels = nm[seen], reference[seen], pixels[seen]
    spectrum, spread = np.nanmean(pixels, axis=1), np.nanstd(pixels, axis=1)
    angle = float(sam(spectrum[:, None, None], reference[:, None, None]))
    rmse = float(np.sqrt(np.mean((spectrum - reference) ** 2)))
    through = {n: (_through(r[seen], spectrum), _through(r[seen], reference)) for n, r in responses.items()}
    return Comparison(name, place, nm, spectrum, spread, reference, angle, rmse, through)


def _through(response: Array, spectrum: Array) -> float:
    total = response.sum()
    return float(response @ spectrum / total) if total > 0 else float("nan")
