"""Settings of a training run: one description, from YAML, presets and options; what all cameras share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, pi
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import Field, ValidationError, field_validator, model_validator

from tmca.errors import SettingError, did_you_mean
from tmca.specs import SensorSpec, Spec, first_error
from tmca.specs.base import BANDS, Pixels, Slots, Whole

Share = Annotated[float, Field(ge=0)]
Steepness = Annotated[float, Field(gt=0)]
Model = TypeVar("Model", bound=Spec)


class CameraSettings(Spec):
    """The camera of a run; names as in its class."""

    size: tuple[Pixels, Pixels] = (256, 256)
    "(H, W) of its scenes, pixels."
    slots: Slots = 8
    "Time slots K within the exposure."
    exposure: Literal["equal", "per-slot"] = "equal"
    "Whether the slots share one exposure time, or each has its own."
    seed: int = 0
    "Of the codes."
    buckets: Annotated[int, Field(ge=1, le=256)] = 1
    "Of a sensor pixel; with 2, the light of closed slots is read too."
    learn: Any = "none"
    "Which codes are learned."


class MaskCameraSettings(CameraSettings):
    """A camera whose masks have pixels that are open or shut."""

    aperture: str = "random"
    "Family of the aperture codes."
    shutter: str = "random"
    "Family of the shutter codes."
    transmittance: float = Field(default=0.5, gt=0, lt=1)
    "Share of open aperture pixels."
    duty: float = Field(default=0.5, gt=0, lt=1)
    "Share of open shutter pixels."
    period: Pixels | tuple[Pixels, Pixels] | None = None
    "Tile of the codes, which is seen in every step; a full frame is seen rarely."
    learn: Literal["both", "aperture", "shutter", "none"] = "none"


class LearningSettings(Spec):
    """How the codes of any camera are learned."""

    start: str = "random"
    """``"random"`` (the camera's families), ``"one-hot"`` shutter, or a trained run, weights file or file of
    `tmca design` whose static or multiplexed code is taken over."""
    slope: tuple[Steepness, Steepness] = (4.0, 40.0)
    "Of the surrogate derivative, first and last; raised geometrically."
    frozen: float = Field(default=0.2, ge=0, lt=1)
    "Share of the run, at its end, in which the codes stay as they are and only the decoder learns."
    decoder: str | None = None
    "A trained run or weights file whose decoder is taken over at the start."


class CodeSettings(LearningSettings):
    """How masks of pixels that are open or shut are learned."""

    throughput: float | None = Field(default=None, gt=0, lt=1)
    "Light throughput wanted, share of a white scene's light; None leaves it free."
    hold: Literal["penalty", "hard"] = "penalty"
    """``"penalty"`` adds ``penalty · (throughput - target)²`` to the loss, ``"hard"`` keeps it at the target."""
    penalty: Share = 10.0
    "Weight of the penalty."
    through_start: bool = True
    "The codes' gradient passes through the first estimate (LMMSE) as well as the network."


class BatchSettings(Spec):
    """What a step learns from."""

    train: tuple[str, ...] = ()
    "Cubes, rendered scenes, or split files (``.txt``) of them."
    validation: tuple[str, ...] = ()
    "The same; if empty, ``shares`` of ``train`` are set aside, and left out of ``prior``."
    batch: Annotated[int, Field(ge=1, le=65536)] = 16
    "Patches per step, over all processes."


class DataSettings(BatchSettings):
    """Scenes and patches."""

    shares: tuple[Share, Share, Share] = (0.8, 0.1, 0.1)
    "Of training, validation and test scenes where no validation scenes are given."
    bands: Annotated[int, Field(ge=1, le=BANDS)] = 12
    "Nearest to even spacing from 400 to 700 nm."
    patch: int = Field(default=64, ge=4, le=32768)
    "Side of the square patches, pixels."
    patches_per_scene: Annotated[int, Field(ge=1, le=10**6)] = 64
    "Patches of each scene that make an epoch."
    brightness: Share = 3.0
    "Patches are made darker by up to this many stops, or brighter by one."
    tint: Share = 0.2
    "Standard deviation of a random smooth change of the spectrum, natural logarithm."
    motion: Share = 0.0
    "Largest motion of the scene within the exposure, pixels; needs a single disperser."
    pool: int = Field(default=0, ge=0, le=10**7)
    """While codes stay as they are, batches are drawn from this many patches, whose snapshots and first estimates are
    made once; 0 makes new ones in every step."""
    prior: tuple[str, ...] = ()
    """Scenes of the prior of the first estimate; if empty, those of ``train``; ``rendered`` alone takes the prior of
    the rendered scenes, which weights need not bring along."""


class DecoderRate(Spec):
    """How a decoder learns."""

    decoder_rate: float = Field(default=1e-3, gt=0)
    "Learning rate of the decoder (AdamW), cosine decay."
    warmup: float = Field(default=0.05, ge=0, lt=1)
    "Share of the run in which the decoder's rate rises."
    clip: Share = 1.0
    "Largest norm of the decoder's gradient; 0 for none."
    loss: Literal["l2", "l1", "charbonnier", "log"] = "l2"
    "Mean square, absolute or Charbonnier error, or its logarithm (mean PSNR)."

    def decoder_rate_at(self, step: int, steps: int) -> float:
        """A linear rise over ``warmup`` of the run, then a cosine to 1 % of the peak."""
        rise = self.warmup * steps
        if step < rise:
            return self.decoder_rate * (step + 1) / (rise + 1)
        share = (step - rise) / max(steps - rise, 1)
        return self.decoder_rate * (0.01 + 0.99 * 0.5 * (1 + cos(pi * share)))


class OptimiserSettings(DecoderRate):
    """Length of the run, learning rates per group, loss."""

    steps: Whole | None = None
    "Optimiser steps; None takes ``epochs``."
    epochs: Whole = 500
    "Passes over ``patches_per_scene`` patches of every scene."
    code_rate: Share = 0.03
    "Learning rate of the codes' latent values (Adam)."

    def code_rates(self) -> dict[str, float]:
        """Largest learning rate of every group of codes."""
        return {"codes": self.code_rate}


class RunSettings(Spec):
    """What every run has. Rates and slopes follow from the step alone, so that a resumed run goes on exactly."""

    kind: ClassVar[str]
    """Of the camera."""
    data: BatchSettings = BatchSettings()
    optimiser: DecoderRate = DecoderRate()
    precision: Literal["auto", "32-true", "bf16-mixed"] = "auto"
    "Of the network's layers; auto is half precision where the device computes it."
    validate_every: Whole = 100
    "Steps."
    checkpoint_every: Whole = 50
    "Steps."
    seed: int = 0
    "Of patches, noise, faults and the network."

    @property
    def starts_trained(self) -> bool:
        """Whether the decoder learned before: it may then be better than all that comes."""
        return True

    def rates(self, step: int, steps: int) -> dict[str, float]:
        """Learning rates of the decoder and of groups of codes."""
        return {"decoder": self.optimiser.decoder_rate_at(step, steps)}

    def slope(self, step: int, steps: int) -> float:
        """Slope of the surrogate derivative of codes."""
        return 1.0


class TrainSettings(RunSettings):
    """A whole run of any camera."""

    camera: CameraSettings = CameraSettings()
    noise: tuple[SensorSpec, ...] = Field(default=(SensorSpec(),), min_length=1)
    "Sensors, one of them in turn in each step."
    decoder: dict[str, Any] = Field(default={"kind": "unrolled"})
    "Kind of the network, and its settings."
    codes: LearningSettings = LearningSettings()
    data: DataSettings = DataSettings()
    optimiser: OptimiserSettings = OptimiserSettings()
    faults: dict[str, tuple[float, float]] = Field(default={})
    """Least and largest value of faults of the bench (``tmca.cameras.Hardware``), which are drawn in every step; a
    single number stands for both."""

    @field_validator("faults", mode="before")
    @classmethod
    def _ranges(cls, value: Any) -> Any:
        named = isinstance(value, Mapping)
        return {n: (v, v) if isinstance(v, int | float) else v for n, v in value.items()} if named else value

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not sum(self.data.shares) > 0:
            raise ValueError(f"shares of {self.data.shares}: at least one above 0")
        if self.codes.start == "one-hot" and self.camera.slots == 1:
            raise ValueError("codes.start one-hot needs more than one slot")
        if self.data.patch > min(self.camera.size):
            raise ValueError(f"patches of {self.data.patch} pixels do not fit a camera of {self.camera.size}")
        return self

    @property
    def starts_trained(self) -> bool:
        return self.codes.decoder is not None

    def steps(self, scenes: int) -> int:
        """Optimiser steps: as given, or those of its epochs."""
        epoch = max(1, -(-scenes * self.data.patches_per_scene // self.data.batch))
        return self.optimiser.steps or self.optimiser.epochs * epoch

    def rates(self, step: int, steps: int) -> dict[str, float]:
        """See `RunSettings`: those of codes are constant, then zero in the last ``frozen`` of the run."""
        learns = step < (1 - self.codes.frozen) * steps
        codes = {name: peak if learns else 0.0 for name, peak in self.optimiser.code_rates().items()}
        return codes | super().rates(step, steps)

    def slope(self, step: int, steps: int) -> float:
        """See `RunSettings`: raised geometrically until the codes are frozen (annealing)."""
        first, last = self.codes.slope
        return first * (last / first) ** min(step / max((1 - self.codes.frozen) * steps, 1), 1.0)


class MaskTrainSettings(TrainSettings):
    """A whole run of a camera whose masks have pixels that are open or shut."""

    camera: MaskCameraSettings = MaskCameraSettings()
    codes: CodeSettings = CodeSettings()

    @model_validator(mode="after")
    def _learns(self) -> Self:
        if self.codes.throughput is not None and self.camera.learn == "none":
            raise ValueError("codes.throughput needs learned codes: set camera.learn")
        return self


def checked_settings(
    model: type[Model],
    described: Mapping[str, Any],
    where: str,
    file: object = None,
    changes: Mapping[str, Any] | None = None,
) -> Model:
    """Raises SettingError for the first thing that is wrong, with its dotted name, and the file where it is not one of
    the changes."""
    try:
        return model.model_validate(dict(described))
    except ValidationError as error:
        place, wrong = error.errors()[0]["loc"], first_error(error)
        dotted = ".".join(map(str, place))
        name = dotted if file is None or dotted in (changes or {}) else f"{file}, {dotted}"
        name = name if dotted else where
        if error.errors()[0]["type"] == "extra_forbidden":
            names = _names(dotted, model)
            text = f"one of {', '.join(names)}" if names else "one of the documented settings"
            remedy = did_you_mean(dotted.rpartition(".")[2], names)
            raise SettingError(name, "an unknown name", text, remedy) from None
        found = wrong.found if place else "settings that do not go together"
        raise SettingError(name, found, wrong.expected) from None


def _names(dotted: str, model: Any) -> list[str]:
    """The names that exist beside an unknown one."""
    for part in dotted.split(".")[:-1]:
        model = getattr(model.model_fields.get(part), "annotation", None)
        if not hasattr(model, "model_fields"):
            return []
    return list(model.model_fields)


def merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Settings with changes, dictionaries within merged; another kind of decoder starts from nothing."""
    merged = dict(base)
    for name, value in changes.items():
        old = merged.get(name)
        if not isinstance(old, Mapping) or not isinstance(value, Mapping):
            merged[name] = value
            continue
        fresh = name == "decoder" and value.get("kind", old.get("kind")) != old.get("kind")
        merged[name] = value if fresh else merge(old, value)
    return merged


def nested(path: Sequence[str], value: Any) -> dict[str, Any]:
    """A value under a dotted name, as dictionaries."""
    return {path[0]: value if len(path) == 1 else nested(path[1:], value)}
