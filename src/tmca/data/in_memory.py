"""Scenes that are handed over in memory: of which kind they are, whether they are light, labelled and as tensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np

from tmca.arguments import described
from tmca.data.formats.stored import Stored
from tmca.data.formats.wavelengths import from_file, spectral_axis
from tmca.errors import DataError, check_shape

if TYPE_CHECKING:
    import xarray as xr
    from torch import Tensor

_VIEWS = ("view_v", "view_u", "y", "x")
_CUBE = ("wavelength", "y", "x")
_FAR, _FAR_SHARE = 0.5, 0.01
"""Beyond black or white by which an estimate is far from any scene, and the share of its values that may be."""


class SceneWarning(UserWarning):
    """What is odd about a scene, said when it is read, simulated or estimated."""


def as_cube(scene: Any, where: str = "scene") -> xr.DataArray:
    """A cube (wavelength, y, x) with its wavelengths; of a dataset ``radiance``, or what it holds alone.

    Raises:
        DataError: no cube.
    """
    held = getattr(scene, "data_vars", None)
    if held is not None:
        scene = scene["radiance"] if "radiance" in held else next(iter(held.values())) if len(held) == 1 else scene
    if {*getattr(scene, "dims", ())} != {*_CUBE}:
        raise DataError(where, _found(scene), "a spectral scene (wavelength, y, x)", "read it with tmca.read")
    remedy = 'assign_coords(wavelength=("wavelength", metres))'
    if "wavelength" not in scene.coords:
        raise DataError(where, "no wavelength coordinate", "the wavelength of every band in metres", remedy)
    cube: xr.DataArray = scene.transpose(*_CUBE)
    given = cube["wavelength"]
    metres = from_file(given.values, given.attrs.get("units"))
    if metres is None:
        raise DataError(where, "a wavelength coordinate of other numbers", "metres or nanometres", remedy)
    if np.allclose(metres, given.values, rtol=1e-6, atol=0):
        return cube
    return cube.assign_coords(wavelength=("wavelength", metres, {"units": "m", "long_name": "wavelength"}))


def as_views(scene: Any, where: str = "scene") -> xr.DataArray:
    """A light field (view_v, view_u, y, x), its colours first where there are some; of a dataset what it holds alone.

    Raises:
        DataError: no light field.
    """
    held = getattr(scene, "data_vars", None)
    scene = next(iter(held.values())) if held is not None and len(held) == 1 else scene
    if {*getattr(scene, "dims", ())} - {"colour"} != {*_VIEWS}:
        raise DataError(where, _found(scene), "a light field (view_v, view_u, y, x)", _read_as("light-field"))
    views: xr.DataArray = scene.transpose(..., *_VIEWS)
    return views


def as_depth_scene(scene: Any, where: str = "scene") -> xr.Dataset:
    """A dataset of ``radiance`` (wavelength, y, x) and ``depth`` (y, x).

    Raises:
        DataError: no scene with depth.
    """
    if not {"radiance", "depth"} <= set(getattr(scene, "data_vars", ())):
        raise DataError(where, _found(scene), "a dataset of radiance and depth", _read_as("spectral-depth"))
    cube = as_cube(scene["radiance"], where)
    in_metres = scene.assign_coords(wavelength=cube["wavelength"])
    return in_metres.assign(radiance=cube, depth=scene["depth"].transpose("y", "x"))


def as_tensors(scene: Any, where: str = "scene") -> tuple[Tensor, ...]:
    """A scene of any form as a camera takes it: its values, and its depth where it has one.

    Args:
        scene: labelled (xarray), of which axes are in order, a NumPy array, a tensor, or what NumPy makes an array of.
        where: for errors.

    Returns:
        Values as they are shaped, a labelled scene with a batch in front: one, or the colours of a light field; depth
        (1, 1, H, W) metres. What is no tensor becomes single precision.

    Raises:
        DataError: no numbers.
    """
    import torch

    if isinstance(scene, torch.Tensor):
        return (scene,)
    held = getattr(scene, "data_vars", None)
    if held is not None and {"radiance", "depth"} <= set(held):
        return *as_tensors(scene["radiance"], where), *(part[None] for part in as_tensors(scene["depth"], where))
    labelled = scene if held is None else next(iter(held.values()))
    values = np.asarray(labelled)
    if values.dtype.kind not in "buif":
        raise DataError(where, f"{described(scene)} of {values.dtype} values", "numbers", "read it with tmca.read")
    tensor = torch.from_numpy(np.array(values, dtype=np.float32))
    alone = hasattr(labelled, "dims") and "colour" not in labelled.dims
    return (tensor[None] if alone else tensor,)


def bare_cube(scene: Any) -> np.ndarray | None:
    """Values (L, H, W) of a labelled cube that has no wavelengths; None of anything else."""
    if {*getattr(scene, "dims", ())} != {*_CUBE} or hasattr(scene, "data_vars") or "wavelength" in scene.coords:
        return None
    return np.asarray(scene.transpose(*_CUBE))


def bands_first(values: Any, where: str = "scene") -> Any:
    """An array with its bands in front, where by the rule of files they can only be its last axis; others as they are.

    Args:
        values: NumPy array or tensor; what has not three axes is returned as it is.
        where: for the warning.

    Warns:
        SceneWarning: that they were last.
    """
    shape = tuple(getattr(values, "shape", ()))
    if len(shape) != 3 or spectral_axis(Stored(where, shape, np.dtype("f4"), lambda index: values, usual_axis=0)) != 2:
        return values
    said = f"{where}: an array of {'×'.join(map(str, shape))}, taken as (rows, columns, bands)"
    other = 'if its first axis is bands, xr.DataArray(array, dims=("wavelength", "y", "x")) says so'
    warn(f"{said}; {other}", SceneWarning, stacklevel=1)
    return values.movedim(2, 0) if hasattr(values, "movedim") else np.moveaxis(values, 2, 0)


def even_bands(count: int, where: str = "scene") -> np.ndarray:
    """Wavelengths that are assumed where none are given: evenly spaced, 400 to 700 nm; of one band 550 nm.

    Warns:
        SceneWarning: says so.
    """
    bands = f"{count} bands without wavelengths, taken as evenly spaced from 400 to 700 nm"
    text = f"{where}: {bands if count > 1 else '1 band without a wavelength, taken as 550 nm'}"
    # warned of from one line, so that Python says it once
    warn(f"{text}; an xarray coordinate wavelength says others", SceneWarning, stacklevel=1)
    return np.linspace(400e-9, 700e-9, count) if count > 1 else np.array([550e-9])


def of_shape(values: np.ndarray, shape: Sequence[Any], where: str) -> np.ndarray:
    """An array of a scene, without its batch of one.

    Raises:
        ShapeError: another shape.
    """
    one = values[0] if values.ndim == len(shape) + 1 and len(values) == 1 else values
    check_shape(where, one, tuple(shape), "simulate scenes one by one; camera(scenes) takes tensors of many")
    return one


def check_light(light: xr.DataArray, where: str, least: float = 0.0) -> None:
    """Raise DataError unless values are relative irradiance: finite numbers, none below ``least``.

    Warns:
        SceneWarning: values above 1, which is white.
    """
    values = np.asarray(light.values)
    if values.dtype.kind not in "buif":
        raise DataError(where, f"{values.dtype} values", "relative irradiance, 1 = white")
    low, high = float(values.min()), float(values.max())
    if values.dtype.kind in "ui" and high > 1:
        remedy = "divide them by the largest that they can be, or read them from their file"
        raise DataError(where, f"{values.dtype} values up to {high:g}", "relative irradiance, 1 = white", remedy)
    if not np.isfinite(values).all():
        count = int(np.count_nonzero(~np.isfinite(values)))
        raise DataError(where, f"{count} NaN or infinite values", "finite ones", "mask or repair them first")
    if low < least:
        raise DataError(where, f"values down to {low:g}", "relative irradiance, 0 or more", "set them to 0")
    if least == 0 and high > 1:
        warn(f"{where}: values up to {high:.3g}, of which 1 is white", SceneWarning, stacklevel=4)


def warn_of_estimate(values: np.ndarray, where: str, stacklevel: int = 3) -> None:
    """Warn of an estimate of relative irradiance that is often far from any.

    Args:
        values: of the estimate, any shape.
        where: its name.
        stacklevel: of the caller that is warned, see `warnings.warn`.

    Warns:
        SceneWarning: more than a hundredth of the values below −0.5 or above 1.5.
    """
    share = float(((values < -_FAR) | (values > 1 + _FAR)).mean())
    if share > _FAR_SHARE:
        found = f"{share:.0%} of the values are below {-_FAR:g} or above {1 + _FAR:g}"
        hint = "does the decoder fit the camera, its noise and its scale?"
        warn(f"{where}: {found}, of which 0 is black and 1 white; {hint}", SceneWarning, stacklevel)


def _found(scene: Any) -> str:
    sizes = getattr(scene, "sizes", None)
    if not sizes:
        return described(scene)
    return f"{'×'.join(map(str, sizes.values()))} ({', '.join(map(str, sizes))})"


def _read_as(kind: str) -> str:
    return f'read it with tmca.read(…, "{kind}")'
