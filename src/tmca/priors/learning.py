"""Priors of any kind for any camera, learned from labelled scenes."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, SettingError
from tmca.priors.dictionary import PATCH
from tmca.priors.prior import Prior
from tmca.priors.spectral_depth import WINDOW, needed_block

if TYPE_CHECKING:
    import xarray as xr

_ROWS, _ENTRIES, _MIXTURE_ROWS, _MIXTURE_ENTRIES = 12, 5184, 8, 3456
_COMPLETE, _FEWEST_ROWS = 14, 2
_VIEW_ENTRIES, _LARGEST_SIDE = 2600, 11
_MIXTURE_OF_VIEWS: dict[str, Any] = {"kinds": 8, "rank": 150, "gains": 4, "samples": 16_000}
"""Light fields have fewer directions worth their time than cubes."""


def learn_prior(
    scenes: Sequence[xr.DataArray | xr.Dataset],
    camera: Any = None,
    kind: str = "gaussian",
    *,
    spread: int = 0,
    block: tuple[int, int] | None = None,
    seed: int = 0,
    **settings: Any,
) -> Prior:
    """Learn a prior from example scenes.

    Args:
        scenes: cubes (wavelength, y, x), all with the same wavelengths, or light fields (view_v, view_u, y, x), or with
            colours first, which count as light fields of their own, all of the same views; relative irradiance, or
            datasets that hold them.
        camera: whose ``block_of`` the prior gets; that of most cameras shrinks to the smallest scene.
        kind: ``"gaussian"``, ``"mixture"`` or, of light fields, ``"dictionary"``.
        spread: columns by which dispersion widens the snapshot, for cubes without a camera.
        block: (rows, columns) instead of the camera's.
        seed: of random blocks.
        settings: further ones of the ``learn`` of that kind.

    Raises:
        SettingError: no scenes, or a kind that there is not.
        DataError: scenes of different wavelengths or views, or smaller than a block that is needed.
    """
    if not scenes:
        raise SettingError("prior", "no example scenes", "at least one")
    examples = [_values(scene) for scene in scenes]
    views = _common_views(examples) if "view_v" in examples[0].dims else None
    if kind not in Prior.kinds or (kind == "dictionary" and views is None):
        raise SettingError("kind", repr(kind), f"{', '.join(Prior.kinds)} (a dictionary: of light fields)")
    if camera is not None and (views is None) == (camera.kind == "light-field"):
        found, wanted = ("light fields", "cubes") if views else ("cubes", "light fields")
        raise SettingError("scenes", found, f"{wanted}, of which the {camera.kind} camera takes snapshots")
    _check_settings(kind, settings, block)
    about: dict[str, Any] = {"wavelengths": _common_wavelengths(examples)} if views is None else {"views": views}
    if block is None and camera is None:
        usual = _usual_block(kind, len(about.get("wavelengths", ())), spread, views)
    else:
        usual = block or block_of(camera, kind)
    if block is not None or (camera is not None and camera.kind == "spectral-depth"):
        _check_sizes(examples, usual)
    about |= {} if kind == "gaussian" else {"seed": seed}
    about |= _MIXTURE_OF_VIEWS if kind == "mixture" and views is not None else {}
    cubes = [cube for example in examples for cube in _cubes(example)]
    sources = [_identity(example) for example in examples]
    return Prior.kinds[kind].learn(cubes, _inside(examples, usual), sources=sources, **{**about, **settings})


def _check_settings(kind: str, settings: dict[str, Any], block: Any) -> None:
    """Raises SettingError for a setting that this kind's ``learn`` does not have, or a block that is no pair."""
    taken = inspect.signature(Prior.kinds[kind].learn).parameters.values()
    names = [one.name for one in taken if one.kind is one.KEYWORD_ONLY]
    for name, value in settings.items():
        if name not in names and not any(one.kind is one.VAR_KEYWORD for one in taken):
            raise SettingError(name, repr(value), f"one of {', '.join(names)}", "leave it out")
    if block is not None and (not isinstance(block, Sequence) or len(block) != 2):
        raise SettingError("block", repr(block), "(rows, columns)")


def block_of(camera: Any, kind: str = "gaussian", window: int | None = None) -> tuple[int, int]:
    """(rows, columns) of the blocks of a camera's prior.

    Args:
        camera: spectral, light-field or spectral-depth.
        kind: of the prior.
        window: side of the windows that depth is decoded from; the usual one, or a tile of the codes, if None. Smaller
            windows share the blocks of usual ones.

    Raises:
        SettingError: no window is given for a spectral-depth camera whose shutter patterns do not repeat.
    """
    if camera.kind == "spectral-depth":
        side = camera.tile_size if window is None else window
        return needed_block(max(WINDOW, side), camera.bench.window)
    if camera.kind == "light-field":
        return _usual_block(kind, views=camera.views)
    return _usual_block(kind, len(camera.wavelengths), camera.dispersion.spread)


