"""What each ingredient of a design contributes: planes, starts, optimiser, noise, period and example scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from studies.codes.records import AblationRow, Cell, IngredientRow
from studies.codes.searches import mean, task_of
from tmca.cameras import CodedCamera
from tmca.design import Descent, Examples, MixtureMse, Task, TileMse, descend, load_examples
from tmca.priors import GaussianMixturePrior
from tmca.sensor import Noise

Made = Callable[[Task, Cell], CodedCamera]


def ablation(cell: Cell) -> list[AblationRow]:
    """Gain over the static design of codes that lack or add one ingredient, expected and under other scenes' prior."""
    task = task_of(cell)
    static = task.design("static", 1).camera
    base, base_left = task.psnr(static), mean(task.left_out(static))
    rows: list[IngredientRow] = []
    for name, made in INGREDIENTS.items():
        camera = made(task, cell)
        gain, held_out = task.psnr(camera) - base, mean(task.left_out(camera)) - base_left
        rows.append({"ingredient": name, "gain": gain, "held_out": held_out, "throughput": camera.throughput()})
    return [{"noise": cell.noise, "rows": rows}]


def _slots(kind: str, cell: Cell) -> int:
    return 1 if kind == "static" else cell.slots[0]


def _random(kind: str) -> Made:
    return lambda task, cell: task.random(kind, _slots(kind, cell))


def _designed(kind: str) -> Made:
    return lambda task, cell: task.design(kind, _slots(kind, cell)).camera


def _free(task: Task, cell: Cell, *starts: CodedCamera) -> CodedCamera:
    """Free codes by one descent, from given ones or from random ones."""
    return task.search("free", cell.slots[0], starts, descents=1, flips=0).camera


def _free_from(kind: str) -> Made:
    return lambda task, cell: _free(task, cell, _designed(kind)(task, cell))


def _of_period(rows: int, columns: int) -> Made:
    return lambda task, cell: _free(replace(task, period=(rows, columns)), cell)


def _relaxed(task: Task, cell: Cell) -> CodedCamera:
    camera = task.random("free", cell.slots[0])
    descend(camera, task.error, Descent(steps=task.effort.steps, relaxed=True, seed=task.seed))
    return camera


def _for_scenes(choose: Callable[[str, Examples], bool]) -> Made:
    """Designed for a choice of the given and the rendered scenes."""

    def made(task: Task, cell: Cell) -> CodedCamera:
        wide = load_examples(Path(cell.wide))
        chosen = {name: prior for name, prior in wide.scenes.items() if choose(name, task.examples)}
        return _free(replace(task, examples=replace(wide, scenes=chosen)), cell)

    return made


def _for_mixture(task: Task, cell: Cell) -> CodedCamera:
    prior = GaussianMixturePrior.load(cell.mixture)
    error = TileMse(MixtureMse.of(prior, task.examples.model, task.noise.read, task.noise.shot))
    camera = task.random("free", cell.slots[0])
    descend(camera, error, Descent(steps=task.effort.steps, seed=task.seed))
    return camera


INGREDIENTS: dict[str, Made] = {
    "static, random": _random("static"),
    "static, one descent": lambda task, cell: task.search("static", 1, descents=1, flips=0).camera,
    "static, designed": _designed("static"),
    "K apertures, shutter open, designed": _designed("open-shutter"),
    "one aperture, K shutters, designed": _designed("static-aperture"),
    "one-hot shutter, random": _random("one-hot"),
    "one-hot shutter, designed": _designed("one-hot"),
    "free, random": _random("free"),
    "free, one descent from random codes": _free,
    "free, one descent from the static design": _free_from("static"),
    "free, one descent from the one-hot design": _free_from("one-hot"),
    "free, one descent from random codes, then flips": lambda task, cell: (
        task.search("free", cell.slots[0], descents=1).camera
    ),
    "free, designed": _designed("free"),
    "free, one descent, grey codes that become binary": _relaxed,
    "free, one descent, as if without noise": lambda task, cell: _free(replace(task, noise=Noise(0.0, 0.0)), cell),
    "free, one descent, for a Gaussian mixture": _for_mixture,
    "free, one descent, tile of 8×12": _of_period(8, 12),
    "free, one descent, tile of 32×48": _of_period(32, 48),
    "free, one descent, rendered scenes among the examples": _for_scenes(lambda name, given: True),
    "free, one descent, for rendered scenes alone": _for_scenes(lambda name, given: name not in given.scenes),
}
"""Codes with K slots, unless static; tiles, starts and scenes are those of the study where nothing is said."""
