"""A trained decoder that goes on learning, from captures with their truth: camera and codes stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Literal, Self, cast

from pydantic import Field, model_validator

from tmca.cameras import CodedCamera, SpectralDepthCamera
from tmca.data import atomic_path
from tmca.decoders import Weights
from tmca.errors import SettingError
from tmca.training.camera_training import TRAININGS
from tmca.training.captures import Captures, ReadPair
from tmca.training.patches import Load, Patch
from tmca.training.run import WEIGHTS, Prepared, Trained, carry_out
from tmca.training.scenes import SceneLists
from tmca.training.settings import (
    CameraSettings,
    CodeSettings,
    NoiseSettings,
    OptimiserSettings,
    Pixels,
    Strict,
    TrainSettings,
    checked_settings,
)
from tmca.training.tuned_system import TunedSystem

if TYPE_CHECKING:
    from lightning_fabric import Fabric

_OPEN = ("data", "optimiser", "precision", "validate_every", "checkpoint_every", "seed")


class Source(Strict):
    """A file or folder, and its SHA-256."""

    path: str
    sha256: str


class PairSource(Strict):
    """A capture and its truth."""

    capture: Source
    truth: Source


class TuningData(Strict):
    """Captures by their names.

    Args:
        train: those that are learned from.
        validation: those that are held out, and choose the step that is saved.
        patch: rows of the windows of captures, and columns where the optics mix none; all without, or 256 of captures
            with more.
        batch: windows per step, over all processes.
    """

    train: tuple[str, ...]
    validation: tuple[str, ...]
    patch: Pixels | None = None
    batch: int = Field(default=2, ge=1)
    patches_per_scene: int = Field(default=1, exclude=True)
    shares: tuple[float, float, float] = Field(default=(1, 0, 0), exclude=True)
    prior: tuple[str, ...] = Field(default=(), exclude=True)


class TuningOptimiser(OptimiserSettings):
    """Length and learning rate, the loss of the run before; ``OptimiserSettings`` says the rest.

    ``depth_weight`` and ``loss`` are that run's where they are not given.
    """

    steps: int | None = Field(default=200, ge=1)
    epochs: int = Field(default=1, exclude=True)
    decoder_rate: float = Field(default=1e-4, gt=0)
    code_rate: Literal[0] = Field(default=0, exclude=True)
    depth_weight: float = Field(default=0.1, ge=0)


class TuningSettings(TrainSettings):
    """A whole run of fine-tuning; camera, codes, noise and network are those of ``weights`` and of the captures.

    Args:
        weights: of the run before.
        calibration: of the camera; None for the run's own operator.
        captures: by their names.
    """

    weights: Source
    calibration: Source | None = None
    captures: dict[str, PairSource]
    camera: CameraSettings = Field(default=CameraSettings(), exclude=True)
    noise: tuple[NoiseSettings, ...] = Field(default=(NoiseSettings(),), exclude=True)
    decoder: dict[str, Any] = Field(default={}, exclude=True)
    faults: dict[str, tuple[float, float]] = Field(default={}, exclude=True)
    codes: CodeSettings = Field(default=CodeSettings(frozen=0.0, decoder="weights"), exclude=True)
    data: TuningData  # type: ignore[assignment]
    optimiser: TuningOptimiser = TuningOptimiser()
    validate_every: int = Field(default=20, ge=1)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """In the place of what other runs ask of their camera and codes."""
        return self


def tuning_settings(
    described: Mapping[str, Any], before: Mapping[str, Any], changes: Mapping[str, Any]
) -> TuningSettings:
    """Settings of fine-tuning.

    Args:
        described: ``weights``, ``calibration``, ``captures``, and ``data`` with ``train`` and ``validation``.
        before: the card of the weights; its run's loss is taken.
        changes: dotted names and values.

    Raises:
        SettingError: a name that does not exist or belongs to the run before, or an impossible value.
    """
    optimiser = before.get("training", {}).get("optimiser", {})
    losses = {name: optimiser[name] for name in ("loss", "depth_weight", "clip") if name in optimiser}
    merged: dict[str, Any] = {**described, "data": dict(described["data"]), "optimiser": losses}
    for name, value in changes.items():
        part, _, rest = name.partition(".")
        if part not in _OPEN or (part in ("data", "optimiser")) != bool(rest):
            wanted = f"one of {', '.join(_OPEN)}, as optimiser.clip=0.5"
            raise SettingError(name, "a setting of the run before, or none", wanted, "leave it out")
        (merged[part] if rest else merged)[rest or part] = value
    return checked_settings(TuningSettings, merged, "fine-tuning")


@dataclass(frozen=True)
class Tuning:
    """What is fine-tuned.

    Args:
        weights: of the run before.
        camera: that took the captures, calibrated or as the run has it.
        calibrated: whether ``camera`` is another one than the run's.
    """

    weights: Weights
    camera: CodedCamera | SpectralDepthCamera
    calibrated: bool = False

    def tuned(self, folder: Path) -> Weights:
        """A copy of the network with the camera of the captures, as weights in this folder."""
        copied = replace(self.weights, network=deepcopy(self.weights.network), path=folder / WEIGHTS)
        calibrated = Weights.of(copied.network, self.camera).variables if self.calibrated else copied.variables
        return replace(copied, variables=calibrated)


def tune(tuning: Tuning, settings: TuningSettings, folder: Path, read: ReadPair, **how: Any) -> Trained:
    """Fine-tune a decoder, or go on with a run that was stopped; the step that is saved is never worse on the captures
    that are held out than the decoder as it was, which is step 0.

    Args:
        tuning: network and camera.
        settings: of the run.
        folder: of the run, see `tmca.training.train`.
        read: of a capture with its truth, by its name.
        how: see `tmca.training.train`.

    Raises:
        OutputError: the folder holds another run.
        SettingError, DataError: a network that does not fit the camera, or captures that cannot be read.
        TrainingError: a loss that is not finite.
    """
    trained = carry_out(partial(prepare_tuning, tuning, read), settings, folder, cast(Load, read), **how)
    rmtree(folder / "starts", ignore_errors=True)
    return trained


def prepare_tuning(
    tuning: Tuning,
    read: ReadPair,
    settings: TuningSettings,
    folder: Path,
    load: Load,
    lists: SceneLists,
    fabric: Fabric,
) -> Prepared:
    """Network, captures and windows of a run."""
    if fabric.is_global_zero:
        _copy_prior(tuning.weights, folder)
    fabric.barrier()
    captures = Captures((*lists.train, *lists.validation), len(lists.train), read, folder)
    weights, data, camera = tuning.tuned(folder), settings.data, tuning.camera
    built = TRAININGS[camera.kind].built(settings, camera, weights.network, (camera.sensor,), weights.load_prior())
    system = TunedSystem(built, captures, data.patch, data.batch, settings.seed)

    def patch(step: int, index: int) -> Patch:
        return captures.patch(system.windows(step, index))

    def save(best: dict[str, Any]) -> None:
        card = {**weights.card, "best": best, "tuning": settings.model_dump(mode="json")}
        replace(weights, card=card).save(folder / WEIGHTS, overwrite=True)

    return Prepared(system, patch, save)


def _copy_prior(weights: Weights, folder: Path) -> None:
    """A copy of the prior that a network starts from, beside its weights."""
    if weights.prior in ("", "rendered") or weights.path is None or (folder / weights.prior).exists():
        return
    with atomic_path(folder / weights.prior, overwrite=True) as temporary:
        temporary.write_bytes((weights.path.parent / weights.prior).read_bytes())
