"""What studies and sweeps ask of a kind of camera: how its scenes are read, its codes searched and its networks
trained, what is measured and drawn beside its metrics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import BaseModel, ConfigDict

from tmca.applications import Application, application_of
from tmca.cameras import CAMERAS
from tmca.codes import read_codes, tile_of
from tmca.data import make_folder
from tmca.data.fitting import middle_of
from tmca.data.scene_names import identity_of, short_names
from tmca.decoders import Estimate, Weights
from tmca.evaluation.searches import learn_examples_of, searched
from tmca.evaluation.tables import Column, Row, grouped, mean
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.applications.report import Section
    from tmca.evaluation.cells import Check, Measurement
    from tmca.evaluation.grid import Measured
    from tmca.evaluation.study import Study
    from tmca.evaluation.study_parts import Code, TrainStage
    from tmca.training import Trained

    Scene = xr.DataArray | xr.Dataset

EVALUATIONS: dict[str, CameraEvaluation] = {}
"""Those of cameras that need more than their application says."""
_SHIPPED = {"spectral": "spectral", "light-field": "light_field", "spectral-depth": "spectral_depth"}
"""Files of this package that hold one; each is imported when its camera is asked for."""
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


@dataclass(frozen=True)
class Lists:
    """Scenes of a study, and what was learned from them.

    Args:
        train: names of those that are learned from.
        test: of those that are measured.
        priors: files by the kinds of priors.
        places: where is measured.
    """

    train: Sequence[str]
    test: Sequence[str]
    priors: Mapping[str, str]
    places: Sequence[Place]


class AnyReading(BaseModel):
    """How scenes of a camera without a reading of its own are read: arguments of its application's ``read``.

    Args:
        size: (H, W) middle of those that are measured; all of them if None.
    """

    model_config = ConfigDict(extra="allow")
    size: tuple[int, int] | None = None


class CameraEvaluation:
    """A kind of camera in studies and sweeps; ``kind`` is its name.

    What is here serves any camera that has an application; a camera that needs more has a subclass, which is registered
    by its ``kind`` as it is defined. ``Reading`` says how its scenes are read, ``labels`` are names of decoders where
    tables of sweeps show others than their own, ``sweeps_networks`` tells whether a sweep trains networks at every
    combination, ``always_learned`` names the kinds of priors that a study needs for other things than decoders,
    ``pictures`` has the captions of the pictures of every scene by the endings of their names, ``beside`` are columns
    that help to judge the metrics.
    """

    kind: str
    labels: ClassVar[Mapping[str, str]] = {}
    sweeps_networks: ClassVar[bool] = False
    Reading: ClassVar[type[BaseModel]] = AnyReading
    always_learned: ClassVar[tuple[str, ...]] = ()
    pictures: ClassVar[Mapping[str, str]] = {}
    beside: ClassVar[Sequence[Column]] = ()

    def __init__(self, kind: str = "") -> None:
        self.kind = kind or self.kind

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            EVALUATIONS[cls.kind] = cls()

    @property
    def application(self) -> Application:
        """The camera's."""
        return application_of(self.kind)

    @property
    def title(self) -> str:
        """What tables say."""
        return f"{self.kind.capitalize()} camera"

    @property
    def columns(self) -> Sequence[Column]:
        """Of its metrics in tables."""
        return self.application.columns

    def warnings(self, rows: Iterable[Row]) -> list[str]:
        """Lines about rows of a table whose metrics say less than they seem to."""
        return []

    @property
    def metric(self) -> str:
        """That is shown seed by seed and scene by scene, and by which codes are chosen; PSNR where there is one."""
        names = [name for name, *_ in self.columns]
        return "psnr" if "psnr" in names else names[0]

    @property
    def swept(self) -> tuple[str, ...]:
        """Settings that a sweep can vary."""
        return tuple(self.application.settings())

    @property
    def words(self) -> tuple[str, ...]:
        """Those of them that are words."""
        return tuple(name for name, value in self.application.settings().items() if isinstance(value, str))

    # scenes

    def load(self, source: str, reading: Settings, measured: bool = False) -> Scene:
        """A scene to learn from, or the middle of one to be measured."""
        how = {name: value for name, value in reading.items() if name != "size"}
        whole: Any = self.application.read(source, **how)
        size = reading.get("size") if measured else None
        return whole if size is None else middle_of(whole, (size[0], size[1]), source)

    def scene(self, cell: Measurement) -> Scene:
        """The scene of a cell."""
        return self.load(cell.source, cell.reading, measured=True)

    def check_scenes(self, learned: Sequence[str], measured: Sequence[str], reading: Settings) -> None:
        """Read every scene as cells will, so that one that cannot be used is named before anything is made."""
        for source in dict.fromkeys(learned):
            self.load(source, reading)
        for source in dict.fromkeys(measured):
            self.load(source, reading, measured=True)

    def rendered(self) -> Mapping[str, Sequence[str]]:
        """Names of rendered scenes, by ``train``, ``validation`` and ``test``; none of cameras that nobody rendered."""
        return {}

    def usual_train(self) -> list[str]:
        """Scenes that sweeps learn from where none are given; none where decoders have a prior then."""
        return []

    def training_scenes(
        self,
        reading: Settings,
        train: Sequence[str],
        validation: Sequence[str],
        measured: Sequence[str],
        stage: TrainStage,
    ) -> Settings:
        """``train``, ``validation`` and ``prior`` of a run: given scenes, repeated, and rendered ones; none measured.

        Given scenes make the prior alone: rendered ones among them cost the first estimate up to 1.8 dB.
        """
        rendered = {part: sorted(names) for part, names in self.rendered().items()} if stage.rendered else {}
        return {
            "train": [*stage.repeat * [*train], *rendered.get("train", ())],
            "validation": [*validation] or rendered.get("validation", []),
            "prior": [*train] or (["rendered"] if self.rendered() else []),
            **self.training_reading(reading),
        }

    def training_reading(self, reading: Settings) -> Settings:
        """How a run reads its scenes."""
        return {}

    # studies

    def check_study(self, study: Study, train: Sequence[str], test: Sequence[str]) -> None:
        """Refuse what cannot be used before anything is made; ``test`` without ``always_measured``.

        Raises:
            SettingError, DataError: impossible sizes, or a scene that cannot be read.
        """
        self.check_scenes(train, test, study.reading)

    def checks(self, study: Study, cells: Sequence[Measurement], lists: Lists) -> list[Check]:
        """Figures of the camera's own, of the codes of some rows; see ``Check``."""
        return []

    def places(self, study: Study, names: Mapping[str, str], files: Sequence[str]) -> list[Place]:
        """Where a study measures.

        Args:
            study: its reading.
            names: short name of every measured scene.
            files: those that the study names, beside which a camera may have scenes of its own.
        """
        return [Place(name, name, source, identity_of(source), study.reading) for source, name in names.items()]

    def always_measured(self) -> list[str]:
        """Scenes that a study with a page measures beside those that it names."""
        return []

    def search_settings(self, study: Study, code: Code, lists: Lists) -> Settings:
        """Settings of a search."""
        assert code.search is not None
        period = list(tile_of(study.search.get("period")) or study.tile())
        about = {"kind": code.search.kind, "slots": code.search.slots, "period": period}
        return {**about, **self.searching(study.reading), "effort": study.search["effort"],
                "examples": lists.priors[EXAMPLES], "gains": True,
                **{name: study.search[name] for name in ("gains", "static") if name in study.search}}  # fmt: skip

    def searching(self, reading: Settings) -> Settings:
        """What searches of codes take from how scenes are read."""
        return {}

    def camera_settings(self, settings: Settings, reading: Settings) -> Settings:
        """Settings of a camera; a reading may name its preset."""
        return {**({"preset": reading["preset"]} if "preset" in reading else {}), **settings}

    def training_camera(self, study: Study) -> Settings:
        """Settings of the camera in a training."""
        return {}

    def prior_settings(self, prior_kind: str, settings: Settings, reading: Settings) -> Settings:
        """Arguments of ``learn_prior`` for a camera of these settings."""
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
            return Weights.load(weights).camera_for(parts["size"], bands=parts.get("bands"), sensor=Sensor(**sensor))
        return self.build(parts, settings, sensor, codes)

    def parts(self, scene: Any) -> Settings:
        """What a camera takes from a scene."""
        return self.application.parts(scene)

    def build(self, parts: Settings, settings: Settings, sensor: Settings, codes: str | None = None) -> Any:
        """A camera of settings, the codes of a file among them, and of what it takes from a scene."""
        shown = {} if codes is None else self.coded(codes, parts)
        own = {**parts, **shown, **settings, "sensor": Sensor(**sensor)}
        preset, cls = own.pop("preset", None), CAMERAS[self.kind]
        arguments = signature(cls).parameters
        if "seed" not in arguments and not any(one.kind is one.VAR_KEYWORD for one in arguments.values()):
            own.pop("seed", None)
        return cls(**own) if preset is None else cls.from_preset(preset, **own)

    def coded(self, codes: str, parts: Settings) -> Settings:
        """Arguments of the camera that shows the codes of a file, or of a snapshot. Those of a whole frame repeat, at
        another size than their own."""
        return read_codes(codes).at(parts.get("size")).settings()

    # steps

    def learn(self, cell: Settings, path: Path) -> Path:
        """Learn what a ``LearnedPrior`` asks for, and write it: a prior's file, or the folder of examples that codes
        are searched for."""
        from tmca.priors import learn_prior

        scenes = {name: self.load(name, cell["reading"]) for name in cell["scenes"]}
        if cell["prior_kind"] == EXAMPLES:
            named: Any = {short: scenes[name] for name, short in short_names([*scenes]).items()}
            learn_examples_of(named, path, cell["settings"].get("most"))
            return path
        file = path.with_suffix(".nc")
        learn_prior([*scenes.values()], None, cell["prior_kind"], **cell["settings"]).save(file, overwrite=True)
        return file

    def search(self, cell: Settings, folder: Path) -> Settings:
        """Search codes and write them: ``codes``, their file, CPU ``seconds``, and what the search tells of them."""
        own = {**cell["settings"], "seed": cell["seed"], "sensor": cell["sensor"], "exposures": 1}
        return searched({**own, "designs": str(make_folder(folder / "designs"))})

    def train(self, training: Settings, folder: Path) -> Trained:
        """Train a network of these settings, or resume it."""
        from tmca.training import train, training_settings

        return train(training_settings(self.kind, None, None, training), folder)

    # measures

    def middle(self, cell: Measurement, estimate: Estimate, scene: Any) -> tuple[xr.Dataset, Any]:
        """What is measured of an estimate, and the truth; all of both."""
        return estimate.to_xarray(), scene

    def measured(self, cell: Measurement, shown: xr.Dataset, truth: Any) -> Settings:
        """``metrics`` of an estimate, and what else is measured."""
        parts = {"values": shown["estimate"].values[None]}
        return {"metrics": self.application.metrics(parts, truth, None)}

    # results

    def row(self, cells: Sequence[Measured]) -> Row:
        """What the row of some measurements has beside what all rows have."""
        return {}

    def conclusions(self, study: Study, measured: Sequence[Measured], rows: Sequence[Row]) -> Row:
        """What results have beside what all results have."""
        return {}

    def sections(self, found: Row, study: Study) -> Iterable[Section]:
        """Sections of the page about it."""
        return ()

    def scores(self, found: Row, decoder: str, noise: str) -> dict[str, float]:
        """What is known of codes without a test scene, less for better ones: a network's best validation figure, means
        over seeds; nothing of decoders without training, nor of trainings without validation scenes."""
        sign = -1 if self.metric == "psnr" else 1
        trainings = [one for one in found["budget"]["training"] if one["decoder"] == decoder]
        validated = [one for one in trainings if one["best"].get(self.metric) is not None]
        return {
            code: sign * mean([one["best"][self.metric] for one in own])
            for (code,), own in grouped(validated, "code").items()
        }

    def truth(self, study: Study, cell: Measured) -> Any:
        """The scene of a measured cell, brought to its estimate."""
        return self.load(cell["source"], cell["reading"], measured=True)

    def scene_figures(self, study: Study, cells: Sequence[Measured]) -> dict[str, Figure]:
        """Pictures of the estimates of a scene, by the endings in ``pictures``."""
        return {}

    def study_figures(self, study: Study, measured: Sequence[Measured]) -> dict[str, Figure]:
        """Pictures of a study as a whole, by the endings of their names."""
        return {}

    def estimates(self, study: Study, cells: Sequence[Measured]) -> dict[str, Measured]:
        """Cells with an estimate in the order in which the study shows them, by their codes and decoders."""
        own = {(cell["code"], cell["decoder"]): cell for cell in cells}
        shown = own if study.shown is None else [row for row in study.shown if row in own]
        return {f"{code}\n{study.decoder_labels[decoder]}": own[code, decoder] for code, decoder in shown}

    # sweeps

    def check_point(self, camera: Settings, sensor: Settings) -> None:
        """Raises SettingError for settings of a sweep that make no camera."""
        self.build({}, camera, sensor)


def evaluation_of(kind: str) -> CameraEvaluation:
    """That of a kind of camera; any that has an application has one.

    Raises:
        SettingError: no camera of this kind.
    """
    if kind in _SHIPPED and kind not in EVALUATIONS:
        import_module(f"tmca.evaluation.{_SHIPPED[kind]}")
    return EVALUATIONS.get(kind) or CameraEvaluation(application_of(kind).kind)
