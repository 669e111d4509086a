"""Searched codes: patterns for example scenes, and phase masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from tmca.applications.example_scenes import judge_on
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import write_phase_codes
from tmca.data.fitting import middle_of
from tmca.design import (
    MaskEffort,
    MaskTask,
    Task,
    camera_arguments,
    design_model,
    designable,
    learn_examples,
    save_examples,
    search_masks,
)
from tmca.evaluation.grid import Measured, Settings, cell_key, package_version

if TYPE_CHECKING:
    import xarray as xr


def learn_examples_of(scenes: Mapping[str, xr.DataArray], folder: Path, most: int | None = None) -> None:
    """Examples of cubes or light fields, by their short names, that codes are searched for: of their middle, of so many
    pixels a side at most."""
    from tmca.data import make_folder
    from tmca.priors import views_of

    if most is not None:
        scenes = {
            name: middle_of(scene, (min(most, scene.sizes["y"]), min(most, scene.sizes["x"])), name)
            for name, scene in scenes.items()
        }
    first = next(iter(scenes.values()))
    if "view_v" in first.dims:
        grid = (first.sizes["view_v"], first.sizes["view_u"])
        model = design_model(designable("static", 1, (8, 8), **camera_arguments((), grid)).taps())
        cubes = {name.replace("/", "-"): views_of(field)[0].flatten(0, 1) for name, field in scenes.items()}
        examples = learn_examples(cubes, model, None, views=grid)
    else:
        wavelengths = first["wavelength"].values.tolist()
        model = design_model(designable("static", 1, (8, 8), bands=wavelengths).taps())
        cubes = {name.replace("/", "-"): torch.from_numpy(cube.values.copy()) for name, cube in scenes.items()}
        examples = learn_examples(cubes, model, wavelengths)
    save_examples(examples, make_folder(folder))


def searched(cell: Settings) -> Measured:
    """The codes of a search, and with ``gains`` their expected PSNR, that of random codes, and what they gain over the
    static design when each example is estimated under the prior of the others."""
    task = Task.of({**cell, "source": package_version()})
    kind, slots = cell["kind"], int(cell["slots"])
    design = task.design(kind, slots)
    results: Measured = {"codes": str(task.file(kind, slots)), "seconds": sum(task.seconds(kind, slots).values())}
    if not cell.get("gains"):
        return results
    own, base = task.left_out(design.camera), task.left_out(task.design("static", 1).camera)
    return results | {
        "psnr": design.psnr, "random_psnr": task.psnr(task.random(kind, slots)),
        "throughput": design.camera.throughput(), "gains": {name: own[name] - base[name] for name in own},
    }  # fmt: skip


def searched_masks(
    probe: SpectralDepthCamera, cell: Settings, examples: Sequence[torch.Tensor], folder: Path
) -> Measured:
    """Masks of least confusion of depths, written into a folder; how well they and random ones tell depths apart.

    Args:
        probe: camera of the size, bench, bands, planes, tile and sensor that masks are searched for.
        cell: of the search; its settings say camera, prior, window and effort.
        examples: (L, H, W) scenes that masks are judged on.
        folder: of the file of codes.
    """
    from tmca.design.spectral_depth import kullback_leibler
    from tmca.priors import GaussianPrior

    own, camera = cell["settings"], cell["settings"]["camera"]
    planes, prior = probe.planes, GaussianPrior.load(own["prior"])
    given = {"bands": probe.wavelengths, "depth": (planes.near, planes.far), "planes": planes.count}
    given |= {"filters": camera["filters"], "channels": "rgb", "period": probe.period, "sensor": probe.sensor}
    given["buckets"] = probe.buckets
    family = camera.get("mask", "zernike")
    task = MaskTask(probe.bench, given, camera["shutter"], family, window=own["searched"], seed=cell["seed"])
    judge = judge_on(examples, prior, own["window"])
    found = search_masks(task, prior, [camera["slots"]], MaskEffort(**own["effort"]), judge=judge).candidates[-1]
    file = folder / f"codes-{cell['code'].replace(' ', '-').replace('/', '-')}-{cell_key(cell)}.nc"
    write_phase_codes(found.camera, file, camera["filters"], "rgb", overwrite=True)
    windows = {"optimised": (found.covariance, found.information),
               "random": (found.random_covariance, found.random_information)}  # fmt: skip
    predicted = {
        name: {"fisher": fisher.tolist(), "kullback_leibler": kullback_leibler(covariance).tolist()}
        for name, (covariance, fisher) in windows.items()
    }
    return {"codes": str(file), "predicted": predicted, "seconds": found.seconds, "confusion": found.confusion}
