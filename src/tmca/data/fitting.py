"""Scenes brought to the bands or views, the size and the depth range of a camera."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats.wavelengths import metres_to_nm
from tmca.data.in_memory import SceneWarning, as_cube, as_depth_scene, as_views
from tmca.errors import DataError, SettingError, check_range

if TYPE_CHECKING:
    import xarray as xr

Size = tuple[int, int]
VISIBLE = (400e-9, 700e-9)
"""Metres between which bands are chosen."""
_OTHER_RANGE = "ask for a range inside the cube's (--range FIRST:LAST)"
Scene = TypeVar("Scene", "xr.DataArray", "xr.Dataset")
FITTED = ("inverse_depth_scale", "inverse_depth_shift")
"""Attributes of a scene whose inverse depth was mapped: 1/Z' = scale / Z + shift."""
MAPPED = "depth of the mapped scene"
"""What such a depth is called."""
METRES = "metric_depth"
"""Attribute of a scene, and of what is made of it, whose depth stays in metres."""


def fit_cube(scene: xr.DataArray, wavelengths: Sequence[float], size: Size, where: str = "scene") -> xr.DataArray:
    """The nearest bands of a cube (wavelength, y, x), the middle (H, W) of it.

    Raises:
        DataError: no cube, a smaller one, or one with fewer bands.
    """
    cube, count = as_cube(scene, where), len(wavelengths)
    if cube.sizes["wavelength"] < count:
        found, expected = f"{cube.sizes['wavelength']} bands", f"{count} or more, as the camera or the estimate has"
        raise DataError(where, found, expected, "take a scene of as many bands")
    return _middle(nearest_bands(cube, wavelengths), {"y": size[0], "x": size[1]}, where)


def fit_views(scene: xr.DataArray, views: Size, size: Size, where: str = "scene") -> xr.DataArray:
    """The views in the middle of a light field's grid, the middle (H, W) of each.

    Raises:
        DataError: no light field, or a smaller one.
    """
    wanted = {"view_v": views[0], "view_u": views[1], "y": size[0], "x": size[1]}
    return _middle(as_views(scene, where), wanted, where)


def fit_depth_scene(
    scene: xr.Dataset,
    wavelengths: Sequence[float],
    size: Size,
    near: float,
    far: float,
    where: str = "scene",
    *,
    mapped: bool = True,
) -> xr.Dataset:
    """A scene of ``radiance`` and ``depth`` at these bands, the middle (H, W) of it.

    Depth that reaches beyond ``near`` to ``far``, metres, is mapped onto it, evenly in inverse depth, unless attributes
    of the scene say that it was mapped already or keeps its metres, or it is not to be ``mapped``.

    Raises:
        DataError: no such scene, a smaller one, or one with other bands.

    Warns:
        SceneWarning: which depths were mapped.
    """
    scene = as_depth_scene(scene, where)
    cube, attrs = at_bands(scene["radiance"], wavelengths), dict(scene.attrs)
    fitted = scene.drop_dims("wavelength").assign(radiance=cube).assign_attrs(attrs)
    metres = scene["depth"].values[np.isfinite(scene["depth"].values)]
    mapped = mapped and not {FITTED[0], METRES} & set(attrs)
    if mapped and metres.size and (metres.min() < near or metres.max() > far):
        fitted["depth"], mapping = fitted_depth(scene["depth"], near, far)
        fitted.attrs.update(mapping)
        onto = f"{near:g} to {far:g} m (tmca.simulate(…, metric_depth=True) keeps metres)"
        warn(f"{where}: depths of {metres.min():.3g} to {metres.max():.3g} m mapped onto {onto}", SceneWarning, 5)
    return middle_of(fitted, size, where)


