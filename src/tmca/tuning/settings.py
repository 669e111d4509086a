"""Settings of fine-tuning, which camera, codes, noise and network are no part of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from tmca.errors import SettingError
from tmca.specs import Spec
from tmca.specs.base import Whole
from tmca.training.settings import BatchSettings, DecoderRate, RunSettings, checked_settings

_OPEN = ("data", "optimiser", "precision", "validate_every", "checkpoint_every", "seed")


class FileSource(Spec):
    """A file or folder, and its SHA-256."""

    path: str
    sha256: str


class PairSource(Spec):
    """A capture and its truth."""

    capture: FileSource
    truth: FileSource


class TuningData(BatchSettings):
    """Captures by their names; those of ``validation`` are held out, and choose the step that is saved."""

    patch: Whole | None = None
    """Rows of the windows of captures, and columns where the optics mix none; all without, or 256 of captures with
    more."""
    batch: Whole = 2
    "Windows per step, over all processes."


class TuningOptimiser(DecoderRate):
    """Length and learning rate; loss, ``depth_weight`` and ``clip`` are those of the run before."""

    steps: Whole = 200
    decoder_rate: float = Field(default=1e-4, gt=0)
    depth_weight: float = Field(default=0.1, ge=0)


class TuningSettings(RunSettings):
    """A whole run of fine-tuning."""

    weights: FileSource
    "Of the run before."
    calibration: FileSource | None = None
    "Of the camera; None for the run's own operator."
    captures: dict[str, PairSource]
    "By their names."
    data: TuningData
    optimiser: TuningOptimiser = TuningOptimiser()
    validate_every: Whole = 20


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
