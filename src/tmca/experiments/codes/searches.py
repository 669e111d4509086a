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
    """PSNR of the LMMSE on one test scene behind random and designed codes, static and time-multiplexed."""
    task = Task.of(cell)
    kinds = {"static": 1, **dict.fromkeys(("one-hot", "free"), cell["slots"][0])}
    cameras: dict[str, CodedCamera] = {}
    for kind, slots in kinds.items():
        cameras[f"{kind}, designed"] = task.design(kind, slots).camera
        cameras[f"{kind}, random"] = task.random(kind, slots)
    base, found = task.left_out(cameras["static, designed"]), {}
    for name, camera in cameras.items():
        own = task.left_out(camera)
        found[name] = {
            **_measured(task, cell, camera), "expected_psnr": task.psnr(camera),
            "predicted_gain": mean({scene: own[scene] - base[scene] for scene in own}),
            "throughput": camera.throughput(),
        }  # fmt: skip
    return {"metrics": found}


def _measured(task: Task, cell: Settings, camera: CodedCamera) -> dict[str, float]:
    from tmca.experiments.spectral import reconstruct_snapshot, take_snapshot

    scene = load_scene(cell["path"], bands=cell["bands"])
    whole = on_frame(camera, task.bands, (scene.sizes["y"], scene.sizes["x"]), Sensor(**cell["sensor"]))
    taken = take_snapshot(scene, whole, seed=cell["seed"])
    return reconstruct_snapshot(taken, "lmmse", prior=GaussianPrior.load(cell["prior"]), truth=scene).metrics