def _middle(scene: Any, wanted: dict[str, int], where: str) -> Any:
    """So many entries from the middle of every axis."""
    if any(scene.sizes[axis] < count for axis, count in wanted.items()):
        there = "×".join(str(scene.sizes[name]) for name in wanted)
        raise DataError(where, f"{there} ({', '.join(wanted)})", f"at least {'×'.join(map(str, wanted.values()))}")
    starts = {axis: (scene.sizes[axis] - count) // 2 for axis, count in wanted.items()}
    return scene.isel({axis: slice(start, start + wanted[axis]) for axis, start in starts.items()})


def centre_window(
    size: tuple[int, int], crop: tuple[int, int] | None, scale: int | None, where: object
) -> tuple[slice, slice]:
    """The stored pixels behind a centre crop of ``crop`` pixels after reduction by ``scale``.

    Raises:
        SettingError: not a whole number above 0, or a crop larger than the views.
    """
    step = 1 if scale is None else scale
    check_range("scale", step, 1, min(size), whole=True, remedy="views are never enlarged")
    reduced = size[0] // step, size[1] // step
    height, width = reduced if crop is None else crop
    if not (1 <= height <= reduced[0] and 1 <= width <= reduced[1]):
        raise SettingError("crop", f"{height}×{width}", f"at most the {reduced[0]}×{reduced[1]} pixels of {where}")
    top, left = (reduced[0] - height) // 2 * step, (reduced[1] - width) // 2 * step
    return slice(top, top + height * step), slice(left, left + width * step)


def middle_of(scene: Scene, size: Size, where: object) -> Scene:
    """(H, W) pixels in the middle of a scene.

    Raises:
        SettingError: a smaller scene.
    """
    rows, columns = centre_window((scene.sizes["y"], scene.sizes["x"]), size, None, where)
    return scene.isel(y=rows, x=columns)


def select_bands(cube: xr.DataArray, count: int, span: tuple[float, float] = VISIBLE) -> xr.DataArray:
    """The ``count`` bands nearest to even spacing over a range, from 400 to 700 nm without one; all bands of the range
    where these are so many, however they are spaced.

    For CAVE's 31 bands and ``count=12`` these are 0, 3, 5, 8, 11, 14, 16, 19, 22, 25, 27, 30.

    Args:
        cube: with a ``wavelength`` coordinate in metres.
        count: how many bands, 1 or more; one band is the one nearest to the middle.
        span: first and last wavelength, metres.

    Raises:
        SettingError: an impossible count, or one for which a band would be taken twice; it says which count will do.
        DataError: the cube has no wavelengths or does not cover the range.
    """
    low, high = span
    if count < 1:
        raise SettingError("bands", str(count), "1 band or more")
    nm = _covering(cube, np.array([low, high]))
    index = _evenly(nm, count, span)
    inside = np.flatnonzero((nm >= low * 1e9 - 1e-3) & (nm <= high * 1e9 + 1e-3))
    if _repeats(index) and count == inside.size:
        index = inside[np.argsort(nm[inside], kind="stable")]
    if _repeats(index):
        fewer = range(min(count - 1, nm.size), inside.size if inside.size < count else 0, -1)
        most = next((n for n in fewer if not _repeats(_evenly(nm, n, span))), inside.size)
        remedy = f"ask for {most}" + (f", or for all {inside.size}" if inside.size > count else "")
        found = f"no {count} different bands near even spacing from {low * 1e9:g} to {high * 1e9:g} nm"
        raise SettingError(cube.attrs.get("source", "bands"), found, "a band of its own for each", remedy)
    return cube.isel(wavelength=index)


def _evenly(nm: NDArray[np.float64], count: int, span: tuple[float, float]) -> NDArray[np.int_]:
    """The band nearest to each of ``count`` wavelengths at even spacing; of one, to the middle."""
    return _nearest(nm, np.linspace(span[0], span[1], count) if count > 1 else np.array([sum(span) / 2]))


def _nearest(nm: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.int_]:
    """The band nearest to each wavelength (metres); of two equally near the shorter one."""
    order = np.argsort(nm, kind="stable")
    return order[np.round(np.abs(nm[order] - metres_to_nm(targets)[:, None]), 4).argmin(axis=1)]


def _repeats(index: NDArray[np.int_]) -> bool:
    return np.unique(index).size < index.size


def usual_bands(scenes: Mapping[str, NDArray[np.float64]], asked: Sequence[float] | None = None) -> dict[str, Any]:
    """How ``bands`` are read where no number is asked for: 12, or all that there are in the range where a scene has
    fewer; and the ``range`` where none is asked for and it is not from 400 to 700 nm, see ``usual_span``.

    Args:
        scenes: name → wavelengths of the bands, metres.
        asked: (first, last) wavelength that bands are taken from, metres.
    """
    span = usual_span(scenes) if asked is None else (asked[0], asked[1])
    low, high = span or VISIBLE
    there = [np.count_nonzero((metres > low - 1e-12) & (metres < high + 1e-12)) for metres in scenes.values()]
    return {"bands": max(1, min(12, *there)), **({} if span is None else {"range": span})}


def usual_span(scenes: Mapping[str, NDArray[np.float64]]) -> tuple[float, float] | None:
    """Range (metres) that bands are taken from where none is asked for: what all scenes cover, or the part of it from
    400 to 700 nm, which the rendered scenes have, where that is at least half of it; None if all cover 400 to 700 nm.

    Args:
        scenes: name → wavelengths of the bands, metres.

    Raises:
        DataError: a scene that has nothing in common with another.

    Warns:
        SceneWarning: which range is taken.
    """
    ends = {name: _reach(metres_to_nm(metres)) for name, metres in scenes.items()}
    low, high = metres_to_nm(np.array(VISIBLE))
    if all(first <= low + 1e-3 and last >= high - 1e-3 for first, last in ends.values()):
        return None
    ends = {name: _centres(metres_to_nm(metres)) for name, metres in scenes.items()}
    late, early = max(ends, key=lambda name: ends[name][0]), min(ends, key=lambda name: ends[name][1])
    first, last = ends[late][0], ends[early][1]
    if first >= last:
        found, expected = f"bands from {ends[early][0]:g} to {last:g} nm", f"some beyond the {first:g} nm of {late}"
        raise DataError(early, found, expected, "leave one of the two out")
    inside = max(first, low), min(last, high)
    if inside[1] - inside[0] >= (last - first) / 2:
        first, last = inside
    whom = "all scenes cover" if len(scenes) > 1 else f"{next(iter(scenes))} covers"
    warn(
        f"bands from {first:g} to {last:g} nm, which {whom}; --range FIRST:LAST (range=) takes others", SceneWarning, 3
    )
    return first * 1e-9, last * 1e-9


def bands_within(cube: xr.DataArray, span: tuple[float, float]) -> xr.DataArray:
    """All bands of a cube within a range of wavelengths, metres.

    Raises:
        DataError: the cube has no wavelengths, or none within the range.
    """
    nm, (low, high) = _covering(cube, None), metres_to_nm(np.array(span))
    inside = (nm >= low - 1e-3) & (nm <= high + 1e-3)
    if not inside.any():
        found = f"bands from {nm.min():g} to {nm.max():g} nm"
        raise DataError(cube.attrs.get("source", "cube"), found, f"some within {low:g} to {high:g} nm", _OTHER_RANGE)
    return cube.isel(wavelength=np.flatnonzero(inside))


def nearest_bands(cube: xr.DataArray, wavelengths: Iterable[float]) -> xr.DataArray:
    """The band nearest to each wavelength (metres), in the order given; of two equally near the shorter one.

    Raises:
        SettingError: two wavelengths have the same nearest band, or there are none.
        DataError: the cube has no wavelengths or a wavelength lies outside its bands.
    """
    targets = np.asarray(list(wavelengths), dtype=np.float64)
    if not targets.size:
        raise SettingError("wavelengths", "an empty list", "one wavelength or more")
    index = _nearest(_covering(cube, targets), targets)
    if _repeats(index):
        found = f"{targets.size} wavelengths for which only {np.unique(index).size} different bands are nearest"
        remedy = "ask for fewer bands or a wider range"
        raise SettingError(cube.attrs.get("source", "bands"), found, "a band of its own for each", remedy)
    return cube.isel(wavelength=index)


def _covering(cube: xr.DataArray, targets: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Nanometres of the bands, which must cover the targets, if there are any: half a band beyond the outermost
    centres, 10 nm of one."""
    where = cube.attrs.get("source", "cube")
    if "wavelength" not in cube.coords or cube.coords["wavelength"].dims != ("wavelength",):
        raise DataError(where, "no wavelength coordinate", "a cube from tmca.data.read")
    nm = metres_to_nm(cube.coords["wavelength"].values)
    if targets is None:
        return nm
    wanted = metres_to_nm(targets)
    low, high = _reach(nm)
    if wanted.min() < low - 1e-3 or wanted.max() > high + 1e-3:
        found, expected = f"bands from {nm.min():g} to {nm.max():g} nm", "bands that cover"
        expected = f"{expected} {wanted.min():g} to {wanted.max():g} nm"
        raise DataError(where, found, expected, _OTHER_RANGE)
    return nm


def _reach(nm: NDArray[np.float64]) -> tuple[float, float]:
    """The wavelengths that bands cover: half a band beyond the outermost centres, 10 nm of one."""
    rising = np.sort(nm)
    beyond = np.diff(rising)[[0, -1]] / 2 if nm.size > 1 else (10.0, 10.0)
    return float(rising[0] - beyond[0]), float(rising[-1] + beyond[1])


def _centres(nm: NDArray[np.float64]) -> tuple[float, float]:
    """The outermost centres of bands; of one band what it covers."""
    return (float(nm.min()), float(nm.max())) if nm.size > 1 else _reach(nm)


def at_bands(cube: xr.DataArray, wavelengths: Sequence[float]) -> xr.DataArray:
    """The cube's nearest band for every wavelength (metres), labelled with that wavelength.

    Raises:
        DataError, SettingError: as `nearest_bands`.
    """
    stored = cube["wavelength"].values
    if len(stored) == len(wavelengths) and np.allclose(stored, wavelengths, rtol=1e-6):
        return cube
    named = ("wavelength", np.asarray(wavelengths), {"units": "m"})
    return nearest_bands(cube, wavelengths).assign_coords(wavelength=named)


def fitted_depth(
    depth: xr.DataArray, near: float, far: float, *, percentiles: tuple[float, float] = (0.0, 100.0)
) -> tuple[xr.DataArray, dict[str, Any]]:
    """Map a scene's inverse depth affinely onto a design range: ``1/Z' = scale / Z + shift``.

    A room of metres then fits a camera designed for a table top, with its edges and slopes; what the map was is told
    in attributes, for tables. A scene of one depth keeps its scale and comes to the middle of the range.

    Args:
        depth: ``(y, x)`` metres, NaN where unknown, as from `label_depth`.
        near, far: the range in metres; the nearest known pixel is mapped to ``near``, the farthest to ``far``.
        percentiles: of inverse depth, (farthest, nearest), that are mapped there instead of the extremes. What lies
            beyond stays beyond (nothing is clamped) and is counted; beyond infinity it is unknown.

    Returns:
        The mapped depth, and the attributes that it has too: ``inverse_depth_scale``, ``inverse_depth_shift`` (1/m),
        ``design_near`` and ``design_far`` (m), ``fitted_percentiles``, ``source_near`` and ``source_far`` (m, the
        depths that were mapped there), ``unknown_pixels``, ``outside_pixels`` (known, but outside the range).

    Raises:
        SettingError: an impossible range or percentiles.
        DataError: no known depth.
    """
    check_depth_range(near, far)
    low, high = percentiles
    if not 0 <= low < high <= 100:
        raise SettingError("percentiles", repr(percentiles), "(farthest, nearest) with 0 ≤ farthest < nearest ≤ 100")
    values = depth.values.astype(np.float64)
    valid = np.isfinite(values) & (values > 0)
    if not valid.any():
        raise DataError(depth.attrs.get("source", "depth"), "no valid depth", "some positive, finite metres")
    inverse = 1 / np.where(valid, values, 1.0)
    ends = np.percentile(inverse[valid], [low, high])
    scale, shift = _affine(ends, near, far)
    mapped = scale * inverse + shift
    usable = valid & (mapped > 0)
    fitted = np.where(usable, 1 / np.where(usable, mapped, 1.0), np.nan)
    about = {
        "inverse_depth_scale": scale, "inverse_depth_shift": shift,
        "design_near": float(near), "design_far": float(far), "fitted_percentiles": [float(low), float(high)],
        "source_near": float(1 / ends[1]), "source_far": float(1 / ends[0]),
        "unknown_pixels": int(np.sum(~usable)), "outside_pixels": _outside(mapped[valid], near, far),
    }  # fmt: skip
    return depth.copy(data=fitted.astype(np.float32)).assign_attrs(about), about


_FARTHEST = 1e-9
"""Inverse depth, 1/m, below which a point counts as infinitely far."""


def mapping_of(attrs: Mapping[Any, Any]) -> tuple[float, float] | None:
    """Scale and shift of inverse depth that attributes tell, see `FITTED`; None where depth was not mapped."""
    given = [attrs.get(name) for name in FITTED]
    numbers = [float(one) for one in given if isinstance(one, int | float | np.number) and np.isfinite(one)]
    return (numbers[0], numbers[1]) if len(numbers) == len(FITTED) and numbers[0] > 0 else None


def unmapped_depth(depth: NDArray[Any], attrs: Mapping[Any, Any]) -> NDArray[np.float64]:
    """Depth in the metres of the scene, of one that was mapped as its attributes tell; infinite beyond infinity."""
    metres, mapping = np.asarray(depth, np.float64), mapping_of(attrs)
    if mapping is None:
        return metres
    with np.errstate(divide="ignore"):
        inverse = (1 / metres - mapping[1]) / mapping[0]
    seen = inverse > _FARTHEST
    return np.where(seen, 1 / np.where(seen, inverse, 1.0), np.where(np.isfinite(metres), np.inf, np.nan))


def said_mapped(attrs: Mapping[Any, Any], near: float, far: float) -> str:
    """Which depths of a scene lie in the camera's range, ``depths of 2.1 to 5 m mapped onto 0.4 to 2 m``; nothing
    where none was mapped."""
    if mapping_of(attrs) is None:
        return ""
    first, last = unmapped_depth(np.array([near, far]), attrs)
    return f"depths of {first:.3g} to {last:.3g} m mapped onto {near:.4g} to {far:.4g} m"


def _outside(inverse: NDArray[np.float64], near: float, far: float) -> int:
    """How many inverse depths are beyond a range by more than rounding."""
    tolerance = 1e-6 * (1 / near - 1 / far)
    return int(np.sum((inverse < 1 / far - tolerance) | (inverse > 1 / near + tolerance)))


def _affine(ends: NDArray[np.float64], near: float, far: float) -> tuple[float, float]:
    """Scale and shift that bring two inverse depths to the ends of a range; one depth to its middle."""
    if ends[1] - ends[0] <= 1e-9 * ends[1]:
        return 1.0, float((1 / near + 1 / far) / 2 - ends.mean())
    scale = (1 / near - 1 / far) / (ends[1] - ends[0])
    return float(scale), float(1 / far - scale * ends[0])


def check_depth_range(near: float, far: float) -> None:
    """Raises SettingError unless both are finite depths in front of the camera, ``near`` before ``far``."""
    if not (np.isfinite(near) and np.isfinite(far) and 0 < near < far):
        raise SettingError("near, far", f"{near:g} m, {far:g} m", "0 < near < far, both finite")
