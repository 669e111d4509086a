"""What a sweep varies: settings of a camera, its sensor, its decoder and faults of its bench, and their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import isfinite
from typing import Any

from tmca.arguments import checked_settings
from tmca.cameras import LIMITS, PAIRS, PARTS, Hardware
from tmca.decoders import decoders_for, make_decoder, settings_of
from tmca.errors import SettingError
from tmca.evaluation.camera import CameraEvaluation, evaluation_of
from tmca.evaluation.grid import Settings
from tmca.evaluation.study import read_study
from tmca.evaluation.study_parts import StudyNetwork
from tmca.evaluation.tables import check_counts, decoder_labels
from tmca.evaluation.trained import check_weights

SENSOR = {"noise": "read_noise", "read_noise": "read_noise", "full_well": "full_well",
          "read_noise_electrons": "read_noise_electrons", "bits": "bits"}  # fmt: skip
WHOLE = ("slots", "buckets", "bits", "period", "planes", "seed")
OPTION = "decoder."
"""Before the name of a setting of a decoder."""
Values = Mapping[str, Sequence[Any]]
Point = dict[str, Any]


@dataclass(frozen=True)
class Sweep:
    """Settings that are varied, over test scenes.

    Args:
        camera: its kind.
        vary: setting → its values; names of ``axes`` (``noise`` is the read noise).
        scenes: test scenes.
        reading: how scenes are read, as the camera's evaluation says.
        fixed: settings of all combinations.
        decoder: name of the decoder, unless it is varied; networks are trained at every combination.
        train: scenes of priors, searched codes and networks; the rendered training scenes' prior if empty.
        validation: scenes that choose a network's best step; some training scenes are set aside without any.
        steps: of each training.
        effort: of each search of codes.

    Raises:
        SettingError: an unknown or empty axis, or a combination that makes no camera.
    """

    camera: str
    vary: Values
    scenes: Sequence[str]
    reading: Settings
    fixed: Mapping[str, Any] = field(default_factory=dict)
    decoder: str = "lmmse"
    train: Sequence[str] = ()
    validation: Sequence[str] = ()
    steps: int = 300
    effort: Settings = field(default_factory=lambda: {"descents": 2, "steps": 120, "flips": 2000})

    def __post_init__(self) -> None:
        check_counts(steps=self.steps)
        object.__setattr__(self, "vary", self._converted(self.vary, "--vary"))
        fixed = self._converted({name: [value] for name, value in self.fixed.items()}, "--set")
        settled = {"decoder": self.decoder, **{name: values[0] for name, values in fixed.items()}}
        object.__setattr__(self, "fixed", settled)

    @property
    def evaluation(self) -> CameraEvaluation:
        """The camera's evaluation."""
        return evaluation_of(self.camera)

    @property
    def learned(self) -> list[str]:
        """Scenes that priors and codes are learned from: the given ones, or rendered ones where the camera's evaluation
        learns from these itself."""
        return [*self.train] or self.evaluation.usual_train()

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults of the bench, that decoders do not know of."""
        return tuple(name for name in LIMITS if name not in PARTS.get(self.camera, LIMITS))

    @property
    def axes(self) -> tuple[str, ...]:
        """Everything that can be varied; of decoders the settings of those that are asked for."""
        known = decoders_for(self.camera, moving=None)
        asked = {self.decoder, str(self.fixed.get("decoder", "")), *map(str, self.vary.get("decoder", ()))}
        options = {f"{OPTION}{one.name}" for name in asked & set(known) for one in settings_of(known[name])}
        return (*SENSOR, *self.evaluation.swept, "buckets", "decoder", "seed", *sorted(options), *self.faults)

    @property
    def networks(self) -> Mapping[str, StudyNetwork]:
        """That are trained at every combination: those of `tmca compare`, where the camera's sweeps have any."""
        return read_study(self.camera).networks if self.evaluation.sweeps_networks else {}

    @property
    def labels(self) -> dict[str, str]:
        """Decoders as tables show them."""
        shown = {name: network.label for name, network in self.networks.items()}
        return decoder_labels(self.camera, {**self.evaluation.labels, **shown})

    def points(self) -> list[Point]:
        """Every combination of the varied settings, with the fixed ones, each of which makes a camera."""
        if not self.vary:
            raise SettingError("--vary", "nothing", "at least one, such as slots=2,4,8")
        both = sorted(set(self.vary) & set(self.fixed) - {"decoder"})
        if both:
            raise SettingError("--set", both[0], "a setting that is not varied", "leave one of the two out")
        for name, values in self.vary.items():
            if not values or len(set(map(str, values))) < len(values):
                raise SettingError("--vary", f"{name} = {list(values)}", "different values, separated by commas")
        points = [{**self.fixed, **dict(zip(self.vary, each, strict=True))} for each in product(*self.vary.values())]
        for point in points:
            if point["decoder"] not in self.labels:
                raise SettingError("decoder", repr(point["decoder"]), f"one of {', '.join(self.labels)}")
            self.evaluation.check_point(self.camera_of(point), self.sensor_of(point))
            self.faults_of(point)
            self.options_of(point)
        return points

    def camera_of(self, point: Point) -> Settings:
        """Arguments of the camera in a combination, and what else of it is varied."""
        return {name: value for name, value in point.items() if name in (*self.evaluation.swept, "buckets", "seed")}

    def sensor_of(self, point: Point) -> Settings:
        """Arguments of the sensor in a combination."""
        return {SENSOR[name]: value for name, value in point.items() if name in SENSOR}

    def faults_of(self, point: Point) -> Settings:
        """Faults of the bench in a combination; a SettingError for impossible ones."""
        hardware = Hardware.of({name: value for name, value in point.items() if name in self.faults})
        hardware.check(self.camera, int(point.get("buckets", 1)))
        return hardware.faults()

    def options_of(self, point: Point) -> Settings:
        """Settings of the decoder in a combination; a SettingError for those that it does not have."""
        texts = {name.removeprefix(OPTION): value for name, value in point.items() if name.startswith(OPTION)}
        known = decoders_for(self.camera, moving=None)
        check_weights(point["decoder"], texts, self.camera, "--set decoder.weights")
        if not texts:
            return {}
        if point["decoder"] not in known:
            raise SettingError(f"{OPTION}{next(iter(texts))}", f"a setting of {point['decoder']}", "none of a network")
        settings = checked_settings(known[point["decoder"]], texts, texts=True)
        make_decoder(point["decoder"], self.camera, settings)
        return settings

    def _converted(self, settings: Values, option: str) -> dict[str, list[Any]]:
        """Values of the type that each setting has: whole numbers, numbers or words."""
        for name in settings:
            if name not in self.axes:
                raise SettingError(option, name, f"one of {', '.join(self.axes)}")
        if {"noise", "read_noise"} <= set(settings):
            raise SettingError(option, "noise and read_noise", "one of them", "they are the same")
        whole = {name for name, value in self.evaluation.application.settings().items() if isinstance(value, int)}
        words = {*self.evaluation.words, "decoder"}

        def converted(name: str, value: Any) -> Any:
            if name in words or name.startswith(OPTION):
                return str(value)
            return _number(name, value, name in whole or name in WHOLE, option)

        return {name: [converted(name, value) for value in values] for name, values in settings.items()}


def _number(name: str, value: Any, whole: bool, option: str) -> Any:
    if name in PAIRS and ":" in str(value):
        Hardware.of({name: value})
        return str(value)
    try:
        number = float(value)
        if whole and not number.is_integer():
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        wanted = "whole numbers" if whole else "numbers"
        raise SettingError(option, f"{name} = {value}", wanted) from None
    if not isfinite(number):
        raise SettingError(option, f"{name} = {value}", "finite numbers")
    return int(number) if whole else number
