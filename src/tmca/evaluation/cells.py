"""The cells of studies and sweeps of every camera: priors, searched codes, trained networks, measurements."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter
from zlib import crc32

import numpy as np
from pydantic import BaseModel, ConfigDict

from tmca.applications import simulate
from tmca.applications.moving import FRAMES, frame_pairs, frames_of, mean_of
from tmca.cameras import CAMERAS, Hardware, in_finer_time
from tmca.decoders import Estimate, OtherCodes, decode, decoders
from tmca.devices import computing_on
from tmca.evaluation.camera import CameraEvaluation, evaluation_of
from tmca.evaluation.grid import Measured, Settings, cell_key
from tmca.lab.decoder_files import decoder_named
from tmca.plugins import foreign_source
from tmca.priors import prior_kinds


class Cell(BaseModel, ABC):
    """What is computed once; its fields are JSON values, and ``step`` says which kind of cell it is.

    Args:
        name: shown while it is computed.
        camera: kind of the camera.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    step: str
    name: str
    camera: str

    @abstractmethod
    def compute(self, evaluation: CameraEvaluation, folder: Path) -> Measured:
        """Measured values, JSON; ``folder`` takes files."""

    @property
    def key(self) -> str:
        """Digest of all of it, and of the source of the classes of other packages that it needs."""
        return cell_key(self.model_dump(mode="json"), self.foreign)

    @property
    def foreign(self) -> list[str]:
        """The source of the classes of other packages that it needs."""
        return [source for cls in self._classes() if (source := foreign_source(cls))]  # type: ignore[arg-type]

    def _classes(self) -> list[type[Any]]:
        """Those that its camera, decoder and prior are of."""
        evaluation = evaluation_of(self.camera)
        cls = decoders().get(getattr(self, "decoder", ""))
        kind: str = getattr(self, "prior_kind", None) or (cls and cls.prior_kind) or ""
        camera = (CAMERAS[self.camera], type(evaluation.application), type(evaluation))
        return [one for one in (*camera, cls, prior_kinds().get(kind)) if one is not None]


class LearnedPrior(Cell):
    """A prior of some scenes: ``{"prior": file}``.

    Args:
        prior_kind: ``"gaussian"``, ``"mixture"``, ``"dictionary"`` or ``"examples"`` (what codes are searched for).
        scenes: names.
        identities: what tells that their files have changed.
        reading: how they are read.
        settings: of ``learn_prior``.
    """

    step: str = "prior"
    prior_kind: str
    scenes: tuple[str, ...]
    identities: tuple[Any, ...]
    reading: Settings
    settings: Settings = {}

    def compute(self, evaluation: CameraEvaluation, folder: Path) -> Measured:
        return {"prior": str(evaluation.learn(self.model_dump(), folder / f"prior-{self.prior_kind}-{self.key}"))}


class Search(Cell):
    """Codes of least expected error: ``codes``, their file, and ``seconds``.

    Args:
        code: name of the codes.
        noise: name of the noise that they are for.
        sensor: of that noise.
        seed: of the search.
        settings: what the camera's search takes.
    """

    step: str = "search"
    code: str
    noise: str
    sensor: Settings
    seed: int
    settings: Settings

    def compute(self, evaluation: CameraEvaluation, folder: Path) -> Measured:
        return evaluation.search(self.model_dump(), folder)


class Training(Cell):
    """A network, and codes if they learn: ``weights``, their file, ``best`` validation figures and CPU ``seconds``.

    Args:
        code, decoder, seed: of the row.
        training: settings of the run.
        reading: how its scenes are read.
        identities: what tells that their files have changed.
    """

    step: str = "training"
    code: str = ""
    decoder: str
    seed: int = 0
    training: Settings
    reading: Settings
    identities: tuple[Any, ...] = ()

    def folder(self, work: Path) -> Path:
        """Of the run, where a stopped one resumes."""
        return work / f"training-{self.key}"

    def compute(self, evaluation: CameraEvaluation, folder: Path) -> Measured:
        run = evaluation.train(self.training, self.folder(folder))
        return {"weights": str(run.weights), "best": run.best, "seconds": run.cpu_seconds}


