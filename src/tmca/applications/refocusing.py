"""Photographs from light fields, focused after the exposure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np

from tmca.applications.base import application_of
from tmca.applications.moving import refuse_frames
from tmca.data import describe, load_light_field
from tmca.data.in_memory import SceneWarning
from tmca.data.light_fields import VIEW_DIMS, find_light_field, load_views, open_light_field, read_light_field
from tmca.decoders import Estimate
from tmca.decoders.view_maps import view_maps
from tmca.errors import DataError, SettingError
from tmca.metrics import disparity_range
from tmca.metrics import refocus as refocused
from tmca.metrics.refocusing import has_parallax

if TYPE_CHECKING:
    import xarray as xr
    from torch import Tensor

    LightField = Estimate | xr.DataArray | xr.Dataset | np.ndarray | Tensor | str | Path
else:
    LightField = Any

UNIT = "px per view step"
_FAR = 4
"""The part of a picture, 1/4, by which views of a scene move at most."""
_VIEWS, _SIDE = 5, 160
"""Views, and pixels along the shorter side, that a range of disparities is read from."""


def refocus(light_field: LightField, disparity: float | Sequence[float], **reading: Any) -> xr.DataArray:
    """The photograph that is focused on a disparity, or one for each of several.

    Args:
        light_field: an estimate, its file, what `tmca.read` gives of a light field, an array of (V, U, H, W) or with
            three colours first, or a file, a folder, or the name of a rendered light field, in their colours.
        disparity: of what shall be sharp, px per view step, positive = nearer than the plane in focus.
        reading: how files are read: ``views``, ``crop``, ``pattern`` and ``lens`` of `tmca.data.read_light_field`.

    Returns:
        (y, x), or (colour, y, x); of several (disparity, …). Relative irradiance.

    Raises:
        DataError: no light field, or a file that cannot be read.
        SettingError: a disparity that is not finite.

    Warns:
        SceneWarning: a disparity that moves views by more than a quarter of the picture: nothing is sharp there.

    >>> import numpy as np, tmca
    >>> tmca.refocus(np.ones((3, 3, 8, 8)), [0.0, 0.5]).dims
    ('disparity', 'y', 'x')
    """
    import xarray as xr

    views = light_field_of(light_field, **reading)
    steps: list[Any] = [disparity] if np.ndim(disparity) == 0 else list(disparity)  # type: ignore[arg-type]
    if not steps or not all(isinstance(step, int | float | np.number) and np.isfinite(step) for step in steps):
        raise SettingError("disparity", repr(disparity), f"numbers in {UNIT}, such as -1,0,1")
    _warn_of_far(views, steps)
    dims = [str(dim) for dim in views.dims if dim not in VIEW_DIMS[:2]]
    coords = {name: views.coords[name] for name in dims if name in views.coords}
    about = {"long_name": "photograph refocused from the views", "units": "1"}
    made = [xr.DataArray(refocused(views.values, float(s)), coords, dims, attrs=about) for s in steps]
    focus = {"units": UNIT, "long_name": "disparity in focus"}
    if np.ndim(disparity) == 0:
        return made[0].assign_coords(disparity=((), float(steps[0]), focus)).rename("refocused")
    where = xr.DataArray(np.asarray(steps, np.float64), dims="disparity", attrs=focus)
    stack: xr.DataArray = xr.concat(made, "disparity").assign_coords(disparity=where).rename("refocused")
    return stack


def _warn_of_far(views: xr.DataArray, steps: list[Any]) -> None:
    """Warn of disparities that no scene has."""
    furthest = max((views.sizes["view_v"] - 1) / 2, (views.sizes["view_u"] - 1) / 2)
    side = min(views.sizes["y"], views.sizes["x"])
    far = [step for step in steps if abs(step) * furthest > side / _FAR]
    if far:
        moved = f"{abs(far[0]) * furthest:g} of {side} pixels"
        hint = "nothing is sharp there; tmca inspect says which there are"
        text = f"disparity {far[0]:g}: outer views move by {moved}, {hint}"
        warn(text, SceneWarning, 3)


def all_in_focus(light_field: LightField, **reading: Any) -> xr.Dataset:
    """The photograph with everything in focus, with the disparity that it was made with.

    Args:
        light_field, reading: as of `refocus`.

    Returns:
        ``all_in_focus``, ``disparity`` and ``confidence``, see `tmca.metrics.Geometry`.

    Raises:
        DataError: no light field, or one without parallax: a single view, or less than 4 × 4 pixels.
    """
    import xarray as xr

    views = light_field_of(light_field, **reading)
    maps = view_maps(views.to_dataset(name="estimate"))
    if not maps:
        found = (
            f"{views.sizes['view_v']} × {views.sizes['view_u']} views of {views.shape[-2]} × {views.shape[-1]} pixels"
        )
        raise DataError(_name(light_field), found, "several views, of 4 × 4 pixels or more")
    return xr.Dataset(maps)


def light_field_of(given: LightField, **reading: Any) -> xr.DataArray:
    """Views (view_v, view_u, y, x), or with colours first, of anything that has them; arguments as of `refocus`."""
    if isinstance(given, str | Path):
        return _read(given, {name: value for name, value in reading.items() if value is not None})
    if isinstance(given, Estimate):
        given = given.to_xarray()
    if hasattr(given, "data_vars"):
        found = [one for one in given.data_vars.values() if set(VIEW_DIMS) <= set(one.dims)]
        if not found:
            raise DataError("light_field", ", ".join(map(str, given.data_vars)) or "nothing", "views by view_v, view_u")
        given = found[0]
    application, anything = application_of("light-field"), _Anything()
    views: xr.DataArray = application.scene(given, anything, "light_field")  # type: ignore[assignment]
    return views


class _Anything:
    """In the place of a camera: a light field may have any views."""

    unbound = ("views",)


def _read(source: str | Path, reading: dict[str, Any]) -> xr.DataArray:
    """Views of a file or a rendered light field, in their colours; of an even grid the centre ones."""
    if not Path(source).exists():
        return load_light_field(source, colour=True, size=reading.pop("crop", None), **reading)
    about = describe(source, **{name: reading[name] for name in ("pattern", "lens") if name in reading})
    if about["kind"] != "light field":
        taken = "snapshot" in about.get("variables", ())
        refuse_frames(source, about["variables"].get("estimate", {}).get("dims", ()))
        found, remedy = f"no light field ({about['kind']})", "give the folder of the views; tmca inspect says more"
        if taken:
            found, remedy = "a snapshot", f"run tmca reconstruct {source} first"
        raise DataError(source, found, "a light field, or an estimate of one", remedy)
    facts = about["light_field"]
    most = min(facts["views"])
    square = facts["views"][0] == facts["views"][1] and most % 2
    views = reading.pop("views", None if square else most - (most % 2 == 0))
    crop = reading.pop("crop", None)
    with open_light_field(source, **reading) as contents:
        stored = find_light_field(contents)
        assert stored is not None  # as it was described
        estimated = "decoder" in contents.attrs  # whose values are relative irradiance already
        divide_by = 1.0 if estimated else None
        return load_views(contents, stored, views=views, crop=crop, colour=facts["colour"], divide_by=divide_by)


def disparity_seen(path: str | Path, facts: Mapping[str, Any], **reading: Any) -> tuple[float, float] | None:
    """The range of disparities that the views of a file show (5 to 95 %), px per view step; None without texture.

    Args:
        path: of a light field.
        facts: ``light_field`` of what `tmca.data.describe` says of it.
        reading: ``pattern`` and ``lens`` that it was described with.
    """
    most = min(_VIEWS, *facts["views"])
    views, scale = most - (most % 2 == 0), max(1, round(min(facts["size"]) / _SIDE))
    small = read_light_field(path, views=views, scale=scale, **reading).values
    seen = disparity_range(small) if has_parallax(small) else None
    return None if seen is None else (scale * seen[0], scale * seen[1])


def _name(given: Any) -> str:
    return str(given) if isinstance(given, str | Path) else "light_field"
