"""Settings of a training run: one description, from YAML, presets and options; what all cameras share."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from tmca.errors import DataError, SettingError

Share = Annotated[float, Field(ge=0)]
Pixels = Annotated[int, Field(ge=1)]
Steepness = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Model = TypeVar("Model", bound=BaseModel)


class Strict(BaseModel):
    """Unknown names are refused, values are not changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


class CameraSettings(Strict):
    """The camera of a run; names as in its class. ``learn`` says which codes are learned."""

    size: tuple[int, int] = (256, 256)
    slots: int = Field(default=8, ge=1)
    exposure: Literal["equal", "per-slot"] = "equal"
    seed: int = 0
    learn: Any = "none"


class MaskCameraSettings(CameraSettings):
    """A camera whose masks have pixels that are open or shut.

    ``period`` tiles the codes: a tile is seen in every step, a full frame rarely.
    """

    aperture: str = "random"
    shutter: str = "random"
    transmittance: float = Field(default=0.5, gt=0, lt=1)
    duty: float = Field(default=0.5, gt=0, lt=1)
    period: Pixels | tuple[Pixels, Pixels] | None = None
    learn: Literal["both", "aperture", "shutter", "none"] = "none"


class NoiseSettings(Strict):
    """One sensor; names as in ``Sensor``."""

    read_noise: float = Field(default=0.0, ge=0)
    full_well: float | None = Field(default=None, gt=0)
    read_noise_electrons: float = Field(default=0.0, ge=0)
    bits: int | None = Field(default=None, ge=1, le=32)


class LearningSettings(Strict):
    """How the codes of any camera are learned.

    Args:
        start: ``"random"`` (the camera's families), ``"one-hot"`` shutter, or a trained run, weights file or file of
            `tmca design` whose static or multiplexed code is taken over.
        slope: of the surrogate derivative, first and last; raised geometrically.
        frozen: share of the run, at its end, in which the codes stay as they are and only the decoder learns.
        decoder: a trained run or weights file whose decoder is taken over at the start.
    """

    start: str = "random"
    slope: tuple[Steepness, Steepness] = (4.0, 40.0)
    frozen: float = Field(default=0.2, ge=0, lt=1)
    decoder: str | None = None


class CodeSettings(LearningSettings):
    """How masks of pixels that are open or shut are learned; ``LearningSettings`` says what is not said here.

    Args:
        throughput: light throughput wanted, share of a white scene's light; None leaves it free.
        hold: ``"penalty"`` adds ``penalty · (throughput - target)²`` to the loss, ``"hard"`` keeps it at the target.
        penalty: weight of the penalty.
        through_start: the codes' gradient passes through the first estimate (LMMSE) as well as the network.
    """

    throughput: float | None = Field(default=None, gt=0, lt=1)
    hold: Literal["penalty", "hard"] = "penalty"
    penalty: float = Field(default=10.0, ge=0)
    through_start: bool = True


class DataSettings(Strict):
    """Scenes and patches.

    Args:
        train: cubes, rendered scenes, or split files (``.txt``) of them.
        validation: the same; if empty, ``shares`` of ``train`` are set aside, and left out of ``prior``.
        shares: of training, validation and test scenes where no validation scenes are given.
        bands: nearest to even spacing from 400 to 700 nm.
        patch: side of the square patches, pixels.
        batch: patches per step, over all processes.
        patches_per_scene: patches of each scene that make an epoch.
        brightness: patches are made darker by up to this many stops, or brighter by one.
        tint: standard deviation of a random smooth change of the spectrum, natural logarithm.
        motion: largest motion of the scene within the exposure, pixels; needs a single disperser.
        pool: while codes stay as they are, batches are drawn from this many patches, whose snapshots and first
            estimates are made once; 0 makes new ones in every step.
        prior: scenes of the prior of the first estimate; if empty, those of ``train``; ``rendered`` alone takes the
            prior of the rendered scenes, which weights need not bring along.
    """

    train: tuple[str, ...] = ()
    validation: tuple[str, ...] = ()
    shares: tuple[Share, Share, Share] = (0.8, 0.1, 0.1)
    bands: int = Field(default=12, ge=1)
    patch: int = Field(default=64, ge=4)
    batch: int = Field(default=16, ge=1)
    patches_per_scene: int = Field(default=64, ge=1)
    brightness: float = Field(default=3.0, ge=0)
    tint: float = Field(default=0.2, ge=0)
    motion: float = Field(default=0.0, ge=0)
    pool: int = Field(default=0, ge=0)
    prior: tuple[str, ...] = ()


class OptimiserSettings(Strict):
    """Length of the run, learning rates per group, loss.

    Args:
        steps: optimiser steps; None takes ``epochs``.
        epochs: passes over ``patches_per_scene`` patches of every scene.
        decoder_rate: learning rate of the decoder (AdamW), cosine decay.
        code_rate: learning rate of the codes' latent values (Adam).
        warmup: share of the run in which the decoder's rate rises.
        clip: largest norm of the decoder's gradient; 0 for none.
        loss: ``"l2"``, ``"l1"`` ``"charbonnier"`` or ``"log"`` (mean PSNR).
    """

    steps: int | None = Field(default=None, ge=1)
    epochs: int = Field(default=500, ge=1)
    decoder_rate: float = Field(default=1e-3, gt=0)
    code_rate: float = Field(default=0.03, ge=0)
    warmup: float = Field(default=0.05, ge=0, lt=1)
    clip: float = Field(default=1.0, ge=0)
    loss: Literal["l2", "l1", "charbonnier", "log"] = "l2"

    def code_rates(self) -> dict[str, float]:
        """Largest learning rate of every group of codes."""
        return {"codes": self.code_rate}


