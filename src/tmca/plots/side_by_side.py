"""Estimates side by side for a paper: what is drawn of cubes, of light fields, of scenes with depth, and of others."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.fitting import MAPPED, mapping_of
from tmca.metrics import psnr
from tmca.metrics.refocusing import colour_views
from tmca.plots.cube import rgb_composite, sample_points, white_level
from tmca.plots.light_field import centre_view, error_top
from tmca.plots.paper import Curves, Panels, Picture, Scale, fits_a_page, paper_figure
from tmca.plots.style import bright_level, most_of, rms
from tmca.plots.views import brightest, horizontal_slice, liveliest, shown

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

Name = tuple[str, str]
"""Of a column, of a row."""
_UNIT = "relative irradiance"
_ERRORS = ("error", "off")
"""Scales of maps of errors."""
_POINTS = 3
_SLICE = 0.22
"""Height of an epipolar picture as a share of its width."""
_TIMES_BEST = 3
"""End of the scale of errors, at most, in those of the best estimate."""
_AVERAGED = ("frame", "slot")
"""Axes of time, over which an estimate is shown as its mean."""


def side_by_side(estimates: Mapping[Name, xr.Dataset], truth: Any = None, names: Sequence[Name] = ()) -> Figure:
    """Estimates of one scene in a figure for a paper, beside the truth with error maps and PSNR where it is known.

    Args:
        estimates: (name of the column, name of the row) → as `Estimate.to_xarray` labels it; all of one shape.
        truth: the scene, brought to the camera: its radiance, or with its depth.
        names: all that have a place, in their order; in the places of those without an estimate stands that it failed.

    Returns:
        A figure that fits a page. Where there are more rows than columns, they change places: a page is filled, and
        not a strip beside the truth. Its label says what was left out: error maps, then the last rows as drawn.
    """
    panels, said = replace(_panels(estimates, truth), names=names), ""
    if len(panels.rows) > len(panels.columns):
        panels = _turned(panels)
    if not fits_a_page(panels):
        panels, said = _without_errors(panels), "Error maps are left out, so that the figure fits a page."
    while not fits_a_page(panels) and any(row != panels.rows[-1] for _, row in panels.estimates):
        panels = _without_last(panels)
        said = f"So that the figure fits a page, it has no error maps, and the first {len(panels.rows)} rows alone."
    figure = paper_figure(panels)
    figure.set_label(said)
    return figure


def _turned(panels: Panels) -> Panels:
    """Columns as rows, and rows as columns."""
    turned = {(row, column): pictures for (column, row), pictures in panels.estimates.items()}
    return replace(panels, estimates=turned, names=[(row, column) for column, row in panels.names])


def _without_errors(panels: Panels) -> Panels:
    """All but the maps of errors."""
    kept = {name: [one for one in each if one.scale not in _ERRORS] for name, each in panels.estimates.items()}
    scales = {name: scale for name, scale in panels.scales.items() if name not in _ERRORS}
    return replace(panels, estimates=kept, scales=scales)


def _without_last(panels: Panels) -> Panels:
    """All but the last row."""
    last = panels.rows[-1]
    kept = {name: each for name, each in panels.estimates.items() if name[1] != last}
    return replace(panels, estimates=kept, names=[name for name in panels.names or kept if name[1] != last])


def _panels(estimates: Mapping[Name, xr.Dataset], truth: Any) -> Panels:
    """What is drawn of a kind of scene."""
    still = {name: one.mean([axis for axis in _AVERAGED if axis in one.dims]) for name, one in estimates.items()}
    first = next(iter(estimates.values()))
    if "depth" in first:
        return _with_depth(still, truth, first.attrs)
    values = {name: one["estimate"].values for name, one in still.items()}
    real = None if truth is None else np.asarray(getattr(truth, "values", truth))
    if "wavelength" in first["estimate"].dims:
        return _cubes(values, real, first["estimate"]["wavelength"].values.tolist())
    return _views(values, real) if "view_v" in first["estimate"].dims else _others(values, real)


def what_differs(estimates: Sequence[xr.Dataset], truths: Sequence[Any]) -> str:
    """What keeps estimates out of one picture: a shape, a coordinate or the truth; nothing where they fit.

    Args:
        estimates: as `Estimate.to_xarray` labels them.
        truths: of each, brought to its camera; or None.
    """
    first, *others = estimates
    for one in others:
        if _shapes(one) != _shapes(first):
            return "shape"
        for name, values in _coordinates(first).items():
            if not np.allclose(_coordinates(one).get(name, np.nan), values, rtol=1e-6, atol=0):
                return name
    return "" if all(_is_same(truths[0], truth) for truth in truths[1:]) else "truth"


def _shapes(estimate: xr.Dataset) -> dict[str, tuple[int, ...]]:
    return {str(name): one.shape for name, one in estimate.data_vars.items() if name != "deviation"}


def _coordinates(estimate: xr.Dataset) -> dict[str, np.ndarray]:
    """Of bands and views."""
    names = ("wavelength", "view_v", "view_u")
    return {name: np.asarray(estimate.coords[name].values) for name in names if name in estimate.coords}


def _is_same(one: Any, other: Any) -> bool:
    """Whether two truths have the same values."""
    if one is None or other is None:
        return one is other
    if hasattr(one, "data_vars"):
        return all(_is_same(one[name], other[name]) for name in ("radiance", "depth"))
    return np.array_equal(np.asarray(one), np.asarray(other), equal_nan=True)


def _cubes(values: Mapping[Name, np.ndarray], truth: np.ndarray | None, waves: Sequence[float]) -> Panels:
    """Colour composites, error maps, and spectra at points."""
    reference = next(iter(values.values())) if truth is None else truth
    white, points = white_level(reference, waves), sample_points(reference, _POINTS)
    errors = _Errors(values, truth)
    estimates = {
        name: [Picture(rgb_composite(cube, waves, white), text=_level(cube, truth)), *errors.maps(name)]
        for name, cube in values.items()
    }
    real = () if truth is None else (Picture(rgb_composite(truth, waves, white), marks=points),)
    return Panels(estimates, real, errors.scales(), _spectra(values, truth, waves, points))


def _spectra(
    values: Mapping[Name, np.ndarray],
    truth: np.ndarray | None,
    waves: Sequence[float],
    points: Sequence[tuple[int, int]],
) -> list[Curves]:
    """Of the truth, and of the best estimate of every column; of the first one where the truth is not known."""
    best: dict[str, tuple[float, Name]] = {}
    for name, cube in values.items():
        level = 0.0 if truth is None else psnr(cube, truth)
        if name[0] not in best or level > best[name[0]][0]:
            best[name[0]] = level, name
    several = len({row for _, row in values}) > 1
    lines = {f"{name[0]}, {name[1]}" if several else name[0]: values[name] for _, name in best.values()}
    cubes = {**({} if truth is None else {"truth": truth}), **lines}
    nanometres = np.asarray(waves) * 1e9
    return [
        Curves(f"point {number}", nanometres, {name: cube[:, row, column] for name, cube in cubes.items()},
               ("wavelength (nm)", _UNIT))
        for number, (row, column) in enumerate(points, 1)
    ]  # fmt: skip


def _views(values: Mapping[Name, np.ndarray], truth: np.ndarray | None) -> Panels:
    """Centre views, epipolar pictures of one row below them, and error maps."""
    reference = next(iter(values.values())) if truth is None else truth
    white, row = brightest(reference), liveliest(reference)[0]
    errors = _Errors(values, truth)

    def drawn(field: np.ndarray, text: str) -> list[Picture]:
        slice_of_row = shown(horizontal_slice(colour_views(field), row), white)
        return [Picture(centre_view(field, white), text=text), Picture(slice_of_row, height=_SLICE)]

    estimates = {name: [*drawn(field, _level(field, truth)), *errors.maps(name)] for name, field in values.items()}
    return Panels(estimates, () if truth is None else drawn(truth, ""), errors.scales())


def _with_depth(estimates: Mapping[Name, xr.Dataset], truth: Any, about: Mapping[str, Any]) -> Panels:
    """Colour composites, depth maps, their errors, and spectra."""
    cubes = {name: one["radiance"].values for name, one in estimates.items()}
    depths = {name: one["depth"].values for name, one in estimates.items()}
    waves = next(iter(estimates.values()))["radiance"]["wavelength"].values.tolist()
    cube, depth = (None, None) if truth is None else (truth["radiance"].values, truth["depth"].values)
    panels, ends = _cubes(cubes, cube, waves), _ends(depths, depth, about)
    off = {} if depth is None else {name: np.abs(one - depth) for name, one in depths.items()}
    scales = {"depth": Scale(f"{MAPPED if mapping_of(about) else 'depth'} (m)", "turbo_r", *ends)}
    scales |= {"off": _error_scale("depth error (m)", [*off.values()], error_top)} if off else {}
    drawn = {
        name: [pictures[0], Picture(depths[name], "depth", f"{np.nanmean(off[name]):.3f} m off" if off else ""),
               *([Picture(off[name], "off")] if off else [])]
        for name, pictures in panels.estimates.items()
    }  # fmt: skip
    real = () if depth is None else (*panels.truth, Picture(depth, "depth"))
    return Panels(drawn, real, scales, panels.curves)


def _ends(depths: Mapping[Name, np.ndarray], truth: np.ndarray | None, about: Mapping[str, Any]) -> tuple[float, float]:
    """Nearest and farthest depth that is shown: those of the camera's planes, or of the maps."""
    if "depth_planes" in about:
        planes = json.loads(about["depth_planes"])
        return float(planes["near"]), float(planes["far"])
    maps = [one for one in (*depths.values(), truth) if one is not None]
    return min(float(np.nanmin(one)) for one in maps), max(float(np.nanmax(one)) for one in maps)


