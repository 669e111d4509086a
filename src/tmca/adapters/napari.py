"""napari: what an estimate, a snapshot or a scene holds, as layers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.arguments import described
from tmca.errors import SettingError
from tmca.plots.cube import rgb_composite

if TYPE_CHECKING:
    import xarray as xr

Layer = tuple[np.ndarray, dict[str, Any], str]
"""Data, settings and kind of a layer, as napari's readers and ``Layer.create`` take them."""
_DRAWN = {"deviation": "magma", "depth": "viridis", "confidence": "viridis"}


def to_napari(thing: Any) -> list[Layer]:
    """Layers of an estimate, a snapshot or a labelled scene: ``for layer in to_napari(estimate): viewer.add_layer(
    napari.layers.Layer.create(*layer))``.

    Sliders over bands read nanometres where bands are evenly spaced; ``metadata["wavelengths_nm"]`` always has them. A
    cube also comes as a picture in its colours. napari itself is not needed here.

    Args:
        thing: a `tmca.Estimate`, a `tmca.Snapshot`, or what `tmca.read` gives.

    Raises:
        SettingError: something else.
    """
    held = thing.to_xarray() if hasattr(thing, "to_xarray") else thing
    if hasattr(held, "to_dataset") and not hasattr(held, "data_vars"):
        held = held.to_dataset(name=held.name or "scene")
    if not hasattr(held, "data_vars"):
        raise SettingError("layers of", described(thing), "an Estimate, a Snapshot, or a labelled scene")
    shown = [name for name in held.data_vars if {"y", "x"} <= set(held[name].dims) or "x_sensor" in held[name].dims]
    if "snapshot" in shown:
        shown = ["snapshot"]
    return [layer for name in shown for layer in _layers(str(name), held[name])]


def _layers(name: str, values: xr.DataArray) -> list[Layer]:
    """An array as a layer; a cube also in its colours."""
    about: dict[str, Any] = {"name": name, "colormap": _DRAWN.get(name, "gray"), "metadata": dict(values.attrs)}
    if name == "deviation":
        about["visible"] = False
    layer = (np.asarray(values), about, "image")
    if "wavelength" not in values.coords or "wavelength" not in values.dims:
        return [layer]
    nanometres = np.asarray(values["wavelength"]) * 1e9
    about["metadata"]["wavelengths_nm"] = nanometres.tolist()
    place = values.dims.index("wavelength")
    steps, start = np.diff(nanometres), np.zeros(values.ndim)
    if len(steps) and np.allclose(steps, steps[0], rtol=1e-3):
        start[place] = nanometres[0]
        about["scale"] = [float(steps[0]) if axis == place else 1.0 for axis in range(values.ndim)]
        about["translate"] = start.tolist()
    if name == "deviation" or values.ndim != 3:
        return [layer]
    picture = rgb_composite(np.asarray(values.transpose("wavelength", "y", "x")), (nanometres * 1e-9).tolist())
    return [layer, (picture, {"name": f"{name}, colours", "rgb": True}, "image")]
