"""Spectral cubes as items: bands, colours as an eye would see them, predicted deviation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import Contents, Stored, metres_to_nm
from tmca.data.cubes import Located, locate_cube
from tmca.data.formats.wavelengths import divisor
from tmca.metrics import with_unit
from tmca.plots.cube import RGB_WAVELENGTHS, rgb_bands, rgb_composite, white_level
from tmca.viewer.items import Axis, Item, Layer, thinning

IRRADIANCE = "relative irradiance"
ONE = Axis("", "", (0.0,))
"""Of a layer of one plane."""
_SCANNED = 2**30
"""Bytes of floats whose maximum is looked for, which is what they are divided by where it is above 1."""
_LOOKED_AT = 2**18
"""Pixels from which the level of white is taken."""


class Bands:
    """A cube in an open file, (bands, rows, columns) whatever the order of its axes."""

    def __init__(self, located: Located) -> None:
        stored, axis = located.stored, located.axis
        self.stored, self.axis, self.metres, self.origin = stored, axis, located.metres, located.origin
        rows, columns = (other for other in range(3) if other != axis)
        self.order = (axis, columns, rows) if stored.dims and stored.dims[rows] == "x" else (axis, rows, columns)
        self.size = stored.shape[self.order[1]], stored.shape[self.order[2]]

    @cached_property
    def scale(self) -> tuple[float, str]:
        """What stored values are divided by, and where that comes from; 1 where it would take too long to find."""
        stated = self.stored.full_scale is not None or self.stored.dtype.kind in "iub"
        if not stated and self.stored.size * self.stored.dtype.itemsize > _SCANNED:
            return 1.0, "the file"
        return divisor(self.stored, self.axis, None, None)

    def band(self, index: int, rows: slice, columns: slice) -> NDArray[Any]:
        """Some rows and columns of a band, in relative irradiance."""
        return self._part(slice(index, index + 1), rows, columns)[0]

    def spectra(self, rows: slice, columns: slice) -> NDArray[Any]:
        """All bands of some rows and columns."""
        return self._part(slice(None), rows, columns)

    def _part(self, *slices: slice) -> NDArray[Any]:
        at = dict(zip(self.order, slices, strict=True))
        values = np.asarray(self.stored.load(tuple(at[axis] for axis in range(3))))
        return values.transpose(self.order).astype(np.float32) / np.float32(self.scale[0])


def cube_item(contents: Contents, title: str, variable: str | None = None, **about: Any) -> Item:
    """The cube of an open file with what the file says of its pixels beside it; ``about`` of the `Item`.

    Raises:
        DataError: it holds no cube.
    """
    bands = Bands(locate_cube(contents, variable))
    axis = wavelength_axis(bands.metres)
    values = Layer("values", IRRADIANCE, bands.size, axis, bands.band, column=bands.spectra)
    deviation = _like(contents, "deviation", bands)
    layers = [values, colour_layer(values, bands.metres)]
    if deviation is not None:
        label = "predicted standard deviation"
        layers.append(
            Layer("deviation", label, bands.size, axis, deviation.band, "", "deviation", column=deviation.spectra)
        )
    return Item("cube", title, tuple(layers), cube_facts(contents, bands), **about)


def wavelength_axis(metres: NDArray[np.float64]) -> Axis:
    """Of the bands of a cube."""
    return Axis("wavelength", "nm", tuple(float(nm) for nm in metres_to_nm(metres)))


def colour_layer(values: Layer, metres: NDArray[np.float64], white: float | None = None) -> Layer:
    """Colours of a cube as the package's figures have them; of one that an eye does not see three bands spread over it.

    Args:
        values: the cube.
        metres: its wavelengths.
        white: irradiance that is shown as white.
    """
    chosen = rgb_bands(metres.tolist())
    lengths = RGB_WAVELENGTHS
    step = thinning(values.size, _LOOKED_AT)

    def level() -> float:
        few = np.stack([values.plane(index, step) for index in chosen])
        return white_level(np.nan_to_num(few), lengths)

    known = [white] if white is not None else []

    def read(index: int, rows: slice, columns: slice) -> NDArray[Any]:
        if not known:
            known.append(level())
        three = np.nan_to_num(np.stack([values.read(band, rows, columns) for band in chosen]))
        return np.round(255 * rgb_composite(three, lengths, known[0])).astype(np.uint8)

    names = tuple(f"{nm:.0f} nm" for nm in metres_to_nm(metres)[list(chosen)])
    return Layer("colour", "colours", values.size, ONE, read, colours="picture", view={"bands": names})


def _like(contents: Contents, name: str, bands: Bands) -> Bands | None:
    """Another array of a file with the axes of its cube, in the cube's units."""
    stored = contents.arrays.get(name)
    if stored is None or stored.shape != bands.stored.shape or not stored.numeric:
        return None
    beside = Bands(Located(stored, bands.axis, bands.metres, bands.origin))
    beside.scale = bands.scale
    return beside


def cube_facts(contents: Contents, bands: Bands) -> dict[str, Any]:
    """What is said of a cube beside its pictures."""
    rows, columns = bands.size
    nm = metres_to_nm(bands.metres)
    facts: dict[str, Any] = {
        "size": f"{rows} × {columns} pixels, {len(nm)} bands",
        "wavelengths": f"{nm[0]:.6g} to {nm[-1]:.6g} nm (from: {bands.origin})",
        "format": f"{contents.format}, {bands.stored.name}, {bands.stored.dtype}",
    }
    by, origin = bands.scale
    if by != 1:
        facts["divided by"] = f"{by:g} (from: {origin})"
    return facts | said(contents.attrs)


_SAID = ("decoder", "camera", "scene", "prior", "weights", "seconds")


def said(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes of the package's own files that people ask for, metrics among them."""
    found: dict[str, Any] = {}
    for name, value in attrs.items():
        if isinstance(value, str | int | float | np.number) and (name in _SAID or name.startswith("metric_")):
            if name.startswith("metric_") and not isinstance(value, str):
                found |= merit_facts({name.removeprefix("metric_"): float(value)})
                continue
            text = value if isinstance(value, str) else f"{float(value):.4g}"
            if text:
                found[name.removeprefix("metric_")] = text[:80]
    return found


_WITHIN = {"coverage_1s": ("within ±1 σ", 68), "coverage_2s": ("within ±2 σ", 95)}


def merit_facts(metrics: Mapping[str, float]) -> dict[str, str]:
    """Figures of merit with their units, as they are said beside pictures."""
    plain = {name: value for name, value in metrics.items() if name not in _WITHIN}
    found = {name.replace("_", " ").upper(): with_unit(name, value) for name, value in plain.items()}
    for name, (said, expected) in _WITHIN.items():
        if name in metrics:
            found[said] = f"{metrics[name]:.1%} of the values ({expected} % expected)"
    return found


def stored_maps(contents: Contents, size: tuple[int, int]) -> dict[str, Stored]:
    """Maps (rows, columns) beside a cube in its file, by name."""
    return {name: one for name, one in contents.arrays.items() if one.shape == size and one.numeric}
