"""What each ingredient of a design contributes: planes, starts, optimiser, noise, period and example scenes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tmca.cameras import CodedCamera
from tmca.design import Descent, Examples, MixtureMse, TileMse, descend
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.codes.task import Task, load_examples, mean
from tmca.priors import GaussianMixturePrior
from tmca.sensor import Noise

Made = Callable[[Task, int], CodedCamera]


def ablation(cell: Settings) -> Measured:
    """Gain over the static design of codes that lack or add one ingredient, expected and under other scenes' prior."""
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


def _free_from(*kinds: str) -> Made:
    """Free codes from one start, or from random codes without any."""

    def made(task: Task, slots: int) -> CodedCamera:
        starts = [_designed(kind)(task, slots) for kind in kinds]
        return task.search("free", slots, starts, descents=1, flips=0).camera

    return made


def _relaxed(task: Task, slots: int) -> CodedCamera:
    camera = task.random("free", slots)
    descend(camera, task.error, Descent(steps=task.effort.steps, relaxed=True, seed=task.seed))
    return camera


def _without_noise(task: Task, slots: int) -> CodedCamera:
    return _free_from()(Task(task.examples, Noise(0.0, 0.0), task.cell), slots)


def _of_period(rows: int, columns: int) -> Made:
    return lambda task, slots: _free_from()(
        Task(task.examples, task.noise, {**task.cell, "period": (rows, columns)}), slots
    )


def _for_scenes(choose: Callable[[str, Examples], bool]) -> Made:
    """Designed for a choice of the given and the rendered scenes."""

    def made(task: Task, slots: int) -> CodedCamera:
        wide = load_examples(Path(task.cell["wide"]))
        chosen = {name: prior for name, prior in wide.scenes.items() if choose(name, task.examples)}
        own = Examples(wide.model, chosen, wide.areas, wide.peaks)
        return _free_from()(Task(own, task.noise, task.cell), slots)

    return made


def _for_mixture(task: Task, slots: int) -> CodedCamera:
    prior = GaussianMixturePrior.load(task.cell["mixture"])
    error = TileMse(MixtureMse.of(prior, task.examples.model, task.noise.read, task.noise.shot))
    camera = task.random("free", slots)
    descend(camera, error, Descent(steps=task.effort.steps, seed=task.seed))
    return camera


INGREDIENTS: dict[str, Made] = {
    "static, random": _random("static"),
    "static, one descent": lambda task, slots: task.search("static", 1, descents=1, flips=0).camera,
    "static, designed": _designed("static"),
    "K apertures, shutter open, designed": _designed("open-shutter"),
    "one aperture, K shutters, designed": _designed("static-aperture"),
    "one-hot shutter, random": _random("one-hot"),
    "one-hot shutter, designed": _designed("one-hot"),
    "free, random": _random("free"),
    "free, one descent from random codes": _free_from(),
    "free, one descent from the static design": _free_from("static"),
    "free, one descent from the one-hot design": _free_from("one-hot"),
    "free, one descent from random codes, then flips": lambda task, slots: (
        task.search("free", slots, descents=1).camera
    ),
    "free, designed": _designed("free"),
    "free, one descent, grey codes that become binary": _relaxed,
    "free, one descent, as if without noise": _without_noise,
    "free, one descent, for a Gaussian mixture": _for_mixture,
    "free, one descent, tile of 8×12": _of_period(8, 12),
    "free, one descent, tile of 32×48": _of_period(32, 48),
    "free, one descent, rendered scenes among the examples": _for_scenes(lambda name, own: True),
    "free, one descent, for rendered scenes alone": _for_scenes(lambda name, own: name not in own.scenes),
}
"""Codes with K slots, unless static; tiles, starts and scenes are those of the study where nothing is said."""