def views_of(light_field: xr.DataArray) -> list[Tensor]:
    """A labelled light field as tensors (V, U, H, W), one for each colour."""
    values = torch.from_numpy(np.ascontiguousarray(light_field.values, dtype=np.float32))
    return list(values) if values.ndim == 5 else [values]


def _usual_block(kind: str, bands: int = 0, spread: int = 0, views: tuple[int, int] | None = None) -> tuple[int, int]:
    """(rows, columns) of blocks of cubes or views.

    Blocks of cubes are wide enough that some columns see all their light from inside. For 12 bands at one pixel per
    band they are 12×36 (Gaussian) and 8×36 (mixture). On training scenes left out one by one, 16×36 gives 0.1 dB more
    for twice the matrix, 6×36 0.5 dB less (``benchmarks/defaults.py``); other cameras get as many rows, two at least,
    as keep the covariance about that large. Blocks of views are square and of odd sides: 9×9 for 5×5 views, 5×5 for
    9×9, 11×11 at most.
    """
    if kind == "dictionary":
        return PATCH
    if views is not None:
        side = min(_LARGEST_SIDE, max(3, int((_VIEW_ENTRIES / (views[0] * views[1])) ** 0.5)))
        return side - 1 + side % 2, side - 1 + side % 2
    columns = max(2 * spread + _COMPLETE, 24)
    rows, entries = (_MIXTURE_ROWS, _MIXTURE_ENTRIES) if kind == "mixture" else (_ROWS, _ENTRIES)
    return max(_FEWEST_ROWS, min(rows, entries // (bands * columns))), columns


def _inside(examples: Sequence[xr.DataArray], block: tuple[int, int]) -> tuple[int, int]:
    """The block, no larger than any scene."""
    rows, columns = (min(example.sizes[axis] for example in examples) for axis in ("y", "x"))
    return min(block[0], rows), min(block[1], columns)


def _check_sizes(examples: Sequence[xr.DataArray], block: tuple[int, int]) -> None:
    """Raises DataError for a scene that is smaller than the block."""
    for example in examples:
        rows, columns = example.sizes["y"], example.sizes["x"]
        if rows < block[0] or columns < block[1]:
            found, wanted = f"{rows}×{columns} pixels", f"at least the {block[0]}×{block[1]} of the prior's blocks"
            raise DataError(_name(example), found, wanted, "leave it out, or choose smaller blocks")


def _cubes(example: xr.DataArray) -> list[Tensor]:
    """(L, H, W) a cube, or the views of every colour of a light field."""
    if "view_v" in example.dims:
        return [views.flatten(0, 1) for views in views_of(example)]
    return [torch.from_numpy(example.values.copy())]


def _values(scene: xr.DataArray | xr.Dataset) -> xr.DataArray:
    """The cube or light field of a scene."""
    import xarray as xr

    if isinstance(scene, xr.DataArray):
        return scene
    return scene["light_field" if "light_field" in scene else "radiance"]


def _common_views(examples: Sequence[xr.DataArray]) -> tuple[int, int]:
    """(V, U) of light fields that share it."""
    grids = [(example.sizes["view_v"], example.sizes["view_u"]) for example in examples]
    for example, (v, u) in zip(examples, grids, strict=True):
        if (v, u) != grids[0]:
            raise DataError(_name(example), f"{v}×{u} views", f"{grids[0][0]}×{grids[0][1]} as in the first example")
    return grids[0]


def _common_wavelengths(examples: Sequence[xr.DataArray]) -> list[float]:
    """Those of cubes that share them, metres."""
    wavelengths = examples[0]["wavelength"].values
    for example in examples:
        other = example["wavelength"].values
        if other.shape != wavelengths.shape or abs(other - wavelengths).max() > 1e-10:
            wanted = "those of the first example"
            raise DataError(_name(example), "other wavelengths", wanted, "select the same bands of all")
    lengths: list[float] = wavelengths.tolist()
    return lengths


def _name(example: xr.DataArray) -> str:
    return str(example.attrs.get("name", example.attrs.get("source", "example")))


def _identity(example: xr.DataArray) -> str:
    return f"{_name(example)} sha256 {hashlib.sha256(example.values.tobytes()).hexdigest()}"
