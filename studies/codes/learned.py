"""What the study learns of scenes, once each: examples to design for, a mixture of them, the decoder's prior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from studies.grid import cell_key, source
from tmca.cameras import CodedCamera
from tmca.data import identity_of, load_scene, make_folder
from tmca.design import design_model, designable, learn_examples, save_examples
from tmca.priors import GaussianMixturePrior, learn_prior

if TYPE_CHECKING:
    import xarray as xr

Cubes = dict[str, "xr.DataArray"]


def examples_folder(scenes: Sequence[str], work: Path, bands: int) -> Path:
    """Folder of examples, read by `tmca.design.load_examples`."""

    def learn(cubes: Cubes, folder: Path) -> None:
        model, wavelengths = design_model(_camera(cubes).taps()), _wavelengths(cubes)
        save_examples(learn_examples(_tensors(cubes), model, wavelengths), make_folder(folder))

    return _stored("examples", scenes, work, bands, "", learn, "examples.json")


def mixture_file(scenes: Sequence[str], work: Path, bands: int) -> Path:
    """A Gaussian mixture of the blocks that designs are judged on."""

    def learn(cubes: Cubes, file: Path) -> None:
        block, parts = design_model(_camera(cubes).taps()).block[1:], list(_tensors(cubes).values())
        GaussianMixturePrior.learn(
            parts, block, wavelengths=_wavelengths(cubes), kinds=8, rank=120, gains=4, samples=12_000
        ).save(file)

    return _stored("mixture", scenes, work, bands, ".nc", learn)


def prior_file(scenes: Sequence[str], work: Path, bands: int) -> Path:
    """The prior of the decoder."""

    def learn(cubes: Cubes, file: Path) -> None:
        learn_prior(list(cubes.values()), extent=bands - 1).save(file)

    return _stored("prior", scenes, work, bands, ".nc", learn)


def _stored(
    name: str, scenes: Sequence[str], work: Path, bands: int, suffix: str, learn: Callable[[Cubes, Path], None],
    last: str = "",
) -> Path:  # fmt: skip
    """Path of what is learned of scenes; learned where it, or the last file of its folder, is not there yet."""
    identity = {"scenes": [identity_of(scene) or scene for scene in scenes], "bands": bands}
    identity["source"] = source("codes/learned.py")
    path = work / f"{name}-{cell_key(identity)}{suffix}"
    if not (path / last if last else path).exists():
        learn({Path(scene).stem: load_scene(scene, bands=bands) for scene in scenes}, path)
    return path


def _camera(cubes: Cubes) -> CodedCamera:
    return designable("static", 1, (8, 8), bands=_wavelengths(cubes))


def _wavelengths(cubes: Cubes) -> list[float]:
    wavelengths: list[float] = next(iter(cubes.values()))["wavelength"].values.tolist()
    return wavelengths


def _tensors(cubes: Cubes) -> dict[str, torch.Tensor]:
    return {name: torch.from_numpy(cube.values.copy()) for name, cube in cubes.items()}
