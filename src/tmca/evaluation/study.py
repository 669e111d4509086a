"""A study: codes × noises × decoders × seeds of one camera over test scenes, described in YAML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from tmca.applications import application_of
from tmca.attributes import unknown_name
from tmca.cameras import CAMERAS, CodedCamera
from tmca.codes import tile_of
from tmca.decoders import Weights, decoders
from tmca.errors import SettingError, TmcaError, check_choice
from tmca.evaluation.camera import CameraEvaluation, Settings, evaluation_of
from tmca.evaluation.study_parts import Code, LearnedCodes, Motion, PublishedTable, Scenes, StudyNetwork, TrainStage
from tmca.evaluation.tables import decoder_labels
from tmca.sensor import Sensor
from tmca.summaries import Summary
from tmca.yaml_files import read_yaml

SHIPPED = Path(__file__).parent / "studies"
"""Studies of `tmca compare`, by the name of their camera."""
INHERITED = ("settings", "options", "networks", "labels", "search", "train", "priors")
"""What a study has from the shipped one of its camera where it says nothing."""


class Study(Summary, BaseModel):
    """What is compared.

    Args:
        name: of the results' files.
        camera: ``spectral``, ``light-field`` or ``spectral-depth``.
        title: heading of the page.
        about: paragraphs of the page; entries of the results stand in braces: ``{split[train]}``.
        about_networks: one more, where networks are trained.
        page: also measure the camera's scenes of known geometry.
        figure: draw truth and estimates of every scene side by side for a paper, and write a page about all.
        scenes: to learn from, to measure.
        reading: how they are read; see the camera's ``Reading``.
        settings: of the camera, for all codes.
        codes, noises: rows by their names; a noise is the arguments of a `Sensor`.
        motion: of the scenes that are measured; they stand still if None.
        decoders: names, of decoders and of ``networks``.
        options: settings of decoders, by their names.
        networks: that are trained.
        search: settings of all searches, ``effort`` among them.
        train: of all trainings.
        priors: settings of ``learn_prior``, by the prior's kind.
        patches: on which expected errors are checked, of cameras that check them; 0 for no check.
        seed, seeds: of codes, noise and trainings: the first, and how many.
        seeds_without_prior: how many for decoders without a prior and without training; as many if None.
        shown: codes and decoders that are pictured under ``shown_noise``; all if None.
        pairs: codes, and those over which their gain is told.
        decoder_pairs: decoders, the same.
        bases: name → codes that time-multiplexed ones are held against, beside all with one slot.
        published: a table of another work; of it, pairs and bases those count that are measured.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str = ""
    camera: str
    title: str = ""
    about: tuple[str, ...] = ()
    about_networks: str = ""
    page: bool = False
    figure: bool = False
    scenes: Scenes = Scenes()
    reading: Settings = {}
    settings: Settings = {}
    codes: dict[str, Code] = Field(min_length=1)
    noises: dict[str, Settings] = Field(min_length=1)
    motion: Motion | None = None
    decoders: tuple[str, ...]
    options: dict[str, Settings] = {}
    networks: dict[str, StudyNetwork] = {}
    labels: dict[str, str] = {}
    search: Settings = {}
    train: TrainStage = TrainStage()
    priors: dict[str, Settings] = {}
    patches: int = Field(default=24_000, ge=0, le=10**7)
    seed: int = 0
    seeds: int = Field(default=1, ge=1, le=10**5)
    seeds_without_prior: int | None = None
    shown: tuple[tuple[str, str], ...] | None = ()
    shown_noise: str | None = None
    pairs: tuple[tuple[str, str], ...] = ()
    decoder_pairs: tuple[tuple[str, str], ...] = ()
    bases: dict[str, tuple[str, ...]] = {}
    published: PublishedTable | None = None

    def _facts(self) -> dict[str, str]:
        return {
            "study": f"{self.name}, {self.camera} camera",
            "codes": ", ".join(self.codes),
            "noises": ", ".join(self.noises),
            "decoders": ", ".join(self.decoders),
            "scenes": ", ".join(name for name, _ in zip(self.scenes.test, range(6), strict=False)),
        }

    def tile(self) -> tuple[int, int]:
        """(rows, columns) of the period of searched and learned codes."""
        tile = tile_of(self.settings.get("period"))
        if tile is None:
            raise SettingError("settings.period", "none", "the tile of searched and learned codes, pixels")
        return tile

    @model_validator(mode="after")
    def _names(self) -> Study:
        """Names point to what is there."""
        application_of(self.camera)
        for name, code in self.codes.items():
            self._check_code(name, code)
        paired = [name for pair in self.decoder_pairs for name in pair]
        paired += [name for row in (self.published.rows if self.published else {}).values() for name in row.decoders]
        for decoder in paired:
            check_choice("decoder_pairs, published", decoder, self.decoder_labels)
        for name, noise in self.noises.items():
            try:
                Sensor(**noise)
            except SettingError as error:
                where = f"noises.{name}.{error.where}"
                raise SettingError(where, error.found, error.expected, error.remedy) from None
        object.__setattr__(self, "reading", self.evaluation.Reading(**self.reading).model_dump(mode="json"))
        return self

    def _check_code(self, name: str, code: Code) -> None:
        """Raises SettingError for codes that the study cannot have."""
        self._dead_time(name, code)
        if code.file is not None and not Path(code.file).is_file():
            raise SettingError(f"codes.{name}.file", f"{code.file}, which is no file", "codes or a snapshot")
        self._check_weights(name, code)
        if code.search and code.search.noise is not None:
            check_choice(f"codes.{name}.search.noise", code.search.noise, self.noises)
        if code.learn and code.learn.start is not None:
            check_choice(f"codes.{name}.learn.start", code.learn.start, self.codes)
        for network in code.learn.networks if code.learn else ():
            check_choice(f"codes.{name}.learn.networks", network, self.networks)

    def _check_weights(self, name: str, code: Code) -> None:
        """Raises SettingError for codes of weights that cannot be read, or are another camera's."""
        if code.weights is None:
            return
        try:
            weights = Weights.load(str(code.shown(self.camera)))
            weights.check_kind(self.camera)
            weights.check_codes()
            if code.camera.get("slots") not in (None, weights.slots):
                found = f"slots = {code.camera['slots']} beside weights of {weights.slots}"
                raise SettingError("camera.slots", found, "theirs", "leave it out")
        except (TmcaError, ValueError, TypeError) as error:
            raise SettingError(f"codes.{name}.weights", f"{code.weights}: {error}", "weights of this camera") from None

    def _dead_time(self, name: str, code: Code) -> None:
        """Raises SettingError where the camera has none, or a network would learn without it."""
        where = f"codes.{name}.dead_time"
        if code.dead_time and not issubclass(CAMERAS[self.camera], CodedCamera):
            raise SettingError(where, "some", f"none of a {self.camera} camera")
        if code.dead_time and code.learn:
            raise SettingError(where, "some", "none of codes that learn", "search them")
        if code.dead_time and code.train and any(decoder in self.networks for decoder in self.decoders):
            raise SettingError(where, "some", "none where a network learns without it", "or train: false")

    @property
    def evaluation(self) -> CameraEvaluation:
        """The camera's evaluation."""
        return evaluation_of(self.camera)

    @property
    def decoder_labels(self) -> dict[str, str]:
        """Name → label of decoders and networks."""
        return decoder_labels(self.camera, {**self.labels, **{name: one.label for name, one in self.networks.items()}})

    @property
    def doubts(self) -> list[str]:
        """What of its sensors was most likely meant otherwise, in lines."""
        said = {name: Sensor(**noise).doubt for name, noise in self.noises.items()}
        return [f"Warning: sensor {name}: {doubt}." for name, doubt in said.items() if doubt]

    @property
    def all_seeds(self) -> range:
        """From ``seed`` on."""
        return range(self.seed, self.seed + self.seeds)

    def seeds_of(self, decoder: str) -> range:
        """Of the rows of a decoder without training."""
        fewer = self.seeds_without_prior if self.prior_kind(decoder) is None else None
        return self.all_seeds[:fewer]

    def prior_kind(self, decoder: str) -> str | None:
        """Kind of the prior that a decoder needs; None of networks, which bring theirs."""
        return None if decoder in self.networks else decoders()[decoder].prior_kind

    def with_(self, **changes: Any) -> Study:
        """The study with other fields; dotted names reach into them, and None changes nothing.

        Raises:
            SettingError: values that it cannot have.
        """
        described = self.model_dump()
        for name, value in changes.items():
            *path, last = name.split("__")
            place = described
            for part in path:
                place = place[part]
            if value is not None:
                place[last] = value
        return checked_study(described, "study")


