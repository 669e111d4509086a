"""What codes are designed for: examples, noise and effort; designs are searched once and kept in files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import torch
from pydantic import Field

from tmca.attributes import Attributes, attributes_of, read_json
from tmca.cameras import CodedCamera, LightFieldCamera, SpectralCamera
from tmca.codes import BURST, read_codes, write_codes
from tmca.design.expected_error import TileMse, design_model
from tmca.design.kinds import designable
from tmca.design.search import Design, Effort, decibels, search
from tmca.design.transfer import Examples
from tmca.errors import DataError, SettingError
from tmca.priors import GaussianPrior
from tmca.sensor import Noise, Sensor

_STATIC = 7
"""Searches of which free codes of eight slots are the last."""
_LEAST = {"free": ("static", 1), "two-bucket": (BURST, 2), BURST: None}
"""What codes of the fewest slots contain, by their kind."""


@dataclass
class Task:
    """Searches and judgements of codes of one camera under one noise.

    Args:
        examples: scenes to design for.
        noise: in snapshot units.
        period: (rows, columns) of the tile of codes, pixels.
        effort: of every search.
        seed: of random codes.
        designs: folder where designs are kept.
        views: (V, U) of a light-field camera; None of a spectral one.
        identity: what names the kept files beside these: where the examples and the source of the numbers come from.
        static: times the descents of static codes; by default they have the effort of all that free codes contain.
    """

    examples: Examples
    noise: Noise
    period: tuple[int, int]
    effort: Effort
    seed: int
    designs: Path
    views: tuple[int, int] | None
    identity: Mapping[str, Any]
    static: int = _STATIC

    @classmethod
    def of(cls, cell: Mapping[str, Any], light: float | None = None) -> Task:
        """The task of a cell: its examples are read, its sensor's noise is worked out.

        Args:
            cell: ``examples`` (folder of `save_examples`), ``sensor`` (arguments of `Sensor`), ``exposures`` that are
                accumulated, ``period``, ``effort``, ``seed``, ``designs``, ``source``, ``views`` and ``static``.
            light: mean irradiance that the examples are dimmed to, or lit to as far as white; as they are if None.
        """
        folder, views = Path(cell["examples"]), cell.get("views")
        examples, identity = load_examples(folder, views), {"examples": folder.name, "source": cell["source"]}
        if light is not None:
            examples, identity = examples.under(min(light, examples.most_light)), {**identity, "light": light}
        noise, times = Sensor(**cell["sensor"]).noise(float(examples.model.block[0])), cell["exposures"]
        rows, columns = cell["period"]
        return cls(
            examples, Noise(noise.read / times, noise.shot / times), (int(rows), int(columns)),
            Effort(**cell["effort"]), int(cell["seed"]), Path(cell["designs"]),
            None if views is None else (int(views[0]), int(views[1])), identity, int(cell.get("static", _STATIC)),
        )  # fmt: skip

    @cached_property
    def bands(self) -> list[float]:
        """Wavelengths of the examples, metres; none of light fields."""
        return list(next(iter(self.examples.scenes.values())).wavelengths or ())

    @cached_property
    def camera(self) -> dict[str, Any]:
        """Arguments of `designable` that say which camera it is."""
        return camera_arguments(self.bands, self.views)

    @cached_property
    def error(self) -> TileMse:
        """What searches lower."""
        return self.examples.tile_mse(self.noise.read, self.noise.shot)

    def search(self, kind: str, slots: int, starts: Sequence[CodedCamera] = (), **effort: int) -> Design:
        """The best codes of a kind from given ones and from random ones, with the task's effort unless changed."""
        how: dict[str, Any] = {"effort": replace(self.effort, **effort), "seed": self.seed, **self.camera}
        return search(kind, slots, self.period, self.error, starts=starts, **how)

    def design(self, kind: str, slots: int) -> Design:
        """The best codes of a kind, searched once. Free ones, those of two buckets and bursts start from what they
        contain; static ones have as many descents as the free ones of eight slots with all that these contain, unless
        the task says otherwise."""
        file = self.file(kind, slots)
        if file.exists():
            return self._stored(file, kind)
        starts = [self.design(*other).camera for other in _contained(kind, slots)]
        more = {"descents": self.static * self.effort.descents} if kind == "static" else {}
        best = self.search(kind, slots, starts, **more)
        notes = {"mse": best.mse, "random": best.random, "seconds": best.seconds}
        codes = best.camera.codes
        planes, buckets = (codes.aperture.tile(), codes.shutter.tile()), best.camera.buckets
        write_codes(file, *planes, self.period, notes, buckets=buckets, overwrite=True)
        return best

    def seconds(self, kind: str, slots: int) -> dict[str, float]:
        """CPU seconds of the search for a design, and of those for all designs that it contains, kind by kind."""
        spent = {f"{kind} K = {slots}": self.design(kind, slots).seconds}
        for other in _contained(kind, slots):
            spent |= self.seconds(*other)
        return spent

    def file(self, kind: str, slots: int) -> Path:
        """Where the best codes of a kind are kept."""
        named = {"kind": kind, "slots": slots, "seed": self.seed, "effort": vars(self.effort), "period": self.period}
        named |= {"noise": vars(self.noise), **self.identity}
        named |= {} if self.static == _STATIC else {"static": self.static}
        digest = hashlib.sha256(json.dumps(named, sort_keys=True).encode()).hexdigest()[:20]
        return self.designs / f"{kind}-{slots}-{digest}.nc"

    def _stored(self, file: Path, kind: str) -> Design:
        from tmca.data import read_dataset

        notes = attributes_of(StoredDesign, read_dataset(file, ("aperture",)).attrs, file)
        codes = read_codes(file).settings()
        shown = _built(self.camera, size=self.period, **codes)
        camera = designable(kind, shown.slots, self.period, start=shown, **self.camera)
        return Design(kind, camera, notes.mse, notes.random, notes.seconds)

    def random(self, kind: str, slots: int) -> CodedCamera:
        """Random codes of a kind."""
        return designable(kind, slots, self.period, seed=self.seed, **self.camera)

    def psnr(self, camera: CodedCamera) -> float:
        """Expected, dB."""
        return decibels(self.error.whole(camera))

    def left_out(self, camera: CodedCamera) -> dict[str, float]:
        """PSNR of each example scene, estimated under the prior of the others, dB."""
        errors = self.examples.held_out(camera, self.noise.read, self.noise.shot)
        return {name: decibels(value) for name, value in errors.items()}


