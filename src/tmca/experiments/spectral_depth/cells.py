"""The cells of the spectral-depth table: searches of masks, trainings, measurements."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.applications.example_scenes import flat_error, judge_on, placed_error
from tmca.applications.spectral_depth import spectral_depth_metrics
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes, write_phase_codes
from tmca.data.depth_scenes import load_any_depth_scene, with_surroundings
from tmca.data.fitting import middle_of
from tmca.design.mask_search import SIZE
from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.decoder_labels import prior_kind
from tmca.experiments.spectral_depth.imaging import (
    middle_of_reconstruction,
    reading_range,
    reconstruct_spectral_depth,
    take_spectral_depth_snapshot,
)
from tmca.experiments.spectral_depth.rows import CODES, CONSTANT
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

    from tmca.priors import GaussianPrior


def measure(cell: Settings, folder: str) -> Measured:
    """One cell of any kind; ``folder`` takes codes and estimates that are kept."""
    kinds = {"search": search, "training": train, "rows": reconstruct, "constant": guess, "foretold": foretold}
    return kinds[cell["kind"]](cell, Path(folder))


def coded_camera(cell: Settings, size: tuple[int, int], codes: str | None = None) -> SpectralDepthCamera:
    """The camera of a cell: the code's settings, or the codes of a file."""
    given: dict[str, Any] = {**CODES[cell["code"]], "seed": cell["seed"], "sensor": Sensor(**cell["sensor"])}
    given |= {} if codes is None else read_phase_codes(codes)
    return SpectralDepthCamera.from_preset(cell["preset"], size=size, **given)


def search(cell: Settings, folder: Path) -> Measured:
    """Masks that are searched under one noise; how well they and random ones tell depths apart."""
    from tmca.design import MaskEffort, MaskTask, search_masks
    from tmca.design.spectral_depth import kullback_leibler
    from tmca.priors import GaussianPrior

    probe, settings = coded_camera(cell, SIZE), CODES[cell["code"]]
    camera = {"bands": probe.wavelengths, "depth": (probe.planes.near, probe.planes.far), "planes": probe.planes.count}
    camera |= {"filters": settings["filters"], "channels": "rgb", "period": probe.period, "sensor": probe.sensor}
    family = settings.get("mask", "zernike")
    task = MaskTask(probe.bench, camera, settings["shutter"], family, window=cell["window"], seed=cell["seed"])
    prior = GaussianPrior.load(cell["prior"])
    judge = judge_on(examples_of(cell), prior, cell["decoded"])
    advice = search_masks(task, prior, [settings["slots"]], MaskEffort(**cell["effort"]), judge=judge)
    found = advice.candidates[-1]
    file = folder / f"codes-{cell_key(cell)}.nc"
    write_phase_codes(found.camera, file, settings["filters"], "rgb", overwrite=True)
    told = {}
    drawn = (found.random_covariance, found.random_information)
    for name, (covariance, fisher) in (("optimised", (found.covariance, found.information)), ("random", drawn)):
        told[name] = {"fisher": fisher.tolist(), "kullback_leibler": kullback_leibler(covariance).tolist()}
    return {"codes": str(file), "foretold": told, "seconds": found.seconds, "confusion": found.confusion}


def examples_of(cell: Settings) -> list[torch.Tensor]:
    """Some training scenes (L, H, W), at the bands of the preset."""
    return _examples(cell["preset"], tuple(cell["examples"]), **_reading(cell))


@lru_cache(maxsize=1)
def _examples(preset: str, names: tuple[str, ...], **how: Any) -> list[torch.Tensor]:
    """Read once for all the cells of a process."""
    camera = SpectralDepthCamera.from_preset(preset, size=SIZE)
    scenes = (load_any_depth_scene(name, **how, **reading_range(camera)) for name in names)
    return [torch.from_numpy(scene["radiance"].values.copy()) for scene in scenes]


def _reading(cell: Settings) -> dict[str, Any]:
    """How the scenes of a cell are read."""
    return {name: cell[name] for name in ("side", "placed", "from_rgb")}


def foretold(cell: Settings, folder: Path) -> Measured:
    """What the prior says of a code under a noise, before any scene is seen."""
    from tmca.design.spectral_depth import confusion, depth_information, kullback_leibler, predict_windows
    from tmca.priors import GaussianPrior

    camera, prior = _camera(cell, SIZE), GaussianPrior.load(cell["prior"])
    with torch.no_grad():
        found = predict_windows(camera, prior, cell["window"])
        distance = kullback_leibler(found.covariance).fill_diagonal_(float("inf"))
        return {"figures": {
            **_on_examples(cell, camera, prior),
            "confusion": float(confusion(found.covariance)),
            "fisher": float(depth_information(camera, prior, cell["window"]).log().mean().exp()),
            "kullback_leibler": float(distance.min(1).values.mean()),
            "psnr": -10 * float(found.spectral_error.mean().log10()),
        }}  # fmt: skip


