"""Priors for a camera: learned from labelled cubes, loaded from a file, or the rendered scenes' own."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from tmca.errors import DataError, SettingError
from tmca.priors.files import kind_of
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.mixture import GaussianMixturePrior

if TYPE_CHECKING:
    import xarray as xr

Prior = GaussianPrior | GaussianMixturePrior
Told = Callable[[float, str], None]
"""Takes the share that is done, and what is done next."""

_ENTRIES = {False: 5184, True: 3456}
_ROWS = {False: 12, True: 8}
_JUDGED, _FEWEST_ROWS = 14, 2
_RENDERED_SIZE, _RENDERED_RANGE = (256, 256), (400e-9, 700e-9)
_KEPT = 1
"""Raised when the rendering changes: priors kept by earlier versions are then learned anew."""


def block_for(bands: int, spread: int, *, mixture: bool = False) -> tuple[int, int]:
    """(rows, columns) of the blocks for a camera: wide enough that some columns see all their light from inside.

    For 12 bands at one pixel per band it is 12×36 (Gaussian) and 8×36 (mixture). On training scenes left out one by
    one, 16×36 gives 0.1 dB more for twice the matrix, 6×36 0.5 dB less (``benchmarks/defaults.py``); other cameras get
    as many rows, two at least, as keep the covariance about that large.

    Args:
        bands: number of bands L.
        spread: columns by which the snapshot is wider than the scene, pixels.
        mixture: for a mixture prior.
    """
    columns = max(2 * spread + _JUDGED, 24)
    rows = max(_FEWEST_ROWS, min(_ROWS[mixture], _ENTRIES[mixture] // (bands * columns)))
    return rows, columns


def learn_prior(
    cubes: Sequence[xr.DataArray],
    *,
    spread: int,
    mixture: bool = False,
    block: tuple[int, int] | None = None,
    seed: int = 0,
) -> Prior:
    """Learn a prior from example cubes.

    Args:
        cubes: (wavelength, y, x) relative irradiance, all with the same wavelengths.
        spread: columns by which the camera's snapshot is wider than the scene; it sets the block.
        mixture: a Gaussian mixture instead of one Gaussian.
        block: (rows, columns) instead of the camera's.
        seed: of random blocks.

    Raises:
        SettingError: no cubes.
        DataError: cubes of different wavelengths.
    """
    if not cubes:
        raise SettingError("prior", "no example scenes", "at least one")
    wavelengths = cubes[0]["wavelength"].values
    for cube in cubes:
        if cube["wavelength"].shape != wavelengths.shape or abs(cube["wavelength"].values - wavelengths).max() > 1e-10:
            name = str(cube.attrs.get("name", "example"))
            raise DataError(name, "other wavelengths", "those of the first example", "select the same bands of all")
    kind = GaussianMixturePrior if mixture else GaussianPrior
    examples = [torch.from_numpy(cube.values.copy()) for cube in cubes]
    shape = block or block_for(len(wavelengths), spread, mixture=mixture)
    smallest = (min(cube.sizes["y"] for cube in cubes), min(cube.sizes["x"] for cube in cubes))
    shape = (min(shape[0], smallest[0]), min(shape[1], smallest[1])) if block is None else shape
    names = [_identity(cube) for cube in cubes]
    return kind.learn(examples, shape, seed=seed, wavelengths=wavelengths.tolist(), sources=names)


def _identity(cube: xr.DataArray) -> str:
    name = cube.attrs.get("name", cube.attrs.get("source", "cube"))
    return f"{name} sha256 {hashlib.sha256(cube.values.tobytes()).hexdigest()}"


def load_prior(path: str | Path) -> Prior:
    """Read a prior file of either kind.

    Raises:
        DataError: no such file, no prior in it, or damaged content.
    """
    return GaussianMixturePrior.load(path) if kind_of(path) == "gaussian mixture" else GaussianPrior.load(path)


def rendered_prior(
    wavelengths: Sequence[float], spread: int, *, mixture: bool = False,
    block: tuple[int, int] | None = None, progress: Told | None = None,
) -> Prior:
    """The prior of the rendered training scenes at these wavelengths, learned on first use and kept.

    It is kept in the folder ``TMCA_CACHE``, or ``tmca`` in the user's cache folder.

    Args:
        wavelengths: of the bands, metres, within 400–700 nm.
        spread: columns by which the camera's snapshot is wider than the scene.
        mixture: a Gaussian mixture instead of one Gaussian.
        block: (rows, columns) instead of the camera's.
        progress: told what is done, where it has to be learned.

    Raises:
        SettingError: wavelengths that the rendered scenes do not have.
    """
    from tmca import __version__
    from tmca.data import make_folder, rendered_scene, split_rendered

    if min(wavelengths) < _RENDERED_RANGE[0] - 1e-12 or max(wavelengths) > _RENDERED_RANGE[1] + 1e-12:
        raise SettingError(
            "prior",
            f"bands from {min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm",
            "400 to 700 nm, where the rendered scenes are known",
            "pass --prior with one from `tmca prior learn --all-bands`, or use admm-tv",
        )
    names = sorted(split_rendered()["train"])
    identity = [_KEPT, __version__, [round(w * 1e12) for w in wavelengths], spread, mixture, names, _RENDERED_SIZE]
    identity += [] if block is None else [list(block)]
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:16]
    file = cache_folder() / f"rendered-{'mixture' if mixture else 'gaussian'}-{digest}.nc"
    if file.exists():
        try:
            return load_prior(file)
        except DataError:
            pass  # a damaged file of ours: learned anew below, and replaced
    cubes, told = [], progress or (lambda share, step: None)
    for index, name in enumerate(names):
        told(0.5 * index / len(names), f"first use: rendering {name} for the prior, which is then kept")
        cube = rendered_scene(name, wavelengths=list(wavelengths), size=_RENDERED_SIZE)["radiance"]
        cube.attrs["name"] = name
        cubes.append(cube)
    told(0.5, f"first use: learning the {'mixture ' if mixture else ''}prior, which is then kept")
    prior = learn_prior(cubes, spread=spread, mixture=mixture, block=block)
    make_folder(file.parent)
    prior.save(file, overwrite=True)
    return prior


def cache_folder() -> Path:
    """Where priors are kept: ``TMCA_CACHE``, else ``tmca`` in the user's cache folder."""
    if "TMCA_CACHE" in os.environ:
        return Path(os.environ["TMCA_CACHE"])
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tmca"
