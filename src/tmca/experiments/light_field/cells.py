"""The cells of the light-field table: searches of codes, trainings, true geometry, measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings, simplefilter

import numpy as np

from tmca.applications import simulate
from tmca.cameras import LightFieldCamera
from tmca.data.fitting import centre_window
from tmca.data.light_field_scenes import Reading, read_middle, true_disparity
from tmca.decoders import OtherCodes
from tmca.design import Task, on_frame
from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.light_field.imaging import reconstruct_light_field
from tmca.experiments.light_field.rows import CODES, LEARNED, NETWORKS, NOISES, search_of
from tmca.sensor import Sensor
from tmca.training.light_field import training_reading

if TYPE_CHECKING:
    import xarray as xr

    from tmca.decoders import Weights


def measure(cell: Settings, folder: str) -> Measured:
    """One cell of any kind; ``folder`` takes estimates and maps that are kept."""
    if cell["kind"] == "search":
        return search(cell)
    if cell["kind"] == "training":
        return train(cell)
    return geometry(cell, Path(folder)) if cell["kind"] == "geometry" else reconstruct(cell, Path(folder))


def search(cell: Settings) -> Measured:
    """A search for one noise; the expected PSNR of its design and of random codes, the gain under other priors."""
    task = Task.of(cell)
    kind, slots = cell["search"]
    found = task.design(kind, slots)
    own, base = task.left_out(found.camera), task.left_out(task.design("static", 1).camera)
    return {
        "psnr": found.psnr, "random_psnr": task.psnr(task.random(kind, slots)),
        "seconds": sum(task.seconds(kind, slots).values()),
        "throughput": found.camera.throughput(), "gains": {name: own[name] - base[name] for name in own},
    }  # fmt: skip


def train(cell: Settings) -> Measured:
    """Train a row's network in a folder of its own, or go on with it."""
    from tmca.training import train as train_camera
    from tmca.training import training_settings

    settings: Any = training_settings("light-field", None, None, cell["training"])
    reading = training_reading(settings)
    found = train_camera(settings, Path(cell["folder"]), lambda name: read_middle(name, cell["views"][0], reading))
    return {"weights": str(found.weights), "best": found.best, "seconds": found.cpu_seconds}


def geometry(cell: Settings, folder: Path) -> Measured:
    """The disparity that the fixed estimator sees in the true views and the true one, kept; the estimator's error."""
    from tmca.metrics import disparity_error, estimate_disparity

    scene = _scene(cell)
    seen = estimate_disparity(scene.values)
    own = Reading(**cell["reading"]).of(cell["path"])
    truth = true_disparity(cell["path"], scene, own.get("scale"), own.get("pattern"))
    maps = {"seen": seen.astype(np.float32)} | ({} if truth is None else {"truth": truth.values.astype(np.float32)})
    file = folder / f"disparity-{cell_key(cell)}.npz"
    np.savez(file, allow_pickle=False, **maps)
    error = {} if truth is None else _named("disparity", disparity_error(seen, truth.values))
    return {"disparity": str(file), "error": error}


def reconstruct(cell: Settings, folder: Path) -> Measured:
    """Take the snapshot of a scene, reconstruct it, measure; half precision is enough for pictures."""
    from tmca.decoders import Weights

    scene = _scene(cell)
    if cell["crop"]:
        rows, columns = centre_window((scene.sizes["y"], scene.sizes["x"]), tuple(cell["crop"]), None, cell["scene"])
        scene = scene.isel(y=rows, x=columns)
    given: dict[str, Any] = {name: cell[name] for name in ("prior", "dictionary") if cell.get(name)}
    if cell.get("weights"):
        given["weights"] = Weights.load(cell["weights"])
    camera = coded_camera(cell, (scene.sizes["y"], scene.sizes["x"]), given.get("weights"))
    method = "network" if cell["decoder"] in NETWORKS else cell["decoder"]
    snapshot = simulate(scene, camera, seed=cell["seed"])
    with catch_warnings():
        simplefilter("ignore", OtherCodes)
        result = reconstruct_light_field(snapshot, method, truth=scene, **given)
    found: Measured = {"metrics": result.metrics, "seconds": result.seconds, "throughput": camera.throughput()}
    if not cell["crop"]:
        found["metrics"] = result.metrics | _shape(result.light_field, cell["disparity"])
        found |= _per_view(result.light_field, scene)
    if cell["keep"]:
        file = folder / f"estimate-{cell_key(cell)}.npy"
        np.save(file, result.light_field.values.astype(np.float16))
        found["kept"] = str(file)
    return found


def _scene(cell: Settings) -> xr.DataArray:
    return read_middle(cell["path"], cell["views"][0], Reading(**cell["reading"]), cell["size"])


def _shape(estimate: xr.DataArray, maps: str) -> dict[str, float]:
    """Error of the disparity that the reconstructed views show: against the true views', and the truth if known."""
    from tmca.metrics import disparity_error, estimate_disparity

    seen, known = estimate_disparity(estimate.values), np.load(maps)
    found = _named("agreement", disparity_error(seen, known["seen"]))
    return found | _named("disparity", disparity_error(seen, known["truth"])) if "truth" in known else found


def _named(name: str, error: dict[str, float]) -> dict[str, float]:
    return {f"{name}_{key}": error[key] for key in ("mae", "badpix")}


def _per_view(estimate: xr.DataArray, truth: xr.DataArray) -> Measured:
    """(V, U) PSNR and SSIM of every view."""
    from tmca.metrics import psnr_per_view, ssim_per_view

    both = {"psnr_per_view": psnr_per_view, "ssim_per_view": ssim_per_view}
    return {name: metric(estimate.values, truth.values).tolist() for name, metric in both.items()}


def coded_camera(cell: Settings, size: tuple[int, int], weights: Weights | None = None) -> LightFieldCamera:
    """The camera of a cell's code and noise; codes that learned with a network are in its weights."""
    code, sensor = cell["code"], Sensor(**NOISES[cell["noise"]])
    if code in LEARNED and weights is not None:
        learned: LightFieldCamera = weights.camera_for(size, sensor=sensor)
        return learned
    if code in CODES:
        return LightFieldCamera(
            (cell["views"][0], cell["views"][1]),
            size,
            period=(cell["period"][0], cell["period"][1]),
            seed=cell["seed"],
            sensor=sensor,
            **CODES[code],
        )
    kind, slots, target = search_of(code, cell["noise"])
    task = Task.of({**cell, "sensor": NOISES[target]})
    camera: LightFieldCamera = on_frame(task.design(kind, slots).camera, task.camera, size, sensor)
    return camera