def _on_examples(cell: Settings, camera: SpectralDepthCamera, prior: GaussianPrior) -> dict[str, float]:
    """Errors on training scenes at drawn depths, and without edges of depth; none where they are too small."""
    kinds = {"placed": placed_error, "flat": flat_error}
    judges = {name: judge_on(examples_of(cell), prior, cell["decoded"], error) for name, error in kinds.items()}
    return {name: judge(camera) for name, judge in judges.items() if judge is not None}


def train(cell: Settings, folder: Path) -> Measured:
    """Train a row's network in a folder of its own, or go on with it."""
    from tmca.training import train as train_camera
    from tmca.training import training_settings
    from tmca.training.starting_masks import starting_camera

    settings: Any = training_settings("spectral-depth", None, None, cell["training"])
    how = _reading(cell) | reading_range(starting_camera(settings))
    found = train_camera(settings, Path(cell["folder"]), lambda name: load_any_depth_scene(name, **how))
    return {"weights": str(found.weights), "best": found.best, "seconds": found.cpu_seconds}


def scenes_of(cell: Settings, camera: SpectralDepthCamera) -> dict[str, xr.Dataset]:
    """The middles of the test scenes with their surroundings, by name.

    Their spectra are made up of reflectances that nothing learned from.
    """
    how, size = {**_reading(cell), "materials": "test"}, _crop(cell)
    return {
        name: with_surroundings(
            load_any_depth_scene(path, **how, **reading_range(camera)), size, path, camera.tile_size
        )
        for path, name in cell["scenes"].items()
    }


def _crop(cell: Settings) -> tuple[int, int]:
    """(H, W) that is measured."""
    return int(cell["crop"][0]), int(cell["crop"][1])


def reconstruct(cell: Settings, folder: Path) -> Measured:
    """Snapshots of all test scenes behind one code with one noise, decoded and measured."""
    crop = _crop(cell)
    probe = _camera(cell, crop)
    given = {"window": cell["window"]} if cell["decoder"] == "likelihood" else {}
    if not cell.get("weights") and prior_kind(cell["decoder"]):
        given["prior"] = cell["prior"]
    given |= {"weights": cell["weights"]} if cell.get("weights") else {}
    metrics, seconds, kept = {}, {}, dict[str, str]()
    method = "network" if cell.get("weights") else cell["decoder"]
    for name, scene in scenes_of(cell, probe).items():
        camera = _camera(cell, (scene.sizes["y"], scene.sizes["x"]))
        snapshot = take_spectral_depth_snapshot(scene, camera, seed=cell["seed"])
        whole = reconstruct_spectral_depth(snapshot, method, **given)
        found = middle_of_reconstruction(whole, crop, scene, camera.planes)
        metrics[name], seconds[name] = found.metrics, found.seconds
        if cell["keep"]:
            kept[name] = str(found.save(folder / f"estimate-{cell_key(cell)}-{len(kept)}.nc", overwrite=True))
    with torch.no_grad():
        arrived = probe.point_spread.arrived()
    light = {"throughput": probe.throughput(), "arrived": float(arrived.mean())}
    return {"metrics": metrics, "seconds": seconds, **light, "kept": kept}


def _camera(cell: Settings, size: tuple[int, int]) -> SpectralDepthCamera:
    """That of the weights, of a file of codes, or of the code's settings."""
    from tmca.decoders import Weights

    weights = cell.get("weights") or cell.get("camera_of")
    if weights:
        camera: SpectralDepthCamera = Weights.load(weights).camera_for(size, sensor=Sensor(**cell["sensor"]))
        return camera
    return coded_camera(cell, size, cell.get("codes"))


def guess(cell: Settings, folder: Path) -> Measured:
    """Depth errors of the middle of the range, in inverse metres, everywhere."""
    camera = SpectralDepthCamera.from_preset(cell["preset"], size=_crop(cell))
    middle = 2 / (1 / camera.planes.near + 1 / camera.planes.far)
    metrics = {}
    for name, whole in scenes_of(cell, camera).items():
        scene = middle_of(whole, camera.size, name)
        depth = np.full(camera.size, middle, dtype=np.float32)
        own = spectral_depth_metrics(scene["radiance"].values, depth, scene, camera.planes)
        metrics[name] = {key: own[key] for key in ("depth_mae", "depth_rmse", "within_bin", "known_depth")}
    return {"metrics": metrics, "code": CONSTANT}