class Measurement(Cell):
    """The snapshot of a scene, decoded and measured: ``metrics``, ``seconds``, ``throughput``.

    Args:
        code, noise, decoder, seed: of the row.
        scene: short name.
        source: of the scene, and ``identity``, what tells that it has changed.
        reading: how it is read.
        settings: of the camera's constructor; ``preset`` among them where there is one.
        sensor: of the noise.
        codes: file of searched codes.
        camera_of: weights whose codes the camera shows.
        weights: of the network that decodes.
        dead_time: share of every slot in which no light is collected.
        faults: of the bench, that decoders do not know of.
        motion: of the scene, see `tmca.evaluation.study.Motion`; at rest if empty.
        options: settings of the decoder.
        prior: file; the rendered scenes' prior without.
        about: what else the camera's evaluation needs.
        part: whether the scene is a part of one.
        save: write the estimate, for pictures.
    """

    step: str = "measurement"
    code: str = ""
    noise: str = ""
    decoder: str
    seed: int = 0
    scene: str
    source: str
    identity: Any = None
    reading: Settings
    settings: Settings
    sensor: Settings
    codes: str | None = None
    camera_of: str | None = None
    weights: str | None = None
    dead_time: float = 0.0
    faults: Settings = {}
    motion: Settings = {}
    options: Settings = {}
    prior: str | None = None
    about: Settings = {}
    part: bool = False
    save: bool = False

    def compute(self, evaluation: CameraEvaluation, folder: Path) -> Measured:
        scene = evaluation.scene(self)
        camera = evaluation.camera(self, scene)
        if self.dead_time:
            dead, parts = Fraction(round(100 * self.dead_time), 100).as_integer_ratio()
            camera = in_finer_time(camera, parts, dead)
        seen: Any = scene
        if self.motion:
            seen = frames_of(scene, self._displacement(), camera.slots, whole=self.motion["whole"])
        snapshot = simulate(seen, camera, seed=self.seed, hardware=Hardware.of(self.faults))
        estimate = self._decoded(snapshot)
        shown, truth = evaluation.middle(self, estimate, scene)
        results = {
            "seconds": estimate.seconds,
            "throughput": camera.throughput(),
            **self._measured(evaluation, shown, truth),
        }
        return {**results, "estimate": str(self._saved(shown, folder))} if self.save else results

    def _decoded(self, snapshot: Any) -> Estimate:
        given: Settings = {**self.options, **({"weights": self.weights} if self.weights else {})}
        with catch_warnings():
            simplefilter("ignore", OtherCodes)  # rows name both codes and network
            return decode(snapshot, "network" if self.weights else self.decoder, prior=self.prior, **given)

    def _saved(self, shown: Any, folder: Path) -> Path:
        """The file of an estimate; of one in frames the middle one."""
        from tmca.data import write_dataset

        middle = shown.isel({FRAMES: shown.sizes[FRAMES] // 2}) if FRAMES in shown.dims else shown
        return write_dataset(middle, folder / f"estimate-{self.key}.nc", overwrite=True)

    def _displacement(self) -> tuple[float, float]:
        """Rows and columns within the exposure, pixels: in a direction drawn from seed and scene, or the bench's."""
        if not self.motion:
            return Hardware.of(self.faults).movement
        angle = np.random.default_rng([self.seed, crc32(self.scene.encode())]).uniform(0, 2 * np.pi)
        return self.motion["pixels"] * float(np.sin(angle)), self.motion["pixels"] * float(np.cos(angle))

    def _measured(self, evaluation: CameraEvaluation, shown: Any, truth: Any) -> Settings:
        """What is measured; of a scene that moves, or an estimate in frames, the mean over frames, with each of which a
        still estimate is compared."""
        count = self.motion.get("frames") or shown.sizes.get(FRAMES)
        if count is None:
            return evaluation.measured(self, shown, truth)
        pairs = frame_pairs(shown, truth, self._displacement(), count, whole=self.motion.get("whole", True))
        return {"metrics": mean_of([evaluation.measured(self, *pair)["metrics"] for pair in pairs])}


class Check(Cell):
    """A camera's own figures: what its evaluation's method ``method`` says of the ``arguments``."""

    step: str = "check"
    method: str
    code: str = ""
    noise: str = ""
    seed: int = 0
    arguments: Settings

    def compute(self, evaluation: CameraEvaluation, folder: Path) -> Measured:
        return dict(getattr(evaluation, self.method)(self, folder))


STEPS: Mapping[str, type[Cell]] = {
    cls.model_fields["step"].default: cls for cls in (LearnedPrior, Search, Training, Measurement, Check)
}


def compute(cell: Settings, folder: str, device: str | None = None, files: Mapping[str, str] | None = None) -> Measured:
    """A cell of any kind, by its ``step``; ``folder`` takes its files, ``device`` is where it is decoded or
    searched, and decoders of ``files``, by their names, are those that were named where the cells are sent from."""
    for name, file in (files or {}).items():
        decoder_named(file, name=name)
    checked = STEPS[cell["step"]].model_validate(cell)
    with computing_on(device):
        return checked.compute(evaluation_of(checked.camera), Path(folder))