def _others(values: Mapping[Name, np.ndarray], truth: np.ndarray | None) -> Panels:
    """Means over all axes but rows and columns, and error maps."""
    reference = next(iter(values.values())) if truth is None else truth
    top, errors = bright_level(_mean(reference)), _Errors(values, truth)
    scale = {"mean": Scale("mean", "gray", 0.0, top)}
    estimates = {
        name: [Picture(_mean(one), "mean", _level(one, truth)), *errors.maps(name)] for name, one in values.items()
    }
    real = () if truth is None else (Picture(_mean(truth), "mean"),)
    return Panels(estimates, real, {**errors.scales(), **scale})


def _mean(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, *values.shape[-2:]).mean(0)


def _level(values: np.ndarray, truth: np.ndarray | None) -> str:
    return "" if truth is None else f"{psnr(*_flat(values, truth)):.1f} dB"


def _flat(*several: np.ndarray) -> list[np.ndarray]:
    """All bands or views on one axis."""
    return [values.reshape(-1, *values.shape[-2:]) for values in several]


class _Errors:
    """Error maps of estimates on one scale; none where the truth is not known."""

    def __init__(self, values: Mapping[Name, np.ndarray], truth: np.ndarray | None) -> None:
        self.errors = {} if truth is None else {name: rms(one - truth) for name, one in values.items()}

    def maps(self, name: Name) -> list[Picture]:
        """That of an estimate."""
        return [Picture(self.errors[name], "error")] if self.errors else []

    def scales(self) -> dict[str, Scale]:
        """Theirs: 99 of a hundred pixels lie below its end, see `_error_scale`."""
        return {"error": _error_scale("error, rms", [*self.errors.values()], most_of)} if self.errors else {}


def _error_scale(label: str, maps: Sequence[np.ndarray], end: Callable[[Sequence[np.ndarray]], float]) -> Scale:
    """Of maps of errors: up to where most of all lie, but at most a few times as far as most of the best map lie, so
    that one that failed does not make the others black; the label then says so."""
    whole, best = end(maps), min(end([one]) for one in maps)
    if whole <= _TIMES_BEST * best:
        return Scale(label, "magma", 0.0, whole)
    return Scale(f"{label}, up to {_TIMES_BEST} × the best", "magma", 0.0, _TIMES_BEST * best)
