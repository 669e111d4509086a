"""An estimate beside the truth: its labelled axes say which pictures it is drawn in."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.fitting import MAPPED, METRES, fit_cube, fit_depth_scene, fit_views, mapping_of
from tmca.data.light_field_scenes import load_light_field
from tmca.data.scene_names import READING
from tmca.data.scenes import load_scene
from tmca.errors import SettingError, check_shape
from tmca.plots.cube import note_false_colour, reconstruction_figure, rgb_composite
from tmca.plots.depth import depth_figure
from tmca.plots.light_field import light_field_figure
from tmca.plots.style import bright_level, image_figure
from tmca.plots.thumbnails import Panel, row_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    Scene = xr.DataArray | xr.Dataset
    Points = Sequence[tuple[int, int]] | None


def estimate_figure(
    estimate: xr.Dataset,
    truth: Any = None,
    limits: tuple[float, float] | None = None,
    at: Sequence[tuple[int, int]] | None = None,
) -> Figure:
    """Composites or views, depth if any, errors and predicted deviation, spectra; of other axes their mean.

    Args:
        estimate: as ``Estimate.to_xarray`` labels it; of several snapshots the first, of several slots the mean.
        truth: the scene, brought to the estimate's bands and size, or the name or file of one, or an array as large as
            the estimate; of a dataset the first variable, or ``radiance`` and ``depth``.
        limits: nearest and farthest depth, metres, of an estimate with depth.
        at: pixels (row, column) whose spectra are drawn; some of different spectra without.

    Raises:
        DataError: a truth of another kind, or a smaller one.
        SettingError: pixels outside the estimate, or of one that has no spectra.
    """
    first = mean_frame(estimate.isel(snapshot=0) if "snapshot" in estimate.dims else estimate, truth is not None)
    whole: Any = _read(str(truth), first, limits) if isinstance(truth, str | Path) else truth
    if limits is not None:
        return _with_depth(first, whole, limits, at)
    if whole is not None and not hasattr(whole, "dims"):
        check_shape("truth", whole, (..., *first["estimate"].shape))
        whole = first["estimate"].copy(data=np.asarray(whole).reshape(first["estimate"].shape))
    scene = next(iter(whole.data_vars.values())) if hasattr(whole, "data_vars") else whole
    axes = first["estimate"].dims
    if "wavelength" in axes:
        return _cube(first, scene, at)
    if at is not None:
        raise SettingError("at", str(at), "none: this estimate has no spectra", "leave it out")
    return (_views if "view_v" in axes else _other)(first, scene)


def mean_frame(estimate: xr.Dataset, compared: bool = False) -> xr.Dataset:
    """The mean of an estimate in frames, which its name says, and what it is ``compared`` with; others as they are. Its
    deviation is the mean of theirs, which is at least its own."""
    count = estimate.sizes.get("slot")
    if count is None:
        return estimate
    name = f"{estimate.attrs.get('decoder', 'estimate')}, mean of {count} frames"
    name += "\nagainst the scene at rest" if compared else ""
    return estimate.mean("slot", keep_attrs=True).assign_attrs(decoder=name)


def estimate_thumbnail(estimate: xr.Dataset) -> Figure:
    """A small row of pictures: the scene in its colours, then depth or the predicted deviation where there is one.

    Args:
        estimate: as ``Estimate.to_xarray`` labels it; of several snapshots the first, of several slots the mean.
    """
    first = mean_frame(estimate.isel(snapshot=0) if "snapshot" in estimate.dims else estimate)
    values = first["radiance" if "radiance" in first else "estimate"]
    panels = [Panel("estimate", _colours(values))]
    if "depth" in first:
        panels.append(Panel("depth", first["depth"].values, "viridis", "m", low=None))
    if "deviation" in first:
        rows = first["deviation"]
        spread = rows.mean([name for name in rows.dims if name not in ("y", "x")]).values
        panels.append(Panel("predicted deviation", spread, "magma", "mean over channels"))
    return row_figure(panels)


def predicted_deviations(estimate: xr.Dataset) -> dict[str, np.ndarray]:
    """The deviation by the name of the decoder; nothing where none is predicted."""
    return {str(estimate.attrs["decoder"]): estimate["deviation"].values} if "deviation" in estimate else {}


def _colours(values: xr.DataArray) -> np.ndarray:
    """A picture of a cube, the view in the middle of a light field, or the mean of what else there is."""
    if "wavelength" in values.dims:
        return rgb_composite(values.values, values["wavelength"].values.tolist())
    if "view_v" in values.dims:
        middle = values.isel(view_v=values.sizes["view_v"] // 2, view_u=values.sizes["view_u"] // 2)
        level = bright_level(middle.values)
        shown = np.clip(middle.transpose("y", "x", ...).values / level, 0, 1)
        return np.asarray(shown ** (1 / 2.2))
    return np.asarray(values.values.reshape(-1, *values.shape[-2:]).mean(0))


def _read(source: str, estimate: xr.Dataset, limits: tuple[float, float] | None) -> Scene:
    """A scene by name or file, as the estimate's scene was read where that is noted."""
    noted = json.loads(estimate.attrs.get(READING, "{}"))
    how = {name: value for name, value in noted.items() if name not in ("source", "size")}
    if limits is not None:
        waves = estimate["wavelength"].values.tolist()
        how |= {"wavelengths": waves, "near": limits[0], "far": limits[1], "size": _size(estimate["radiance"])}
        return load_spectral_depth(source, **how)
    if "view_v" in estimate.sizes:
        how |= {"views": estimate.sizes["view_v"], "colour": "colour" in estimate.sizes}
        return load_light_field(source, **how)
    return load_scene(source, bands=None)


