"""Searched codes of spectral and light-field cameras: example scenes that they are searched for, and the search."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from tmca.design import Task, camera_arguments, design_model, designable, learn_examples, save_examples
from tmca.evaluation.grid import Measured, Settings, package_version

if TYPE_CHECKING:
    import xarray as xr


def learn_examples_of(scenes: Mapping[str, xr.DataArray], folder: Path) -> None:
    """Examples of cubes or light fields, by their short names, that codes are searched for."""
    from tmca.data import make_folder
    from tmca.priors import views_of

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
