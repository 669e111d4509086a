"""What each ingredient of a design contributes: planes, starts, optimiser, noise, period and example scenes."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

from tmca.cameras import SpectralCamera
from tmca.design import Descent, Examples, MixtureTileMse, descend, flip_greedily
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.codes.task import Task, load_examples, mean
from tmca.priors import GaussianMixturePrior
from tmca.sensor import Noise

Made = Callable[[Task, int], SpectralCamera]


def ablation(cell: Settings) -> Measured:
    """Gain over the static design, expected and on scenes left out, of codes that lack or add one ingredient."""
    task, slots = Task.of(cell), int(cell["slots"][0])
    static = task.design("static", 1).camera
    base, base_left = task.psnr(static), mean(task.left_out(static))
    rows = []
    for name, made in INGREDIENTS.items():
        camera = made(task, slots)
        gains = {"gain": task.psnr(camera) - base, "held_out": mean(task.left_out(camera)) - base_left}
        rows.append({"ingredient": name, **gains, "throughput": camera.throughput()})
    return {"rows": rows}


def _random(kind: str) -> Made:
    return lambda task, slots: task.random(kind, 1 if kind == "static" else slots)


def _designed(kind: str) -> Made:
    return lambda task, slots: task.design(kind, 1 if kind == "static" else slots).camera


def _free_from(kind: str | None) -> Made:
    def made(task: Task, slots: int) -> SpectralCamera:
        return task.search("free", slots, _designed(kind)(task, slots) if kind else None).camera

    return made


def _flipped(kind: str) -> Made:
    def made(task: Task, slots: int) -> SpectralCamera:
        camera = deepcopy(_designed(kind)(task, slots))
        flip_greedily(camera, task.error, most=task.effort.flips, seed=task.seed)
        return camera

    return made


def _relaxed(task: Task, slots: int) -> SpectralCamera:
    camera = task.random("free", slots)
    descend(camera, task.error, Descent(steps=task.effort.steps, relaxed=True, seed=task.seed))
    return camera


def _without_noise(task: Task, slots: int) -> SpectralCamera:
    return Task(task.examples, Noise(0.0, 0.0), task.cell).search("free", slots).camera


def _of_period(rows: int, columns: int) -> Made:
    def made(task: Task, slots: int) -> SpectralCamera:
        other = Task(task.examples, task.noise, {**task.cell, "period": (rows, columns)})
        return other.search("free", slots).camera

    return made


def _for_scenes(choose: Callable[[str, Examples], bool]) -> Made:
    """Designed for a choice of the given and the rendered scenes."""

    def made(task: Task, slots: int) -> SpectralCamera:
        wide = load_examples(Path(task.cell["wide"]))
        chosen = {name: prior for name, prior in wide.scenes.items() if choose(name, task.examples)}
        return Task(Examples(wide.model, chosen, wide.areas), task.noise, task.cell).search("free", slots).camera

    return made


def _for_mixture(task: Task, slots: int) -> SpectralCamera:
    prior = GaussianMixturePrior.load(task.cell["mixture"])
    error = MixtureTileMse.of(prior, task.examples.model, task.noise.read, task.noise.shot)
    camera = task.random("free", slots)
    descend(camera, error, Descent(steps=task.effort.steps, seed=task.seed))
    return camera


INGREDIENTS: dict[str, Made] = {
    "static, random": _random("static"),
    "static, designed": _designed("static"),
    "static, designed, then flips": _flipped("static"),
    "K apertures, shutter open, designed": _designed("open-shutter"),
    "one aperture, K shutters, designed": _designed("static-aperture"),
    "one-hot shutter, random": _random("one-hot"),
    "one-hot shutter, designed": _designed("one-hot"),
    "free, random": _random("free"),
    "free, from random codes": _free_from(None),
    "free, from the static design": _free_from("static"),
    "free, from the one-hot design": _free_from("one-hot"),
    "free, best of the three": _designed("free"),
    "free, best of the three, then flips": _flipped("free"),
    "free, from random, grey codes that become binary": _relaxed,
    "free, from random, designed as if without noise": _without_noise,
    "free, from random, for a Gaussian mixture": _for_mixture,
    "free, from random, tile of 8×12": _of_period(8, 12),
    "free, from random, tile of 32×48": _of_period(32, 48),
    "free, from random, rendered scenes among the examples": _for_scenes(lambda name, own: True),
    "free, from random, for rendered scenes alone": _for_scenes(lambda name, own: name not in own.scenes),
}
"""Codes with K slots, unless static; tiles, starts and scenes are those of the study where nothing is said."""
