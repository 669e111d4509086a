"""Designs over noise and slots: their expected gain, and their gain on test scenes."""

from __future__ import annotations

from typing import Any

from tmca.cameras import CodedCamera
from tmca.design import Design
from tmca.design.search import decibels
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.codes.task import Task, mean, on_frame
from tmca.experiments.scenes import load_scene
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor


def grid(cell: Settings) -> Measured:
    """The static design, and one-hot and free designs of every number of slots, under one noise."""
    task = Task.of(cell)
    static = task.design("static", 1)
    base = task.left_out(static.camera)
    rows = [_row(task, static, static, base)]
    for slots in cell["slots"]:
        rows += [_row(task, task.design(kind, slots), static, base) for kind in ("one-hot", "free")]
    return {"rows": rows}


def _row(task: Task, design: Design, static: Design, base: dict[str, float]) -> dict[str, Any]:
    """Expected PSNR, and PSNR under the prior of the other scenes, of a design and of random codes of its kind."""
    own, random = task.left_out(design.camera), task.random(design.kind, design.slots)
    return {
        "kind": design.kind, "slots": design.slots, "psnr": design.psnr, "random_psnr": decibels(design.random),
        "gain": design.psnr - static.psnr, "held_out_psnr": mean(own),
        "held_out_random": mean(task.left_out(random)),
        "held_out_gains": {name: own[name] - base[name] for name in own},
        "throughput": design.camera.throughput(), "seconds": design.seconds,
    }  # fmt: skip


def design_ahead(cell: Settings) -> Measured:
    """Designs that other cells will ask for."""
    return {"seconds": Task.of(cell).design("free", cell["slots"][0]).seconds}


def on_test_scene(cell: Settings) -> Measured:
    """PSNR of the LMMSE on one test scene behind random and designed codes, static and time-multiplexed.

    Designs for the light know the mean irradiance of the test scenes, as a light meter tells it, and so does the prior
    behind them; gains are foretold both for the light of the examples and for that of the scene.
    """
    scene = load_scene(cell["path"], bands=cell["bands"])
    here, there, lit = Task.of(cell), Task.of(cell, float(scene.mean())), Task.of(cell, cell["light"])
    prior = GaussianPrior.load(cell["prior"])
    found = _compared(cell, _cameras(here, cell["slots"][0]), {"predicted_gain": here, "predicted_there": there}, prior)
    slots = {"static": 1, "free": cell["slots"][0]}
    designs = {f"{kind}, designed for the light": lit.design(kind, k).camera for kind, k in slots.items()}
    metered = prior.scaled(cell["light"] / float(prior.mean.mean()))
    return {"metrics": found | _compared(cell, designs, {"predicted_gain": lit, "predicted_there": there}, metered)}


def _cameras(task: Task, slots: int) -> dict[str, CodedCamera]:
    """Designed and random codes of every kind; the designed static ones first."""
    cameras: dict[str, CodedCamera] = {}
    for kind, k in {"static": 1, **dict.fromkeys(("one-hot", "free"), slots)}.items():
        cameras[f"{kind}, designed"] = task.design(kind, k).camera
        cameras[f"{kind}, random"] = task.random(kind, k)
    return cameras


def _compared(
    cell: Settings, cameras: dict[str, CodedCamera], tasks: dict[str, Task], prior: GaussianPrior
) -> dict[str, Any]:
    """What cameras reach on the scene, and the gains over the first of them that each of the tasks foretells."""
    found: dict[str, Any] = {}
    base = {said: task.left_out(next(iter(cameras.values()))) for said, task in tasks.items()}
    for name, camera in cameras.items():
        own = {said: task.left_out(camera) for said, task in tasks.items()}
        found[name] = {
            **_measured(cell, camera, prior), "expected_psnr": tasks["predicted_gain"].psnr(camera),
            **{said: mean({s: own[said][s] - base[said][s] for s in own[said]}) for said in tasks},
            "throughput": camera.throughput(),
        }  # fmt: skip
    return found


def _measured(cell: Settings, camera: CodedCamera, prior: GaussianPrior) -> dict[str, float]:
    from tmca.experiments.spectral import reconstruct_snapshot, take_snapshot

    scene = load_scene(cell["path"], bands=cell["bands"])
    size = (scene.sizes["y"], scene.sizes["x"])
    whole = on_frame(camera, scene["wavelength"].values.tolist(), size, Sensor(**cell["sensor"]))
    taken = take_snapshot(scene, whole, seed=cell["seed"])
    return reconstruct_snapshot(taken, "lmmse", prior=prior, truth=scene).metrics
