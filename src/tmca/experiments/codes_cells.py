"""The cells of the study of codes: searches under one noise, designs on test scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.cameras import SpectralCamera
from tmca.design import Design, Effort, Examples, TileMse, design_model, designable, search
from tmca.design.search import decibels
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.scenes import load_scene
from tmca.priors import GaussianPrior
from tmca.sensor import Noise, Sensor

SLOTS = (2, 4, 8, 16)


def compute(cell: Settings) -> Measured:
    """One cell of any kind."""
    from tmca.experiments.codes_ranking import ranking

    return {"grid": grid, "test": on_test_scenes, "ranking": ranking}[cell["kind"]](cell)


def grid(cell: Settings) -> Measured:
    """The static design, and random, one-hot and free codes of every number of slots, under one noise."""
    task = Task.of(cell)
    static = task.search("static", 1)
    rows = [task.row("static", static, static)]
    for slots in cell["slots"]:
        one_hot = task.search("one-hot", slots)
        free = task.best_free(slots, [static.camera, one_hot.camera])
        rows += [task.row("one-hot", one_hot, static), task.row("free", free, static)]
    return {"rows": rows}


def on_test_scenes(cell: Settings) -> Measured:
    """PSNR of the LMMSE on one test scene behind random and designed codes, static and time-multiplexed."""
    from tmca.experiments.spectral import reconstruct_snapshot, take_snapshot

    task = Task.of(cell)
    static = task.search("static", 1)
    designs = {"static": static}
    for slots in cell["slots"]:
        designs["one-hot"] = task.search("one-hot", slots)
        starts = [static.camera, designs["one-hot"].camera]
        designs["free"] = task.best_free(slots, starts)
    scene, found = load_scene(cell["path"], bands=cell["bands"]), {}
    size, prior = (scene.sizes["y"], scene.sizes["x"]), GaussianPrior.load(cell["prior"])
    for kind, design in designs.items():
        for name, camera in (("designed", design.camera), ("random", task.random(kind, design.slots))):
            whole = on_frame(camera, task.bands, size, Sensor(**cell["sensor"]))
            taken = take_snapshot(scene, whole, seed=cell["seed"])
            metrics = reconstruct_snapshot(taken, "lmmse", prior=prior, truth=scene).metrics
            expected = decibels(task.error.whole(camera))
            found[f"{kind}, {name}"] = {**metrics, "expected_psnr": expected, "throughput": whole.throughput()}
    return {"metrics": found}


def on_frame(camera: SpectralCamera, bands: list[float], size: tuple[int, int], sensor: Sensor) -> SpectralCamera:
    """A camera of one period at the size of a scene, with fixed codes."""
    codes = camera.multiplexed
    aperture, shutter = codes.aperture.tile().detach(), codes.shutter.tile().detach()
    return SpectralCamera(
        bands=bands,
        size=size,
        slots=camera.slots,
        period=camera.size,
        sensor=sensor,
        aperture=aperture,
        shutter=shutter,
    )


class Task:
    """What the searches of a cell share.

    Args:
        examples: scenes to design for.
        noise: in snapshot units.
        cell: period, effort, seed and bands.
    """

    def __init__(self, examples: Examples, noise: Noise, cell: Settings) -> None:
        self.examples, self.noise, self.cell = examples, noise, cell
        self.period = (int(cell["period"][0]), int(cell["period"][1]))
        self.error: TileMse = examples.tile_mse(noise.read, noise.shot)
        self.bands = list(next(iter(examples.scenes.values())).wavelengths or ())

    @classmethod
    def of(cls, cell: Settings) -> Task:
        """The task of a cell: its examples are read, its sensor's noise is worked out."""
        examples = load_examples(Path(cell["examples"]))
        noise, times = Sensor(**cell["sensor"]).noise(float(examples.model.block[0])), cell["exposures"]
        return cls(examples, Noise(noise.read / times, noise.shot / times), cell)

    def search(self, kind: str, slots: int, start: SpectralCamera | None = None) -> Design:
        """The best codes of a kind."""
        effort = Effort(**self.cell["effort"])
        seed = self.cell["seed"]
        return search(kind, slots, self.period, self.error, effort=effort, seed=seed, start=start, bands=self.bands)

    def best_free(self, slots: int, starts: Sequence[SpectralCamera]) -> Design:
        """The best free codes from random ones and from other designs, which they contain."""
        return min((self.search("free", slots, start) for start in (None, *starts)), key=lambda design: design.mse)

    def random(self, kind: str, slots: int) -> SpectralCamera:
        """Random codes of a kind."""
        return designable(kind, slots, self.period, seed=self.cell["seed"], bands=self.bands)

    def row(self, kind: str, design: Design, static: Design) -> dict[str, Any]:
        """Expected PSNR, and PSNR on scenes left out, of a design and of random codes of its kind."""
        random = self.random(kind, design.slots)
        return {
            "kind": kind, "slots": design.slots, "psnr": design.psnr, "random_psnr": decibels(self.error.whole(random)),
            "gain": design.psnr - static.psnr, "held_out_psnr": self._held_out(design.camera),
            "held_out_random": self._held_out(random),
            "held_out_gains": self._gains(design.camera, static.camera),
            "throughput": design.camera.throughput(), "seconds": design.seconds,
        }  # fmt: skip

    def _held_out(self, camera: SpectralCamera) -> float:
        found = self.examples.held_out(camera, self.noise.read, self.noise.shot)
        return float(np.mean([decibels(value) for value in found.values()]))

    def _gains(self, camera: SpectralCamera, static: SpectralCamera) -> dict[str, float]:
        own, base = (self.examples.held_out(c, self.noise.read, self.noise.shot) for c in (camera, static))
        return {name: decibels(own[name]) - decibels(base[name]) for name in own}


def save_examples(examples: Examples, folder: Path) -> None:
    """A prior file for every scene; ``load_examples`` reads them."""
    from tmca.data import write_json

    for name, prior in examples.scenes.items():
        prior.save(folder / f"scene-{name}.nc", overwrite=True)
    write_json({"areas": examples.areas}, folder / "examples.json", overwrite=True)


def load_examples(folder: Path) -> Examples:
    """Examples that ``save_examples`` wrote."""
    import json

    areas = json.loads((folder / "examples.json").read_text())["areas"]
    scenes = {name: GaussianPrior.load(folder / f"scene-{name}.nc") for name in areas}
    bands = next(iter(scenes.values())).wavelengths
    one = designable("static", 1, (8, 8), bands=list(bands or ()))
    with torch.no_grad():
        return Examples(design_model(one.taps()), scenes, areas)
