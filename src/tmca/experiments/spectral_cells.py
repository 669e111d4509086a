"""The cells of the spectral table: one training, one measurement, one check of the expected error."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from tmca.cameras import SpectralCamera
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.scenes import load_scene
from tmca.experiments.spectral_rows import CODES, NOISES
from tmca.sensor import Sensor


def measure(cell: Settings) -> Measured:
    """One cell of any kind, by what it holds."""
    if "training" in cell:
        return train(cell)
    return reconstruct(cell) if "decoder" in cell else expected(cell)


def train(cell: Settings) -> Measured:
    """Train a row's network (and codes) in a folder of its own, or go on with it."""
    from tmca.training import settings_from, train_spectral

    start, bands = time.process_time(), cell["bands"]
    settings = settings_from(None, None, cell["training"])
    found = train_spectral(
        settings, Path(cell["folder"]), lambda name: load_scene(name, bands=bands), accelerator="auto"
    )
    seconds = time.process_time() - start
    return {"weights": str(found.weights), "best": found.best, "seconds": seconds}


def reconstruct(cell: Settings) -> Measured:
    """Take the snapshot of a scene, reconstruct it, measure."""
    from tmca.decoders import Weights
    from tmca.experiments.spectral import reconstruct_snapshot, take_snapshot

    scene = load_scene(cell["path"], bands=cell["bands"])
    sensor = Sensor(**NOISES[cell["noise"]])
    weights = None if cell.get("weights") is None else Weights.load(cell["weights"])
    if weights is not None and cell["code"] not in CODES:
        camera = weights.spectral_camera((scene.sizes["y"], scene.sizes["x"]), sensor=sensor)
    else:
        camera = coded_camera(cell, scene["wavelength"].values.tolist(), (scene.sizes["y"], scene.sizes["x"]))
    method = cell["decoder"] if weights is None else "network"
    snapshot = take_snapshot(scene, camera, seed=cell["seed"])
    result = reconstruct_snapshot(snapshot, method, prior=cell["prior"], weights=weights, truth=scene)
    return {"metrics": result.metrics, "seconds": result.seconds, "throughput": camera.throughput()}


def expected(cell: Settings) -> Measured:
    """Predicted PSNR of a code beside the PSNR on patches of the training and of the test scenes."""
    import torch

    from tmca.experiments.expected import predicted_and_measured
    from tmca.priors import GaussianPrior

    prior = GaussianPrior.load(cell["prior"])
    camera = coded_camera(cell, prior.wavelengths or cell["bands"], (256, 256))
    found = {}
    for split in ("train", "test"):
        cubes = [torch.from_numpy(load_scene(path, bands=cell["bands"]).values) for path in cell[split]]
        found["predicted"], found[split] = predicted_and_measured(
            prior, camera, cubes, count=cell["patches"], seed=cell["seed"]
        )
    return {"expected": found}


def coded_camera(cell: Settings, bands: Any, size: tuple[int, int]) -> SpectralCamera:
    """The camera of a cell's code and noise."""
    sensor = Sensor(**NOISES[cell["noise"]])
    return SpectralCamera(bands=bands, size=size, sensor=sensor, seed=cell["seed"], **CODES[cell["code"]])
