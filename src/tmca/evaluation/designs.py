"""Searched codes of spectral and light-field cameras: examples, noise, and designs that are searched once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.cameras import CodedCamera, LightFieldCamera, SpectralCamera
from tmca.codes import read_codes, write_codes
from tmca.design import Design, Effort, Examples, TileMse, decibels, design_model, designable, learn_examples, search
from tmca.evaluation.grid import Measured, Settings, cell_key
from tmca.priors import GaussianPrior
from tmca.sensor import Noise, Sensor

if TYPE_CHECKING:
    import xarray as xr

_STATIC = 7
"""Searches of which free codes of eight slots are the last."""


class Task:
    """Searches and judgements of one cell.

    Args:
        examples: scenes to design for.
        noise: in snapshot units.
        cell: period, effort and seed; ``designs``, a folder of designs; ``views`` of a light-field camera.
    """

    def __init__(self, examples: Examples, noise: Noise, cell: Settings) -> None:
        self.examples, self.noise, self.cell = examples, noise, cell
        self.period = (int(cell["period"][0]), int(cell["period"][1]))
        self.effort, self.seed = Effort(**cell["effort"]), int(cell["seed"])
        self.bands = list(next(iter(examples.scenes.values())).wavelengths or ())
        self.camera = camera_arguments(self.bands, cell.get("views"))

    @classmethod
    def of(cls, cell: Settings, light: float | None = None) -> Task:
        """The task of a cell: its examples are read, its sensor's noise is worked out.

        Args:
            cell: settings.
            light: mean irradiance that the examples are dimmed to, or lit to as far as white; as they are if None.
        """
        found = load_examples(Path(cell["examples"]), cell.get("views"))
        if light is not None:
            found, cell = found.under(min(light, found.most_light)), {**cell, "under": light}
        noise, times = Sensor(**cell["sensor"]).noise(float(found.model.block[0])), cell["exposures"]
        return cls(found, Noise(noise.read / times, noise.shot / times), cell)

    @cached_property
    def error(self) -> TileMse:
        """What searches lower."""
        return self.examples.tile_mse(self.noise.read, self.noise.shot)

    def search(self, kind: str, slots: int, starts: Sequence[CodedCamera] = (), **effort: int) -> Design:
        """The best codes of a kind from given ones and from random ones, with the cell's effort unless changed."""
        own = replace(self.effort, **effort)
        return search(kind, slots, self.period, self.error, starts=starts, effort=own, seed=self.seed, **self.camera)

    def design(self, kind: str, slots: int) -> Design:
        """The best codes of a kind, searched once. Free ones contain the others, and static ones have as many descents
        as the free ones of eight slots with all that they contain: the same effort for both."""
        file = self.file(kind, slots)
        if file.exists():
            return self._stored(file, kind)
        starts = [self.design(*other).camera for other in _contained(slots)] if kind == "free" else []
        more = {"descents": _STATIC * self.effort.descents} if kind == "static" else {}
        best = self.search(kind, slots, starts, **more)
        notes = {"mse": best.mse, "random": best.random, "seconds": best.seconds}
        codes = best.camera.codes
        write_codes(file, codes.aperture.tile(), codes.shutter.tile(), self.period, notes, overwrite=True)
        return best

    def seconds(self, kind: str, slots: int) -> dict[str, float]:
        """CPU seconds of the search for a design, and of those for all designs that it contains, kind by kind."""
        found = {f"{kind} K = {slots}": self.design(kind, slots).seconds}
        for other in _contained(slots) if kind == "free" else ():
            found |= self.seconds(*other)
        return found

    def file(self, kind: str, slots: int) -> Path:
        """Of the best codes of a kind."""
        own = {"kind": kind, "slots": slots, "seed": self.seed, "effort": vars(self.effort), "period": self.period}
        own |= {"examples": Path(self.cell["examples"]).name, "noise": vars(self.noise)}
        own |= {"light": self.cell["under"]} if "under" in self.cell else {}
        return Path(self.cell["designs"]) / f"{kind}-{slots}-{cell_key(own)}.nc"

    def _stored(self, file: Path, kind: str) -> Design:
        from tmca.data import read_dataset

        notes, codes = read_dataset(file, ("aperture",)).attrs, read_codes(file).settings()
        shown = _built(self.camera, size=self.period, **codes)
        camera = designable(kind, shown.slots, self.period, start=shown, **self.camera)
        return Design(kind, camera, float(notes["mse"]), float(notes["random"]), float(notes["seconds"]))

    def random(self, kind: str, slots: int) -> CodedCamera:
        """Random codes of a kind."""
        return designable(kind, slots, self.period, seed=self.seed, **self.camera)

    def psnr(self, camera: CodedCamera) -> float:
        """Expected, dB."""
        return decibels(self.error.whole(camera))

    def left_out(self, camera: CodedCamera) -> dict[str, float]:
        """PSNR of each example scene, estimated under the prior of the others, dB."""
        found = self.examples.held_out(camera, self.noise.read, self.noise.shot)
        return {name: decibels(value) for name, value in found.items()}