def _contained(kind: str, slots: int) -> list[tuple[str, int]]:
    """Kinds and slots of the designs that codes contain and start from, the freest of fewer slots among them."""
    if kind not in _LEAST:
        return []
    fewer = (kind, slots // 2) if slots % 2 == 0 and slots > 2 else _LEAST[kind]
    starts = [fewer] if fewer and slots % fewer[1] == 0 else []
    return [*starts, ("one-hot", slots)] if kind == "free" else starts


def camera_arguments(bands: Sequence[float], views: Sequence[int] | None) -> dict[str, Any]:
    """Arguments of `designable` that say which camera it is: its bands, or its views."""
    return {"bands": list(bands)} if views is None else {"camera_type": LightFieldCamera, "views": tuple(views)}


def _built(arguments: dict[str, Any], **settings: Any) -> CodedCamera:
    given: dict[str, Any] = {"camera_type": SpectralCamera, **arguments, **settings}
    camera: CodedCamera = given.pop("camera_type")(**given)
    return camera


def on_frame(camera: CodedCamera, arguments: dict[str, Any], size: tuple[int, int], sensor: Sensor) -> Any:
    """A camera of one period at the size of a scene, with fixed codes.

    Args:
        camera: whose codes are shown.
        arguments: of `camera_arguments`.
        size: (H, W) of the scene, pixels.
        sensor: of the frame.
    """
    codes = camera.codes
    shown: dict[str, Any] = {"slots": camera.slots, "period": camera.size, "sensor": sensor, "buckets": camera.buckets}
    shown |= {"aperture": codes.aperture.tile().detach(), "shutter": codes.shutter.tile().detach()}
    return _built(arguments, size=size, **shown)


def save_examples(examples: Examples, folder: Path) -> None:
    """A prior file for every scene; `load_examples` reads them."""
    from tmca.data import write_json

    for name, prior in examples.scenes.items():
        prior.save(folder / f"scene-{name}.nc", overwrite=True)
    write_json({"areas": examples.areas, "peaks": examples.peaks}, folder / "examples.json", overwrite=True)


def load_examples(folder: Path, views: Sequence[int] | None = None) -> Examples:
    """Examples that `save_examples` wrote; (V, U) views where they are light fields."""
    stored = _examples(folder / "examples.json")
    scenes = {name: GaussianPrior.load(folder / f"scene-{name}.nc") for name in stored.areas}
    bands = next(iter(scenes.values())).wavelengths
    try:
        one = designable("static", 1, (8, 8), **camera_arguments(bands or (), views))
    except SettingError as error:
        raise DataError(folder, f"examples of no camera ({error.where}: {error.found:.100})", error.expected) from None
    with torch.no_grad():
        return Examples(design_model(one.taps()), scenes, stored.areas, stored.peaks)


class StoredExamples(Attributes):
    """See `Examples`."""

    areas: dict[str, Annotated[int, Field(ge=1, lt=2**53)]] = Field(min_length=1)
    peaks: dict[str, Annotated[float, Field(ge=1e-12)]]


class StoredDesign(Attributes):
    """See `Design`."""

    mse: float = Field(ge=0)
    random: float = Field(ge=0)
    seconds: float = Field(ge=0)


def _examples(file: Path) -> StoredExamples:
    """Areas and peaks of the same scenes, whose names are names of files.

    Raises:
        DataError: anything else.
    """
    stored: StoredExamples = read_json(file, StoredExamples)
    if stored.areas.keys() != stored.peaks.keys():
        raise DataError(file, "areas and peaks of different scenes", "those of the same", "write the examples again")
    for name in stored.areas:
        if Path(f"scene-{name}").name != f"scene-{name}" or "\0" in name:
            raise DataError(file, f"a scene {name[:40]!r}", "the name of a file beside it", "write the examples again")
    return stored
