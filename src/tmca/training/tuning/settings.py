"""What a run that fine-tunes a trained decoder is told, and from what it goes on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from tmca.errors import SettingError
from tmca.training.settings import (
    CameraSettings,
    CodeSettings,
    NoiseSettings,
    OptimiserSettings,
    Pixels,
    Strict,
    TrainSettings,
    parsed,
)

WHOLE = 256
"""Rows up to which captures are taken whole where the settings do not say."""
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
        validation: those that are held out, and choose the step that is kept.
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
    """Length and learning rate, the loss of the run that is gone on from; ``OptimiserSettings`` says the rest.

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
        weights: gone on from.
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
    def _fits(self) -> TuningSettings:
        """In the place of what other runs ask of their camera and codes."""
        return self


def tuning_settings(described: Mapping[str, Any], before: Mapping[str, Any], changes: Mapping[str, Any]) -> Any:
    """Settings of fine-tuning.

    Args:
        described: ``weights``, ``calibration``, ``captures``, and ``data`` with ``train`` and ``validation``.
        before: the card of the weights; its run's loss is gone on with.
        changes: dotted names and values.

    Raises:
        SettingError: a name that does not exist or belongs to the run before, or an impossible value.
    """
    own = before.get("training", {}).get("optimiser", {})
    kept = {name: own[name] for name in ("loss", "depth_weight", "clip") if name in own}
    merged: dict[str, Any] = {**described, "data": dict(described["data"]), "optimiser": kept}
    for name, value in changes.items():
        part, _, rest = name.partition(".")
        if part not in _OPEN or (part in ("data", "optimiser")) != bool(rest):
            known = f"one of {', '.join(_OPEN)}, as optimiser.clip=0.5"
            raise SettingError(name, "a setting of the run before, or none", known, "leave it out")
        if rest:
            merged[part][rest] = value
        else:
            merged[part] = value
    return parsed(TuningSettings, merged, "fine-tuning")