def _contained(slots: int) -> list[tuple[str, int]]:
    """Kinds and slots of the designs that free codes contain and start from, the freest of fewer slots among them."""
    fewer = ("free", slots // 2) if slots % 2 == 0 and slots > 2 else ("static", 1)
    return [fewer, ("one-hot", slots)]


def mean(values: dict[str, float]) -> float:
    """Over scenes."""
    return float(np.mean(list(values.values())))


def camera_arguments(bands: Sequence[float], views: Sequence[int] | None) -> dict[str, Any]:
    """Arguments of ``designable`` that say which camera it is: its bands, or its views."""
    return {"bands": list(bands)} if views is None else {"camera_type": LightFieldCamera, "views": tuple(views)}


def _built(arguments: dict[str, Any], **settings: Any) -> CodedCamera:
    own: dict[str, Any] = {"camera_type": SpectralCamera, **arguments, **settings}
    camera: CodedCamera = own.pop("camera_type")(**own)
    return camera


def on_frame(camera: CodedCamera, arguments: dict[str, Any], size: tuple[int, int], sensor: Sensor) -> Any:
    """A camera of one period at the size of a scene, with fixed codes; ``camera_arguments`` say which one."""
    codes = camera.codes
    own: dict[str, Any] = {"slots": camera.slots, "period": camera.size, "sensor": sensor}
    own |= {"aperture": codes.aperture.tile().detach(), "shutter": codes.shutter.tile().detach()}
    return _built(arguments, size=size, **own)


def save_examples(examples: Examples, folder: Path) -> None:
    """A prior file for every scene; ``load_examples`` reads them."""
    from tmca.data import write_json

    for name, prior in examples.scenes.items():
        prior.save(folder / f"scene-{name}.nc", overwrite=True)
    write_json({"areas": examples.areas, "peaks": examples.peaks}, folder / "examples.json", overwrite=True)


def load_examples(folder: Path, views: Sequence[int] | None = None) -> Examples:
    """Examples that ``save_examples`` wrote; (V, U) views where they are light fields."""
    import json

    stored = json.loads((folder / "examples.json").read_text())
    scenes = {name: GaussianPrior.load(folder / f"scene-{name}.nc") for name in stored["areas"]}
    bands = next(iter(scenes.values())).wavelengths
    one = designable("static", 1, (8, 8), **camera_arguments(bands or (), views))
    with torch.no_grad():
        return Examples(design_model(one.taps()), scenes, stored["areas"], stored["peaks"])


def learn_examples_of(scenes: Mapping[str, xr.DataArray], folder: Path) -> None:
    """Examples of cubes or light fields, by their short names, that codes are searched for."""
    from tmca.data import make_folder
    from tmca.priors import views_of

    first = next(iter(scenes.values()))
    if "view_v" in first.dims:
        grid = (first.sizes["view_v"], first.sizes["view_u"])
        model = design_model(designable("static", 1, (8, 8), **camera_arguments((), grid)).taps())
        cubes = {name.replace("/", "-"): views_of(field)[0].flatten(0, 1) for name, field in scenes.items()}
        examples = learn_examples(cubes, model, None, views=grid)
    else:
        wavelengths = first["wavelength"].values.tolist()
        model = design_model(designable("static", 1, (8, 8), bands=wavelengths).taps())
        cubes = {name.replace("/", "-"): torch.from_numpy(cube.values.copy()) for name, cube in scenes.items()}
        examples = learn_examples(cubes, model, wavelengths)
    save_examples(examples, make_folder(folder))


def searched(cell: Settings) -> Measured:
    """The codes of a search, and with ``gains`` their expected PSNR, that of random codes, and what they gain over the
    static design when each example is estimated under the prior of the others."""
    task, kind, slots = Task.of(cell), cell["kind"], int(cell["slots"])
    design = task.design(kind, slots)
    found: Measured = {"codes": str(task.file(kind, slots)), "seconds": sum(task.seconds(kind, slots).values())}
    if not cell.get("gains"):
        return found
    own, base = task.left_out(design.camera), task.left_out(task.design("static", 1).camera)
    return found | {
        "psnr": design.psnr, "random_psnr": task.psnr(task.random(kind, slots)),
        "throughput": design.camera.throughput(), "gains": {name: own[name] - base[name] for name in own},
    }  # fmt: skip
