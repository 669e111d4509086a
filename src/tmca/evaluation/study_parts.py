"""The parts of a study's description: scenes, codes of a row, networks, trainings, motion, published tables."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from tmca.codes import BURST
from tmca.codes.files import CodesFile, codes_of_file
from tmca.decoders import Weights
from tmca.decoders.nets.shipped import CAMERA_NAMES
from tmca.decoders.nets.weights import weights_file
from tmca.design.kinds import KINDS, buckets_of
from tmca.errors import SettingError
from tmca.evaluation.camera import Settings


class Strict(BaseModel):
    """Unknown names are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Scenes(Strict):
    """Names of scenes, or split files (``.txt``) of them.

    Args:
        train: that priors, codes and networks learn from.
        test: that are measured; they choose nothing.
        validation: that choose a network's best step.
    """

    train: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()


class SearchedCodes(Strict):
    """Codes that are searched.

    Args:
        noise: that they are searched for; that of each row if None.
        kind, slots: of searched aperture and shutter patterns, as in `tmca design`; masks take those of the camera.
        starts: times the starts of a search of masks.
    """

    noise: str | None = None
    kind: str | None = None
    slots: int | None = Field(default=None, ge=1, le=1024)
    starts: int = Field(default=1, ge=1)


class LearnedCodes(Strict):
    """Codes that learn end to end.

    Args:
        what: ``aperture``, ``shutter``, ``both``, or parts of a phase code.
        start: codes that they start from; those of the camera's settings if None.
        decoder: start from the network of these codes, too.
        networks: each network that codes are learned with, and decoders and further networks behind its codes.
        steps: times the steps of a training.
    """

    what: str | tuple[str, ...]
    start: str | None = None
    decoder: bool = False
    networks: dict[str, tuple[str, ...]]
    steps: int = Field(default=1, ge=1)


def _hundredths(share: float) -> float:
    """A share of the time that slots in a hundred parts can have."""
    if abs(100 * share - round(100 * share)) > 1e-9:
        raise ValueError("hundredths, such as 0.1")
    return share


class Code(Strict):
    """Codes of a row: the camera's settings, searched ones, or learned ones.

    Args:
        camera: settings of the camera, beside those of all codes.
        file: of codes of `tmca design`, or a snapshot whose codes they are.
        weights: whose codes they are, with their camera: a file or run of `tmca train`, or ``default``.
        search, learn: where they are searched or learned.
        train: whether networks are trained behind them.
        dead_time: share of every slot in which no bucket collects light, in hundredths: the readouts of a burst.
    """

    camera: Settings = {}
    file: str | None = None
    weights: str | None = None
    search: SearchedCodes | None = None
    learn: LearnedCodes | None = None
    train: bool = True
    dead_time: Annotated[float, Field(ge=0, le=0.99), AfterValidator(_hundredths)] = 0.0

    @model_validator(mode="after")
    def _one_origin(self) -> Code:
        """Codes of a file or of weights are not made; each frame of a searched burst is a bucket."""
        origins = [name for name in ("file", "weights", "search", "learn") if getattr(self, name) is not None]
        if len(origins) > 1 and {"file", "weights"} & {*origins}:
            raise SettingError(origins[0], f"codes of {' and '.join(origins)}", "one of them")
        if self.weights is not None and {*self.camera} - {"slots"}:
            raise SettingError("camera", f"{', '.join(self.camera)} beside weights", "their camera", "leave it out")
        if self.search and self.search.kind == BURST and "buckets" in self.camera:
            given, frames = self.camera["buckets"], buckets_of(BURST, self.search.slots or 1)
            if given != frames:
                found = f"{given} beside a searched burst of {frames} frames"
                raise SettingError("buckets", found, f"{frames}, one a frame", "leave it out, or change slots")
        return self

    @property
    def one_slot(self) -> bool:
        """Whether nothing changes within the exposure."""
        searched, stored = self.search.slots if self.search else None, self._stored
        if trained := self._trained:
            return trained.slots == 1
        return stored.static if stored else (searched or self.camera.get("slots")) == 1

    @property
    def burst(self) -> bool:
        """Whether they are frames one after the other, which multiplex nothing."""
        stored = self._stored
        return stored.burst if stored else BURST in (self.camera.get("shutter"), self.search and self.search.kind)

    @property
    def buckets(self) -> int:
        """That a pixel needs for them."""
        stored, kind = self._stored, self.search.kind if self.search else None
        searched = buckets_of(kind, self.search.slots or 1) if self.search and kind in KINDS else 1
        if trained := self._trained:
            return int(trained.camera.buckets)
        return stored.buckets if stored else int(self.camera.get("buckets", searched))

    def shown(self, kind: str) -> str | None:
        """File of the weights whose codes they are, of a kind of camera; None without."""
        if self.weights is None:
            return None
        return str(weights_file(Weights.file(self.weights, int(self.camera.get("slots", 8)), kind)))

    @property
    def _trained(self) -> Weights | None:
        """Weights of a file or run; those that come with tmca have one bucket, and the slots that ``camera`` says."""
        named = self.weights in (None, *CAMERA_NAMES)
        return None if named else Weights.load(str(self.weights))

    @property
    def _stored(self) -> CodesFile | None:
        """Codes of the file, None without one."""
        return codes_of_file(self.file) if self.file is not None else None


class StudyNetwork(Strict):
    """A network that is trained for each code: one for all noises.

    Args:
        label: what tables call it.
        decoder: settings of the network.
        training: further settings of its runs.
        pace: times the steps of a training.
        learning_pace: times the steps of a run that learns codes, so that it takes as long as one that does not.
        learning: further settings of runs that learn codes.
    """

    label: str
    decoder: Settings
    training: Settings = {}
    pace: float = Field(default=1.0, gt=0)
    learning_pace: float = Field(default=1.0, gt=0)
    learning: Settings = {}


class TrainStage(Strict):
    """How networks are trained.

    Args:
        steps: of a training.
        least_steps: of any training.
        validations: in a run.
        repeat: how often the scenes of the study are among those that are learned from.
        rendered: whether the rendered training scenes are among them.
        settings: of all runs.
    """

    steps: int = Field(default=400, ge=1)
    least_steps: int = Field(default=1, ge=1)
    validations: int = Field(default=4, ge=1)
    repeat: int = Field(default=1, ge=1)
    rendered: bool = True
    settings: Settings = {}


class Motion(Strict):
    """How the scenes of a study move within the exposure, in directions that are drawn.

    Args:
        pixels: from its beginning to its end; 0 for scenes at rest, compared frame by frame likewise.
        frames: of equal length, in each of which estimates are compared with the scene of that time.
        whole: whether all of a scene moves; else the disc in its middle, before the rest.
    """

    pixels: float = Field(ge=0, le=1000)
    frames: int = Field(default=4, ge=1, le=1024)
    whole: bool = True


class PublishedRow(Strict):
    """A row of a published table, and what stands for it in a study.

    Args:
        values: name of a metric → value.
        code, decoders: of the study.
        part: whether decoders in parts of scenes stand for it.
    """

    values: dict[str, float]
    code: str = ""
    decoders: tuple[str, ...] = ()
    part: bool = False


class PublishedTable(Strict):
    """A table that a study's rows are put beside, those without noise on the scenes that the study names.

    Args:
        title: of the section.
        about: its paragraph.
        rows: by their names.
    """

    title: str
    about: str
    rows: dict[str, PublishedRow]