def checked_study(described: Mapping[str, Any], where: str) -> Study:
    """A study from what a file says.

    Raises:
        SettingError: naming the field that is unknown, missing or impossible.
    """
    try:
        return Study.model_validate(described)
    except ValidationError as error:
        if unknown := unknown_name(error, Study):
            raise SettingError(f"{where}.{unknown[0]}", *unknown[1:]) from None
        first = error.errors()[0]
        place = ".".join(map(str, (where, *first["loc"])))
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, TmcaError):
            raise SettingError(f"{place}.{cause.where}", cause.found, cause.expected, cause.remedy) from None
        found = "nothing" if first["type"] == "missing" else str(first["input"])[:60]
        raise SettingError(place, found, str(first["msg"]).removeprefix("Value error, ")) from None


def read_study(path: str | Path) -> Study:
    """A study from a YAML file, or the shipped one of a camera by its name.

    What a file does not say of networks, searches and trainings is as in the shipped study of its camera.

    Raises:
        DataError: no such file, or one that is no YAML.
        SettingError: a description that is no study.
    """
    if (SHIPPED / f"{path}.yaml").exists():
        return checked_study({"name": str(path), **_described(SHIPPED / f"{path}.yaml")}, str(path))
    described = _described(Path(path))
    usual = usual_settings(str(described.get("camera")))
    return checked_study({"name": Path(path).stem, **merged(usual, described)}, str(path))


