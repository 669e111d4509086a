"""Priors for light-field cameras: learned from labelled light fields, or the rendered ones' own."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, SettingError, ShapeError
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.learning import Told, cache_folder
from tmca.priors.mixture import GaussianMixturePrior

if TYPE_CHECKING:
    import xarray as xr

_ENTRIES = 2600
_MOST = 11
_RENDERED_SIZE, _RENDERED_SEEDS = (128, 160), (0, 1)
_MIXTURE: dict[str, Any] = {"kinds": 8, "rank": 150, "gains": 4, "samples": 16_000}
_KEPT = 1
"""Raised when the rendering changes: priors kept by earlier versions are then learned anew."""


def light_field_block(views: tuple[int, int]) -> tuple[int, int]:
    """(rows, columns) of square blocks for so many views: 9×9 for 5×5 views, 5×5 for 9×9, 11×11 at most."""
    side = min(_MOST, max(3, int((_ENTRIES / (views[0] * views[1])) ** 0.5)))
    return side - 1 + side % 2, side - 1 + side % 2


def views_of(light_field: xr.DataArray) -> list[Tensor]:
    """A labelled light field as tensors (V, U, H, W), one for each colour."""
    values = torch.from_numpy(np.ascontiguousarray(light_field.values, dtype=np.float32))
    return list(values) if values.ndim == 5 else [values]


def learn_light_field_prior(
    light_fields: Sequence[xr.DataArray], *, block: tuple[int, int] | None = None
) -> GaussianPrior:
    """Learn a prior from example light fields; colours count as light fields of their own.

    Args:
        light_fields: (view_v, view_u, y, x), or with colours first, relative irradiance, all of the same views.
        block: (rows, columns); ``light_field_block`` of the views without.

    Raises:
        SettingError: no light fields.
        DataError: light fields of different views.
    """
    cubes, own, grid = _examples(light_fields, block)
    return GaussianPrior.learn(cubes, own, views=grid, sources=[_identity(field) for field in light_fields])


def learn_light_field_mixture(
    light_fields: Sequence[xr.DataArray], *, block: tuple[int, int] | None = None, seed: int = 0
) -> GaussianMixturePrior:
    """Learn a Gaussian mixture from example light fields: smooth and textured blocks are of different kinds.

    Arguments and errors as in ``learn_light_field_prior``; ``seed`` draws the blocks.
    """
    cubes, own, grid = _examples(light_fields, block)
    names = [_identity(field) for field in light_fields]
    return GaussianMixturePrior.learn(cubes, own, views=grid, sources=names, seed=seed, **_MIXTURE)


def _examples(
    light_fields: Sequence[xr.DataArray], block: tuple[int, int] | None
) -> tuple[list[Tensor], tuple[int, int], tuple[int, int]]:
    """Cubes (V·U, H, W), block and (V, U) of light fields, checked against each other."""
    if not light_fields:
        raise SettingError("prior", "no example light fields", "at least one")
    examples = [views for field in light_fields for views in views_of(field)]
    grid = (examples[0].shape[0], examples[0].shape[1])
    for field in light_fields:
        own = (field.sizes["view_v"], field.sizes["view_u"])
        if own != grid:
            name = str(field.attrs.get("name", "example"))
            raise DataError(name, f"{own[0]}×{own[1]} views", f"{grid[0]}×{grid[1]} as in the first example")
    return [views.flatten(0, 1) for views in examples], block or light_field_block(grid), grid


def check_views(prior: GaussianPrior | GaussianMixturePrior, views: tuple[int, int]) -> None:
    """Raises ShapeError unless a prior has as many channels as there are views."""
    if prior.block[0] != views[0] * views[1]:
        raise ShapeError(
            "prior", f"{prior.block[0]} views", f"the camera's {views[0]}×{views[1]}", "learn one for them"
        )


def rendered_light_field_prior(views: int, *, progress: Told | None = None) -> GaussianPrior:
    """The prior of the rendered training light fields of n×n views, learned on first use and kept.

    It is kept in the folder ``TMCA_CACHE``, or ``tmca`` in the user's cache folder.

    Args:
        views: n.
        progress: told what is done, where it has to be learned.
    """
    from tmca import __version__
    from tmca.data import make_folder, rendered_light_field, split_rendered_light_fields

    names = sorted(split_rendered_light_fields()["train"])
    identity = [_KEPT, __version__, views, names, _RENDERED_SIZE, _RENDERED_SEEDS]
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:16]
    file = cache_folder() / f"rendered-light-field-{digest}.nc"
    if file.exists():
        try:
            return GaussianPrior.load(file)
        except DataError:
            pass  # a damaged file of ours: learned anew below, and replaced
    fields, told = [], progress or (lambda share, step: None)
    scenes = [(name, seed) for name in names for seed in _RENDERED_SEEDS]
    for index, (name, seed) in enumerate(scenes):
        told(0.9 * index / len(scenes), f"first use: rendering {name} for the prior, which is then kept")
        fields.append(rendered_light_field(name, views=views, size=_RENDERED_SIZE, seed=seed)["light_field"])
    prior = learn_light_field_prior(fields)
    make_folder(file.parent)
    prior.save(file, overwrite=True)
    return prior


def _identity(field: xr.DataArray) -> str:
    name = field.attrs.get("name", field.attrs.get("source", "light field"))
    return f"{name} sha256 {hashlib.sha256(np.ascontiguousarray(field.values).tobytes()).hexdigest()}"
