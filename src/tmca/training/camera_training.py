"""How one kind of camera is trained: all that a run has to ask."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from tmca.decoders import Weights
from tmca.errors import check_choice
from tmca.sensor import Sensor
from tmca.specs import read_yaml
from tmca.training.faults import DrawnFaults
from tmca.training.patches import CubeStore, Load, PatchSource
from tmca.training.settings import RunSettings, TrainSettings, checked_settings, merge, nested
from tmca.training.system import TrainingSystem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRAININGS: dict[str, CameraTraining] = {}
"""How every kind of camera is trained."""
_PRESETS = Path(__file__).parent / "presets"


class NeededPrior(NamedTuple):
    """The prior that a run needs.

    Args:
        kind: ``"gaussian"`` or ``"mixture"``.
        block: (rows, columns) of its blocks where it is learned from the run's scenes; the camera's if None.
        rendered_block: the same of the prior of the rendered scenes.
    """

    kind: str
    block: tuple[int, int] | None = None
    rendered_block: tuple[int, int] | None = None


class CameraTraining(ABC):
    """What a run asks of the camera that it trains; a new camera that can be trained has one.

    It names the camera's ``kind`` and the model of its settings, and says what follows. It is registered as it is
    defined.
    """

    kind: ClassVar[str]
    settings: ClassVar[type[TrainSettings]]

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            TRAININGS[cls.kind] = cls()

    @property
    def presets(self) -> Mapping[str, dict[str, Any]]:
        """Settings by the name of a preset; those of this package are files."""
        file = _PRESETS / f"{self.kind}.yaml"
        return read_yaml(file, "settings by the name of a preset") if file.exists() else {}

    @abstractmethod
    def reader(self, settings: Any) -> Load:
        """What reads a scene of the settings' lists by its name.

        Raises:
            SettingError: a setting that applies to none of them.
        """

    @abstractmethod
    def camera(self, settings: Any, first: Callable[[], Any]) -> Any:
        """The camera with the codes that the run starts from; ``first`` reads the first scene.

        Raises:
            SettingError, DataError: an impossible camera, or codes that do not fit it.
        """

    @abstractmethod
    def channels(self, scene: Any, camera: Any) -> NDArray[np.float32]:
        """(L, H, W) what is learned of a scene."""

    @abstractmethod
    def network(self, settings: Any, camera: Any) -> Any:
        """The decoder, untrained."""

    @abstractmethod
    def needed_prior(self, settings: Any, camera: Any, network: Any) -> NeededPrior | None:
        """The prior that network or codes need, if any."""

    @abstractmethod
    def validation(self, name: str, channels: NDArray[np.float32], camera: Any) -> list[Tensor]:
        """Parts (L, h, w) of a validation scene, no larger than the camera.

        Raises:
            DataError: a scene that is too small.
        """

    @abstractmethod
    def build_system(self, settings: Any, *given: Any, **how: Any) -> TrainingSystem:
        """Camera, network, sensors, prior and validation scenes (``given``) as a system; ``how`` is what all have."""

    def source(self, settings: TrainSettings, store: CubeStore, camera: Any) -> PatchSource:
        """Where patches come from."""
        data, light = settings.data, settings.data.model_dump(include={"brightness", "tint", "motion"})
        return PatchSource(store, data.patch, settings.seed, slots=settings.camera.slots, **light)

    @abstractmethod
    def truth(self, path: str, camera: Any, colours: bool) -> Any:
        """The scene of a capture from a file, all of it and as it is there, at the camera's bands or views.

        Raises:
            DataError: a scene that is none of this camera's.
        """

    def batch(self, scene: Any, camera: Any) -> NDArray[np.float32]:
        """(B, L, H, W) of the scene of a capture; B are the colours of a light field."""
        return self.channels(scene, camera)[None]

    def exact(self, batch: Tensor, camera: Any) -> Tensor:
        """(B, C, H, W') what a camera takes of the ``batch`` of a scene."""
        return cast(Tensor, camera.operator().A(batch))

    @abstractmethod
    def decode(self, network: Any, prior: Any, values: Tensor, camera: Any) -> NDArray[np.float32]:
        """A network's estimate of a snapshot (B, C, H, W'), as a ``batch``."""

    @abstractmethod
    def figure(self, batches: Mapping[str, NDArray[np.float32]], truth: NDArray[np.float32], camera: Any) -> Figure:
        """Estimates by name and the truth, every one a ``batch``, in one picture."""

    def check(self, settings: Any, weights: Weights) -> None:
        """Warn of what was learned that no device shows as it is."""
        return

    def system(
        self,
        settings: RunSettings,
        camera: Any,
        network: Any,
        sensors: Sequence[Sensor],
        prior: Any,
        validation: Sequence[Tensor] = (),
    ) -> TrainingSystem:
        """The system of a run, or of one that fine-tunes."""
        faults = DrawnFaults(settings.faults if isinstance(settings, TrainSettings) else {})
        how = {"loss": settings.optimiser.loss, "faults": faults, "seed": settings.seed}
        return self.build_system(settings, camera, network, sensors, prior, validation, **how)


def training_settings(
    kind: str,
    preset: str | None = None,
    file: str | Path | None = None,
    changes: Mapping[str, Any] | None = None,
) -> TrainSettings:
    """Settings of a run of one kind of camera: a preset, replaced by a YAML file, replaced by single changes.

    Args:
        kind: of the camera.
        preset: ``"quick"`` or ``"thesis"``; None starts from that of the file, or the defaults.
        file: YAML with the names of the camera's settings; it may name a ``preset``.
        changes: dotted names and values, such as ``{"optimiser.steps": 300}``.

    Raises:
        SettingError: unknown camera, preset or name, impossible value.
        DataError: the file cannot be read.
    """
    check_choice("camera", kind, TRAININGS)
    training = TRAININGS[kind]
    described = {} if file is None else read_yaml(Path(file), "a YAML description of a run, `camera: {slots: 8}`")
    of_file = described.pop("preset", None)
    name = of_file if preset is None else preset
    if name is not None:
        check_choice("preset" if preset is not None else f"{file}: preset", name, training.presets)
    merged = merge({} if name is None else training.presets[name], described)
    for dotted, value in (changes or {}).items():
        merged = merge(merged, nested(dotted.split("."), value))
    return checked_settings(training.settings, merged, str(file or name or "settings"), file, changes or {})


def scene_reader(settings: TrainSettings) -> Load:
    """What reads the scenes of a run by their names; see `CameraTraining`."""
    return TRAININGS[settings.kind].reader(settings)