def usual_settings(camera: str) -> Settings:
    """What a study has from the shipped one of its camera where it says nothing."""
    shipped = SHIPPED / f"{camera}.yaml"
    usual = _described(shipped) if shipped.exists() else {}
    return {name: value for name, value in usual.items() if name in INHERITED}


def _described(file: Path) -> Settings:
    """What a YAML file says."""
    return read_yaml(file, "a study: names and values, such as camera: spectral")


def merged(*settings: Mapping[str, Any]) -> Settings:
    """Nested settings, later ones over earlier ones."""
    together: Settings = {}
    for one in settings:
        for name, value in one.items():
            both = isinstance(value, Mapping) and isinstance(together.get(name), Mapping)
            together[name] = merged(together[name], value) if both else value
    return together


def training_of(
    study: Study, code: str, network: str, seed: int, scenes: Settings, start: str | None = None, *, learns: bool = True
) -> Settings:
    """Settings of a run of `tmca train`: one network for all noises.

    Args:
        study: what is compared.
        code, network: names of the row.
        seed: of codes and training.
        scenes: ``train``, ``validation`` and ``prior`` of the run.
        start: file of codes or weights that the run starts from.
        learns: whether codes that can learn do; else they stay as they start.
    """
    about, chosen, stage = study.networks[network], study.codes[code], study.train
    learn = chosen.learn if learns and chosen.learn and network in chosen.learn.networks else None
    pace = about.pace * (about.learning_pace * learn.steps if learn else 1)
    steps = max(stage.least_steps, round(stage.steps * pace))
    often = max(1, steps // (learn.steps if learn else 1) // stage.validations)
    camera = _training_camera(study, chosen, learn) | {"seed": seed, "learn": learn.what if learn else "none"}
    codes = {} if start is None else {"start": start, **({"decoder": start} if learn and learn.decoder else {})}
    run: Settings = {
        "camera": camera, "noise": list(study.noises.values()), "decoder": about.decoder, "codes": codes,
        "data": scenes, "optimiser": {"steps": steps}, "validate_every": often, "seed": seed,
    }  # fmt: skip
    return merged(run, stage.settings, about.training, about.learning if learn else {})


def _training_camera(study: Study, code: Code, learn: LearnedCodes | None) -> Settings:
    """Arguments of the camera of a training; learned codes that stay as they are are no longer of a kind."""
    stays = code.learn is not None and learn is None
    camera = {"slots": code.camera["slots"]} if stays else code.camera
    searched = code.search.slots if code.search else None
    usual = {**study.settings, **study.evaluation.training_camera(study)}
    return {**usual, **({"slots": searched} if searched else {}), **camera}
