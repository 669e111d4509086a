"""The cells of the spectral table: one training, one measurement, one check of the expected error."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np

from tmca.cameras import Hardware, SpectralCamera
from tmca.data.scenes import load_scene
from tmca.decoders import OtherCodes
from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.decoder_labels import prior_kind
from tmca.experiments.spectral.rows import CODES, NETWORKS, NOISES, POOL, scenes_of
from tmca.sensor import Sensor


def measure(cell: Settings, folder: str) -> Measured:
    """One cell of any kind, by what it holds; ``folder`` takes estimates that are kept."""
    if "training" in cell:
        return train(cell)
    return reconstruct(cell, Path(folder)) if "decoder" in cell else expected(cell)


def train(cell: Settings) -> Measured:
    """Train a row's network (and codes) in a folder of its own, or go on with it."""
    from tmca.training import train as train_camera
    from tmca.training import training_settings

    start, bands = time.process_time(), cell["bands"]
    settings = training_settings("spectral", None, None, cell["training"])
    found = train_camera(settings, Path(cell["folder"]), lambda name: load_scene(name, bands=bands))
    seconds = max(time.process_time() - start, found.cpu_seconds)
    return {"weights": str(found.weights), "best": found.best, "seconds": seconds}


def reconstruct(cell: Settings, folder: Path) -> Measured:
    """Take the snapshot of a scene, reconstruct it, measure; half precision is enough for pictures."""
    from tmca.applications import simulate
    from tmca.decoders import Weights
    from tmca.experiments.spectral.imaging import reconstruct_snapshot

    scene = load_scene(cell["path"], bands=cell["bands"])
    sensor = Sensor(**NOISES[cell["noise"]])
    weights = None if cell.get("weights") is None else Weights.load(cell["weights"])
    if weights is not None and cell["code"] not in CODES:
        camera = weights.camera_for((scene.sizes["y"], scene.sizes["x"]), sensor=sensor)
    else:
        camera = coded_camera(cell, scene["wavelength"].values.tolist(), (scene.sizes["y"], scene.sizes["x"]))
    network = weights if cell["decoder"] in NETWORKS else None
    method = "network" if network else cell["decoder"]
    snapshot = simulate(scene, camera, seed=cell["seed"])
    with catch_warnings():
        simplefilter("ignore", OtherCodes)  # the table says so
        result = reconstruct_snapshot(snapshot, method, prior=cell["prior"], weights=network, truth=scene)
    found = {"metrics": result.metrics, "seconds": result.seconds, "throughput": camera.throughput()}
    if cell["keep"]:
        file = folder / f"estimate-{cell_key(cell)}.npy"
        np.save(file, result.cube.values.astype(np.float16))
        found["kept"] = str(file)
    return found


def expected(cell: Settings) -> Measured:
    """Predicted PSNR of a code beside the PSNR on patches of the training and of the test scenes."""
    import torch

    from tmca.experiments.spectral.expected import predicted_and_measured
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


def sweep_cell(cell: Settings) -> Measured:
    """One combination of a sweep on one scene; a network is trained, and a prior learned, once for all scenes."""
    from tmca.applications import simulate
    from tmca.experiments.spectral.imaging import reconstruct_snapshot

    size = None if cell["size"] is None else (cell["size"][0], cell["size"][1])
    scene = load_scene(cell["path"], bands=cell["bands"], size=size)
    camera = SpectralCamera(
        bands=scene["wavelength"].values.tolist(), size=(scene.sizes["y"], scene.sizes["x"]),
        sensor=Sensor(**cell["sensor"]), **cell["camera"],
    )  # fmt: skip
    faults = Hardware.of(cell.get("faults", {}))
    snapshot = simulate(scene, camera, seed=cell["camera"].get("seed", 0), hardware=faults)
    method, prior, weights = cell["decoder"], None, None
    if method in NETWORKS:
        method, weights = "network", _network_of(cell)
    elif prior_kind(method) and cell["train"]:
        prior = _prior_of(cell, camera)
    with catch_warnings():
        simplefilter("ignore", OtherCodes)  # the page says which decoder it was
        result = reconstruct_snapshot(
            snapshot, method, prior=prior, weights=weights, truth=scene, **cell.get("settings", {})
        )
    return {"metrics": result.metrics, "seconds": result.seconds, "throughput": camera.throughput()}


def sweep_training(cell: Settings) -> Measured:
    """The training of one combination, before its scenes are measured."""
    return {"weights": str(_network_of(cell))}


def _network_of(cell: Settings) -> Path:
    from tmca.training import train as train_camera
    from tmca.training import training_settings

    network = NETWORKS[cell["decoder"]]
    training = {
        "camera": cell["camera"], "noise": [cell["sensor"]], "decoder": network,
        "data": {"bands": cell["bands"], "pool": POOL[network["start"]], **scenes_of(cell["train"]),
                 "validation": cell["validation"]},
        "optimiser": {"steps": cell["steps"], "loss": "l2" if cell["decoder"] == "unet-thesis" else "log"},
    }  # fmt: skip
    return train_camera(training_settings("spectral", None, None, training), Path(cell["folder"])).weights


def _prior_of(cell: Settings, camera: SpectralCamera) -> Path:
    """The prior of a sweep's training scenes, kept by what makes it."""
    from tmca.priors import learn_prior

    kind = "mixture" if prior_kind(cell["decoder"]) == "mixture" else "gaussian"
    key = cell_key(
        {
            "train": cell["train"],
            "checksums": cell["checksums"],
            "bands": cell["bands"],
            "spread": camera.dispersion.extent,
            "mixture": kind == "mixture",
        }
    )
    file = Path(cell["folder"]).parent / f"prior-{key}.nc"
    if not file.exists():
        cubes = [load_scene(name, bands=cell["bands"]) for name in cell["train"]]
        learn_prior(cubes, camera, kind).save(file, overwrite=True)
    return file
