"""What the study learns of scenes, once each: examples to design for, a mixture of them, the decoder's prior."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.data.scene_names import identity_of
from tmca.data.scenes import load_scene
from tmca.design import design_model, designable, learn_examples
from tmca.experiments.cells import cell_key
from tmca.experiments.codes.task import save_examples
from tmca.experiments.source import source_digest

if TYPE_CHECKING:
    import xarray as xr

_MIXTURE: dict[str, Any] = {"kinds": 8, "rank": 120, "gains": 4, "samples": 12_000}
Cubes = dict[str, "xr.DataArray"]


def examples_folder(scenes: Sequence[str], work: Path, bands: int) -> Path:
    """Folder of examples, read by ``load_examples``."""

    def learn(cubes: Cubes, folder: Path) -> None:
        from tmca.data import make_folder

        wavelengths = next(iter(cubes.values()))["wavelength"].values.tolist()
        save_examples(learn_examples(_tensors(cubes), _model(wavelengths), wavelengths), make_folder(folder))

    return _kept("examples", scenes, work, bands, "", learn, "examples.json")


def mixture_file(scenes: Sequence[str], work: Path, bands: int) -> Path:
    """A Gaussian mixture of the blocks that designs are judged on."""

    def learn(cubes: Cubes, file: Path) -> None:
        from tmca.priors import GaussianMixturePrior

        wavelengths = next(iter(cubes.values()))["wavelength"].values.tolist()
        block, parts = _model(wavelengths).block[1:], list(_tensors(cubes).values())
        GaussianMixturePrior.learn(parts, block, wavelengths=wavelengths, **_MIXTURE).save(file)

    return _kept("mixture", scenes, work, bands, ".nc", learn)


def prior_file(scenes: Sequence[str], work: Path, bands: int) -> Path:
    """The prior of the decoder."""

    def learn(cubes: Cubes, file: Path) -> None:
        from tmca.priors import learn_prior

        learn_prior(list(cubes.values()), spread=bands - 1).save(file)

    return _kept("prior", scenes, work, bands, ".nc", learn)


def _kept(
    name: str,
    scenes: Sequence[str],
    work: Path,
    bands: int,
    suffix: str,
    learn: Callable[[Cubes, Path], None],
    last: str = "",
) -> Path:
    """Path of what is learned of scenes; learned where it, or the last file of its folder, is not there yet."""
    identity = {"scenes": [identity_of(scene) or scene for scene in scenes], "bands": bands}
    identity["source"] = source_digest(__name__)
    path = work / f"{name}-{cell_key(identity)}{suffix}"
    if not (path / last if last else path).exists():
        learn({Path(scene).stem: load_scene(scene, bands=bands) for scene in scenes}, path)
    return path


def _model(wavelengths: Sequence[float]) -> Any:
    return design_model(designable("static", 1, (8, 8), bands=list(wavelengths)).taps())


def _tensors(cubes: Cubes) -> dict[str, Any]:
    import torch

    return {name: torch.from_numpy(cube.values.copy()) for name, cube in cubes.items()}