class TrainSettings(Strict):
    """A whole run of any camera.

    ``faults`` gives the least and largest value of faults of the bench (``tmca.cameras.Hardware``), which are drawn in
    every step; a single number stands for both.
    """

    kind: ClassVar[str]
    """Of the camera."""
    camera: CameraSettings = CameraSettings()
    noise: tuple[NoiseSettings, ...] = (NoiseSettings(),)
    decoder: dict[str, Any] = {"kind": "unrolled"}
    codes: LearningSettings = LearningSettings()
    data: DataSettings = DataSettings()
    optimiser: OptimiserSettings = OptimiserSettings()
    precision: Literal["auto", "32-true", "bf16-mixed"] = "auto"
    validate_every: int = Field(default=100, ge=1)
    checkpoint_every: int = Field(default=50, ge=1)
    seed: int = 0
    faults: dict[str, tuple[float, float]] = Field(default={})

    @field_validator("faults", mode="before")
    @classmethod
    def _ranges(cls, value: Any) -> Any:
        alone = isinstance(value, Mapping)
        return {n: (v, v) if isinstance(v, int | float) else v for n, v in value.items()} if alone else value

    @field_validator("noise")
    @classmethod
    def _some_noise(cls, value: tuple[NoiseSettings, ...]) -> tuple[NoiseSettings, ...]:
        if not value:
            raise ValueError("at least one sensor")
        return value

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not sum(self.data.shares) > 0:
            raise ValueError(f"shares of {self.data.shares}: at least one above 0")
        if self.codes.start == "one-hot" and self.camera.slots == 1:
            raise ValueError("codes.start one-hot needs more than one slot")
        if self.data.patch > min(self.camera.size):
            raise ValueError(f"patches of {self.data.patch} pixels do not fit a camera of {self.camera.size}")
        return self


class MaskTrainSettings(TrainSettings):
    """A whole run of a camera whose masks have pixels that are open or shut."""

    camera: MaskCameraSettings = MaskCameraSettings()
    codes: CodeSettings = CodeSettings()

    @model_validator(mode="after")
    def _learns(self) -> Self:
        if self.codes.throughput is not None and self.camera.learn == "none":
            raise ValueError("codes.throughput needs learned codes: set camera.learn")
        return self


def merged_settings(
    model: type[Model],
    presets: Mapping[str, dict[str, Any]],
    preset: str | None = None,
    file: str | Path | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Model:
    """A preset, replaced by a YAML file, replaced by single changes.

    Args:
        model: of the settings.
        presets: by name.
        preset: one of them; None starts from that of the file, or the defaults.
        file: YAML with the names of the model; it may name a ``preset``.
        changes: dotted names and values, such as ``{"optimiser.steps": 300}``.

    Raises:
        SettingError: unknown preset or name, impossible value.
        DataError: the file cannot be read.
    """
    described = {} if file is None else _yaml(Path(file))
    name = described.pop("preset", None) if preset is None else preset
    described.pop("preset", None)
    if name is not None and name not in presets:
        raise SettingError("preset", repr(name), f"one of {', '.join(presets)}")
    merged = _merge({} if name is None else presets[name], described)
    for path, value in (changes or {}).items():
        merged = _merge(merged, _nested(path.split("."), value))
    return checked_settings(model, merged, str(file or name or "settings"))


def checked_settings(model: type[Model], described: Mapping[str, Any], where: str) -> Model:
    """Raises SettingError for the first thing that is wrong, with its dotted name."""
    try:
        return model.model_validate(dict(described))
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"]) or where
        if first["type"] == "extra_forbidden":
            names = _names(name, model)
            raise SettingError(name, "an unknown name", "one of the documented settings", names) from None
        expected = first["msg"].removeprefix("Value error, ").replace(" after validation", "")
        found = repr(first.get("input")) if first["loc"] else "settings that do not go together"
        raise SettingError(name, found, expected) from None


def _names(dotted: str, model: Any) -> str:
    """The names that exist beside an unknown one."""
    for part in dotted.split(".")[:-1]:
        model = getattr(model.model_fields.get(part), "annotation", None)
        if not hasattr(model, "model_fields"):
            return ""
    return f"there are {', '.join(model.model_fields)}"


def _yaml(file: Path) -> dict[str, Any]:
    import yaml

    try:
        described = yaml.safe_load(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DataError(file, "no such file", "a YAML description of a run") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise DataError(file, f"no readable YAML ({' '.join(str(error).split())})", "a YAML description") from None
    if not isinstance(described, dict):
        raise DataError(file, f"a {type(described).__name__}", "names and values, such as `camera: {slots: 8}`")
    return described


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes``, dictionaries within merged; another kind of decoder starts from nothing."""
    merged = dict(base)
    for name, value in changes.items():
        old = merged.get(name)
        if not isinstance(old, Mapping) or not isinstance(value, Mapping):
            merged[name] = value
            continue
        fresh = name == "decoder" and value.get("kind", old.get("kind")) != old.get("kind")
        merged[name] = value if fresh else _merge(old, value)
    return merged


def _nested(path: list[str], value: Any) -> dict[str, Any]:
    return {path[0]: value if len(path) == 1 else _nested(path[1:], value)}
