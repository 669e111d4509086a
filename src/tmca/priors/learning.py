"""Labelled example scenes as what priors are learned from: checked against each other, in tensors."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, SettingError, ShapeError

if TYPE_CHECKING:
    import xarray as xr

PATCH = (11, 11)
"""Rows and columns of a dictionary's patches where none are given."""
_SCENES = ("light_field", "radiance")
"""Variables of datasets that hold a scene."""
_VIEW_AXES = ("view_v", "view_u", "y", "x")
_AXES = (("wavelength", "y", "x"), _VIEW_AXES, ("colour", *_VIEW_AXES))


def values_of(scene: xr.DataArray | xr.Dataset) -> xr.DataArray:
    """The cube (wavelength, y, x) or light field ([colour,] view_v, view_u, y, x) of a scene.

    Raises:
        SettingError: what is no labelled array.
        ShapeError: one with other axes.
        DataError: a dataset without a scene, or values that are no numbers.
    """
    import xarray as xr

    if isinstance(scene, xr.Dataset):
        name = next((name for name in _SCENES if name in scene), None)
        if name is None:
            found = f"a dataset of {', '.join(map(str, scene.data_vars)) or 'nothing'}"
            raise DataError("scenes", found, f"one with {' or '.join(_SCENES)}")
        scene = scene[name]
    if not isinstance(scene, xr.DataArray):
        wanted, remedy = "labelled cubes or light fields", "read them with tmca.read"
        raise SettingError("scenes", f"a {type(scene).__name__}", wanted, remedy)
    axes = next((axes for axes in _AXES if set(axes) == set(scene.dims)), None)
    if axes is None or (axes[0] == "wavelength" and "wavelength" not in scene.coords):
        found, lengths = f"axes ({', '.join(map(str, scene.dims))})", "wavelength (with its metres), y and x"
        raise ShapeError(_name(scene), found, f"{lengths}, or view_v, view_u, y and x, with colour or not")
    if scene.dtype.kind not in "fiu":
        raise DataError(_name(scene), f"values of type {scene.dtype}", "real numbers")
    return scene.transpose(*axes)


def views_of(light_field: xr.DataArray) -> list[Tensor]:
    """A labelled light field as tensors (V, U, H, W), one for each colour."""
    values = torch.from_numpy(np.ascontiguousarray(light_field.values, dtype=np.float32))
    return list(values) if values.ndim == 5 else [values]


def cubes_of(example: xr.DataArray) -> list[Tensor]:
    """(L, H, W) a cube, or the views of every colour of a light field."""
    if "view_v" in example.dims:
        return [views.flatten(0, 1) for views in views_of(example)]
    return [torch.from_numpy(example.values.copy())]


def common_channels(examples: Sequence[xr.DataArray]) -> dict[str, Any]:
    """``views`` (V, U) of light fields, ``wavelengths`` in metres of cubes.

    Raises:
        DataError: examples that do not share them.
    """
    if "view_v" in examples[0].dims:
        grids = [(example.sizes["view_v"], example.sizes["view_u"]) for example in examples]
        for example, (v, u) in zip(examples, grids, strict=True):
            if (v, u) != grids[0]:
                wanted = f"{grids[0][0]}×{grids[0][1]} as in the first example"
                raise DataError(_name(example), f"{v}×{u} views", wanted)
        return {"views": grids[0]}
    wavelengths = examples[0]["wavelength"].values
    for example in examples:
        other = example["wavelength"].values
        if other.shape != wavelengths.shape or abs(other - wavelengths).max() > 1e-10:
            wanted = "those of the first example"
            raise DataError(_name(example), "other wavelengths", wanted, "select the same bands of all")
    return {"wavelengths": wavelengths.tolist()}


def fitting_block(examples: Sequence[xr.DataArray], block: tuple[int, int], needed: bool) -> tuple[int, int]:
    """The block (rows, columns), no larger than any scene.

    Raises:
        DataError: a scene that is smaller than a block that is ``needed`` whole.
    """
    for example in examples:
        rows, columns = example.sizes["y"], example.sizes["x"]
        if needed and (rows < block[0] or columns < block[1]):
            found, wanted = f"{rows}×{columns} pixels", f"at least the {block[0]}×{block[1]} of the prior's blocks"
            raise DataError(_name(example), found, wanted, "leave it out, or choose smaller blocks")
        block = min(block[0], rows), min(block[1], columns)
    return block


def source_of(example: xr.DataArray) -> str:
    """Name and checksum."""
    return f"{_name(example)} sha256 {hashlib.sha256(example.values.tobytes()).hexdigest()}"


def _name(example: xr.DataArray) -> str:
    return str(example.attrs.get("name", example.attrs.get("source", "example")))
