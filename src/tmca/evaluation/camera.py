"""What studies and sweeps ask of a kind of camera: how its scenes are read, its codes searched and its networks
trained, what is measured beside its metrics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import BaseModel

from tmca.applications import application_of
from tmca.cameras import CAMERAS
from tmca.codes import read_codes
from tmca.data import make_folder
from tmca.data.scene_names import short_names
from tmca.decoders import Estimate, Weights
from tmca.errors import check_choice
from tmca.evaluation.designs import learn_examples_of, searched
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

    from tmca.evaluation.cells import Check, Measurement
    from tmca.evaluation.study import Code, Study, TrainStage
    from tmca.training import Trained

    Scene = xr.DataArray | xr.Dataset

EVALUATIONS: dict[str, CameraEvaluation] = {}
"""That of every kind of camera."""
Settings = dict[str, Any]
EXAMPLES = "examples"
"""In the place of a prior's kind: example scenes that codes are searched for."""


@dataclass(frozen=True)
class Place:
    """A scene, or a part of it, that a study measures.

    Args:
        name: shown while it is measured.
        scene: short name of the scene.
        source: of the scene, and ``identity``, what tells that it has changed.
        reading: how it is read.
        about: what else the camera's evaluation needs.
        shown: whether estimates are pictured.
        part: whether it is a part of a scene, for decoders that are too slow for all of it.
    """

    name: str
    scene: str
    source: str
    identity: Any
    reading: Settings
    about: Settings = field(default_factory=dict)
    shown: bool = True
    part: bool = False

    def takes(self, prior_kind: str | None) -> bool:
        """Whether decoders with this prior measure here: those with a dictionary in parts of scenes alone."""
        return self.part or prior_kind != "dictionary"


