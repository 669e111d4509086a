"""Priors from labelled cubes, and back from their files."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from tmca.errors import DataError
from tmca.priors.files import prior_kind
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.mixture import GaussianMixturePrior

if TYPE_CHECKING:
    import xarray as xr

# Rows of a block, and columns beyond twice the dispersion.
ROWS, MIXTURE_ROWS, JUDGED = 12, 8, 14


def learn_prior(
    cubes: Sequence[xr.DataArray], *, spread: int, mixture: bool = False, block: tuple[int, int] | None = None
) -> GaussianPrior | GaussianMixturePrior:
    """The prior of labelled cubes (wavelength, y, x), for a camera of a given dispersion.

    Args:
        spread: columns from the first band to the last on the sensor.
        mixture: learn a Gaussian mixture rather than one Gaussian.
        block: rows and columns of a block; None takes 12 (mixture 8) rows, and columns enough for 14 that are seen
            whole in every band, as far as the cubes allow.

    Raises:
        DataError: cubes on different wavelengths.
        ShapeError: no cube, or a block larger than a cube.
    """
    lengths = [cube["wavelength"].values for cube in cubes]
    for cube, own in zip(cubes, lengths, strict=True):
        if own.shape != lengths[0].shape or not np.allclose(own, lengths[0], atol=1e-12, rtol=0):
            raise DataError(_name(cube), "other wavelengths than the first cube's", "the same bands for all")
    if block is None and cubes:
        height, width = (min(cube.sizes[axis] for cube in cubes) for axis in ("y", "x"))
        block = (min(MIXTURE_ROWS if mixture else ROWS, height), min(2 * spread + JUDGED, width))
    arrays = [torch.from_numpy(np.ascontiguousarray(cube.values, dtype=np.float64)) for cube in cubes]
    names = [f"{_name(c)} sha256 {sha256(c.values.tobytes()).hexdigest()}" for c in cubes]
    kind = GaussianMixturePrior if mixture else GaussianPrior
    metres = lengths[0].tolist() if cubes else None
    return kind.learn(arrays, block or (1, 1), wavelengths=metres, sources=names)


def load_prior(path: str | Path) -> GaussianPrior | GaussianMixturePrior:
    """The prior in a file, of either kind.

    Raises:
        DataError: no such file, no prior in it, or damaged content.
    """
    return GaussianMixturePrior.load(path) if prior_kind(path) == "gaussian mixture" else GaussianPrior.load(path)


def _name(cube: xr.DataArray) -> str:
    return str(cube.attrs.get("source", cube.name or "cube"))
