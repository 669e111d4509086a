"""Designs over noise and slots: their expected gain, and their gain on test scenes."""

from __future__ import annotations

from typing import Any

from tmca.cameras import CodedCamera
from tmca.data.scenes import load_scene
from tmca.design import Design, decibels
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.codes.task import Task, camera_arguments, mean, on_frame
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
    """PSNR of the LMMSE on one test scene behind random and designed codes, static and time-multiplexed."""
    task = Task.of(cell)
    prior = GaussianPrior.load(cell["prior"])
    return {"metrics": _compared(cell, task, _cameras(task, cell["slots"][0]), prior)}


def in_the_light(cell: Settings) -> Measured:
    """What the mean irradiance of test scenes changes where the examples are dimmed to it: the gains foretold for each
    scene's own, and codes designed for that of all, decoded by the prior as it was learned and by one dimmed alike."""
    scene, slots = load_scene(cell["path"], bands=cell["bands"]), cell["slots"][0]
    there, lit = Task.of(cell, float(scene.mean())), Task.of(cell, cell["light"])
    cameras = _cameras(Task.of(cell), slots)
    prior = GaussianPrior.load(cell["prior"])
    dimmed = prior.scaled(cell["light"] / float(prior.mean.mean()))
    designs = {f"{kind}, designed for the light": lit.design(kind, k).camera
               for kind, k in {"static": 1, "free": slots}.items()}  # fmt: skip
    foretold = _foretold(there, cameras) | _foretold(there, designs)
    plain = {name: _measured(cell, camera, prior) for name, camera in designs.items()}
    return {"metrics": _compared(cell, lit, designs, dimmed), "plain_prior": plain, "there": foretold}


def _cameras(task: Task, slots: int) -> dict[str, CodedCamera]:
    """Designed and random codes of every kind; the designed static ones first."""
    cameras: dict[str, CodedCamera] = {}
    for kind, k in {"static": 1, **dict.fromkeys(("one-hot", "free"), slots)}.items():
        cameras[f"{kind}, designed"] = task.design(kind, k).camera
        cameras[f"{kind}, random"] = task.random(kind, k)
    return cameras


def _foretold(task: Task, cameras: dict[str, CodedCamera]) -> dict[str, float]:
    """Gain of cameras over the first of them under the prior of the other examples, dB."""
    base, found = task.left_out(next(iter(cameras.values()))), {}
    for name, camera in cameras.items():
        own = task.left_out(camera)
        found[name] = mean({scene: own[scene] - base[scene] for scene in own})
    return found


def _compared(
    cell: Settings, task: Task, cameras: dict[str, CodedCamera], prior: GaussianPrior
) -> dict[str, dict[str, float]]:
    """What cameras reach on the scene, and what was expected and foretold of them."""
    foretold = _foretold(task, cameras)
    return {
        name: {**_measured(cell, camera, prior), "expected_psnr": task.psnr(camera), "predicted_gain": foretold[name],
               "throughput": camera.throughput()}
        for name, camera in cameras.items()
    }  # fmt: skip


def _measured(cell: Settings, camera: CodedCamera, prior: GaussianPrior) -> dict[str, float]:
    from tmca.applications import simulate
    from tmca.experiments.spectral.imaging import reconstruct_snapshot

    scene = load_scene(cell["path"], bands=cell["bands"])
    size = (scene.sizes["y"], scene.sizes["x"])
    own = camera_arguments(scene["wavelength"].values.tolist(), None)
    whole = on_frame(camera, own, size, Sensor(**cell["sensor"]))
    taken = simulate(scene, whole, seed=cell["seed"])
    return reconstruct_snapshot(taken, "lmmse", prior=prior, truth=scene).metrics