class CameraEvaluation(ABC):
    """A kind of camera in studies and sweeps; ``kind`` is its name, ``title`` what tables say.

    ``Reading`` says how its scenes are read, ``swept`` are settings of the constructor that a sweep can vary, ``words``
    those of them that are words, ``labels`` names of decoders where tables of sweeps show others than their own, and
    ``sweeps_networks`` tells whether a sweep trains networks at every combination, and ``always_learned`` names
    the kinds of priors that a study needs for other things than decoders.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    swept: ClassVar[tuple[str, ...]]
    words: ClassVar[tuple[str, ...]]
    labels: ClassVar[Mapping[str, str]] = {}
    sweeps_networks: ClassVar[bool] = False
    Reading: ClassVar[type[BaseModel]]
    always_learned: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            EVALUATIONS[cls.kind] = cls()

    # scenes

    @abstractmethod
    def load(self, source: str, reading: Settings) -> Scene:
        """A scene to learn from."""

    def scene(self, cell: Measurement) -> Scene:
        """A scene to measure."""
        return self.load(cell.source, cell.reading)

    @abstractmethod
    def check_scenes(self, learned: Sequence[str], measured: Sequence[str], reading: Settings) -> None:
        """Read every scene as cells will, so that one that cannot be used is named before anything is made."""

    def usual_train(self) -> list[str]:
        """Scenes that sweeps learn from where none are given; none where decoders have a prior then."""
        return []

    def measured_reading(self, reading: Settings) -> Settings:
        """How scenes that are measured are read."""
        return reading

    @abstractmethod
    def training_scenes(
        self,
        reading: Settings,
        train: Sequence[str],
        validation: Sequence[str],
        measured: Sequence[str],
        stage: TrainStage,
    ) -> Settings:
        """``train``, ``validation`` and ``prior`` of a run: given scenes, as often as the stage says, and rendered
        ones; none that is measured."""

    # studies

    def check_study(self, study: Study, train: Sequence[str], test: Sequence[str]) -> None:
        """Refuse what cannot be used before anything is made; ``test`` without ``always_measured``.

        Raises:
            SettingError, DataError: impossible sizes, or a scene that cannot be read.
        """
        self.check_scenes(train, test, study.reading)

    def checks_before(self, study: Study, places: Sequence[Place]) -> list[Check]:
        """What of a study's scenes is checked before anything is measured."""
        return []

    def informed(self, places: Sequence[Place], checks: Sequence[Settings]) -> list[Place]:
        """Places with what was checked before."""
        return list(places)

    def checks_after(
        self,
        study: Study,
        cells: Sequence[Measurement],
        priors: Mapping[str, str],
        train: Sequence[str],
        test: Sequence[str],
    ) -> list[Check]:
        """What is checked of the codes of some rows."""
        return []

    @abstractmethod
    def places(self, study: Study, names: Mapping[str, str], files: Sequence[str]) -> list[Place]:
        """Where a study measures.

        Args:
            study: its reading.
            names: short name of every measured scene.
            files: those that the study names, beside which a camera may have scenes of its own.
        """

    def always_measured(self) -> list[str]:
        """Scenes that a study with a page measures beside those that it names."""
        return []

    def study_prior_settings(self, prior_kind: str, study: Study) -> Settings:
        """Arguments of ``learn_prior`` for a study."""
        return {}

    def search_settings(self, study: Study, code: Code, train: Sequence[str], priors: Mapping[str, str]) -> Settings:
        """Settings of a search."""
        assert code.search is not None
        period = study.search.get("period") or study.settings["period"]
        return {"kind": code.search.kind, "slots": code.search.slots, "period": period,
                "effort": study.search["effort"], "examples": priors[EXAMPLES], "gains": True}  # fmt: skip

    def row_settings(self, settings: Settings, reading: Settings) -> Settings:
        """Settings of the camera of a row."""
        return settings

    def training_camera(self, study: Study) -> Settings:
        """Settings of the camera in a training."""
        return {}

    # cameras

    def camera(self, cell: Measurement, scene: Any) -> Any:
        """The camera of a cell in front of a scene."""
        return self.shown(self.parts(scene), cell.settings, cell.sensor, cell.codes, cell.camera_of)

    def shown(
        self, parts: Settings, settings: Settings, sensor: Settings, codes: str | None, weights: str | None
    ) -> Any:
        """The camera that shows the codes of weights or of a file, or those of its settings."""
        if weights:
            return Weights.load(weights).camera_for(parts["size"], sensor=Sensor(**sensor))
        return self.build(parts, settings, sensor, codes)

    def parts(self, scene: Any) -> Settings:
        """What a camera takes from a scene."""
        return application_of(self.kind).parts(scene)

    def build(self, parts: Settings, settings: Settings, sensor: Settings, codes: str | None = None) -> Any:
        """A camera of settings, the codes of a file among them, and of what it takes from a scene."""
        own = {**parts, **({} if codes is None else self.coded(codes)), **settings, "sensor": Sensor(**sensor)}
        preset = own.pop("preset", None)
        cls = CAMERAS[self.kind]
        return cls(**own) if preset is None else cls.from_preset(preset, **own)

    def coded(self, codes: str) -> Settings:
        """Arguments of the camera that shows the codes of a file."""
        return read_codes(codes).settings()

    # steps

    def learn(self, cell: Settings, path: Path) -> Path:
        """Learn what a ``LearnedPrior`` asks for, and write it: a prior's file, or the folder of examples that codes
        are searched for."""
        from tmca.priors import learn_prior

        scenes = {name: self.load(name, cell["reading"]) for name in cell["scenes"]}
        if cell["prior_kind"] == EXAMPLES:
            learn_examples_of({short: scenes[name] for name, short in short_names([*scenes]).items()}, path)  # type: ignore[misc]
            return path
        file = path.with_suffix(".nc")
        learn_prior([*scenes.values()], None, cell["prior_kind"], **cell["settings"]).save(file, overwrite=True)
        return file

    def search(self, cell: Settings, folder: Path) -> Settings:
        """Search codes and write them: ``codes``, their file, CPU ``seconds``, and what the search tells of them."""
        own = {**cell["settings"], "seed": cell["seed"], "sensor": cell["sensor"], "exposures": 1}
        return searched({**own, "designs": str(make_folder(folder / "designs"))})

    @abstractmethod
    def train(self, training: Settings, reading: Settings, folder: Path) -> Trained:
        """Train a network of these settings, or resume it."""

    # measures

    def middle(self, cell: Measurement, estimate: Estimate, scene: Any) -> tuple[xr.Dataset, Any]:
        """What is measured of an estimate, and the truth; all of both."""
        return estimate.to_xarray(), scene

    def measured(self, cell: Measurement, shown: xr.Dataset, truth: Any) -> Settings:
        """``metrics`` of an estimate, and what else is measured."""
        parts = {"values": shown["estimate"].values[None]}
        return {"metrics": application_of(self.kind).metrics(parts, truth, None)}

    # sweeps

    @abstractmethod
    def check_point(self, camera: Settings, sensor: Settings) -> None:
        """Raises SettingError for settings of a sweep that make no camera."""

    @abstractmethod
    def prior_settings(self, prior_kind: str, settings: Settings, reading: Settings) -> Settings:
        """Arguments of ``learn_prior`` for a camera of these settings."""


def evaluation_of(kind: str) -> CameraEvaluation:
    """That of a kind of camera.

    Raises:
        SettingError: a kind that has none.
    """
    check_choice("camera", kind, EVALUATIONS)
    return EVALUATIONS[kind]
