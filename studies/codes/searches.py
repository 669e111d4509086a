"""Designs over noise and slots: their expected gain, and their gain on test scenes."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import tmca
from studies.codes.records import Cell, Figures, GridRow, LightRow, TestRow
from tmca.cameras import CodedCamera
from tmca.data import load_scene
from tmca.design import Design, Task, camera_arguments, decibels, on_frame
from tmca.metrics import all_metrics
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor


def task_of(cell: Cell, light: float | None = None) -> Task:
    """The searches of a cell, its examples dimmed to a mean irradiance if one is given."""
    return Task.of(asdict(cell), light)


def sensor_of(cell: Cell) -> Sensor:
    """The sensor behind the codes."""
    given: dict[str, Any] = dict(cell.sensor)
    return Sensor(**given)


def grid(cell: Cell) -> list[GridRow]:
    """The static design, and one-hot and free designs of every number of slots, under one noise."""
    task = task_of(cell)
    static = task.design("static", 1)
    base = task.left_out(static.camera)
    designs = [static, *(task.design(kind, slots) for slots in cell.slots for kind in ("one-hot", "free"))]
    return [_row(cell, task, design, static, base) for design in designs]


def _row(cell: Cell, task: Task, design: Design, static: Design, base: Figures) -> GridRow:
    """Expected PSNR, and PSNR under the prior of the other scenes, of a design and of random codes of its kind."""
    left_out, random = task.left_out(design.camera), task.random(design.kind, design.slots)
    return {
        "noise": cell.noise, "exposures": cell.exposures, "kind": design.kind, "slots": design.slots,
        "psnr": design.psnr, "random_psnr": decibels(design.random), "gain": design.psnr - static.psnr,
        "held_out_psnr": mean(left_out), "held_out_random": mean(task.left_out(random)),
        "held_out_gains": {name: left_out[name] - base[name] for name in left_out},
        "throughput": design.camera.throughput(), "seconds": design.seconds,
    }  # fmt: skip


def design_ahead(cell: Cell) -> list[Figures]:
    """Designs that other cells will ask for."""
    return [{"seconds": task_of(cell).design("free", cell.slots[0]).seconds}]


def on_test_scene(cell: Cell) -> list[TestRow]:
    """PSNR of the LMMSE on one test scene behind random and designed codes, static and time-multiplexed."""
    task = task_of(cell)
    metrics = _compared(cell, task, _cameras(task, cell.slots[0]), GaussianPrior.load(cell.prior))
    return [{"noise": cell.noise, "scene": Path(cell.test[0]).stem, "seed": cell.seed, "metrics": metrics}]


def in_the_light(cell: Cell) -> list[LightRow]:
    """What the mean irradiance of test scenes changes where the examples are dimmed to it: the gains predicted for each
    scene's own, and codes designed for that of all, decoded by the prior as it was learned and by one dimmed alike."""
    assert cell.light is not None
    scene, slots = load_scene(cell.test[0], bands=cell.bands), cell.slots[0]
    there, lit = task_of(cell, float(scene.mean())), task_of(cell, cell.light)
    cameras, prior = _cameras(task_of(cell), slots), GaussianPrior.load(cell.prior)
    dimmed = prior.scaled(cell.light / float(prior.mean.mean()))
    designs = {f"{kind}, designed for the light": lit.design(kind, k).camera
               for kind, k in {"static": 1, "free": slots}.items()}  # fmt: skip
    row: LightRow = {
        "noise": cell.noise, "scene": Path(cell.test[0]).stem, "seed": cell.seed,
        "metrics": _compared(cell, lit, designs, dimmed),
        "plain_prior": {name: _measured(cell, camera, prior) for name, camera in designs.items()},
        "there": _predicted(there, cameras) | _predicted(there, designs),
    }  # fmt: skip
    return [row]


def _cameras(task: Task, slots: int) -> dict[str, CodedCamera]:
    """Designed and random codes of every kind; the designed static ones first."""
    cameras: dict[str, CodedCamera] = {}
    for kind, k in {"static": 1, "one-hot": slots, "free": slots}.items():
        cameras[f"{kind}, designed"] = task.design(kind, k).camera
        cameras[f"{kind}, random"] = task.random(kind, k)
    return cameras


def _predicted(task: Task, cameras: dict[str, CodedCamera]) -> Figures:
    """Gain of cameras over the first of them under the prior of the other examples, dB."""
    base, gains = task.left_out(next(iter(cameras.values()))), {}
    for name, camera in cameras.items():
        left_out = task.left_out(camera)
        gains[name] = mean({scene: left_out[scene] - base[scene] for scene in left_out})
    return gains


def _compared(cell: Cell, task: Task, cameras: dict[str, CodedCamera], prior: GaussianPrior) -> dict[str, Figures]:
    """What cameras reach on the scene, and what was expected and predicted of them."""
    predicted = _predicted(task, cameras)
    return {
        name: {**_measured(cell, camera, prior), "expected_psnr": task.psnr(camera), "predicted_gain": predicted[name],
               "throughput": camera.throughput()}
        for name, camera in cameras.items()
    }  # fmt: skip


def _measured(cell: Cell, camera: CodedCamera, prior: GaussianPrior) -> Figures:
    scene = load_scene(cell.test[0], bands=cell.bands)
    bands = camera_arguments(scene["wavelength"].values.tolist(), None)
    whole = on_frame(camera, bands, (scene.sizes["y"], scene.sizes["x"]), sensor_of(cell))
    snapshot = tmca.simulate(scene, whole, seed=cell.seed)
    return all_metrics(tmca.reconstruct(snapshot, "lmmse", prior=prior).values[0].numpy(), scene.values)


def mean(values: Figures) -> float:
    """Over scenes."""
    return float(np.mean(list(values.values())))