def _size(values: xr.DataArray) -> tuple[int, int]:
    return values.sizes["y"], values.sizes["x"]


def _cube(estimate: xr.Dataset, truth: xr.DataArray | None, at: Points) -> Figure:
    name, values = str(estimate.attrs["decoder"]), estimate["estimate"]
    waves = values["wavelength"].values.tolist()
    scene = None if truth is None else fit_cube(truth, waves, _size(values), "truth").values
    spread = predicted_deviations(estimate)
    return note_false_colour(reconstruction_figure({name: values.values}, waves, scene, spread, at), waves)


def _views(estimate: xr.Dataset, truth: xr.DataArray | None) -> Figure:
    values = estimate["estimate"]
    views = values.sizes["view_v"], values.sizes["view_u"]
    scene = None if truth is None else fit_views(truth, views, _size(values), "truth").values
    name = str(estimate.attrs["decoder"])
    return light_field_figure({name: values.values}, scene, deviations=predicted_deviations(estimate))


def _with_depth(estimate: xr.Dataset, truth: Scene | None, limits: tuple[float, float], at: Points) -> Figure:
    cube, name = estimate["radiance"], str(estimate.attrs["decoder"])
    waves, pair = cube["wavelength"].values.tolist(), (cube.values, estimate["depth"].values)
    how: dict[str, Any] = {"where": "truth", "mapped": METRES not in estimate.attrs}
    scene = None if truth is None else fit_depth_scene(truth, waves, _size(cube), *limits, **how)  # type: ignore[arg-type]
    real = None if scene is None else (scene["radiance"].values, scene["depth"].values)
    label = MAPPED if mapping_of(estimate.attrs) else "depth"
    spread = estimate["depth_deviation"].values if "depth_deviation" in estimate else None
    return depth_figure(name, pair, estimate["confidence"].values, waves, limits, real, at, label, spread)


def _other(estimate: xr.Dataset, truth: xr.DataArray | None) -> Figure:
    values = estimate["estimate"].values
    return image_figure(values.reshape(-1, *values.shape[-2:]).mean(0), str(estimate.attrs["decoder"]))
