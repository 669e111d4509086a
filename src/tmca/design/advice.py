"""What codes to use with a given sensor, from the expected error of designs alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor
from statistics import stdev
from typing import Any

from tmca.arguments import checked
from tmca.design.kinds import designable, hold_throughput
from tmca.design.search import SURVEY, Design, Effort, Parts, Progress, decibels, search
from tmca.design.transfer import Examples
from tmca.errors import SettingError, check_range
from tmca.sensor import Sensor

SLOTS = (2, 4, 8, 16)
"""Numbers of slots that are tried."""
_FLIP = 0.1
"""Steps of a descent that take as long as a flip."""
WORTH = 0.1
"""Gain in dB below which more than one slot is not worth it."""
_LIGHT = 0.02
"""How far the light of codes may be from the share that is asked for."""


@checked
@dataclass(frozen=True)
class SensorSheet:
    """A sensor and its modulator as their data sheets give them.

    Args:
        full_well: electrons at full scale, a white scene with everything open; None for no shot noise.
        read_noise_electrons: standard deviation, electrons; needs ``full_well``.
        read_noise: standard deviation in snapshot units, where electrons are not known.
        bits: of the converter; None for none.
        exposure: time of one snapshot, seconds; None sets no limit to the slots.
        pattern_rate: most patterns per second of the slower of aperture and shutter, Hz.
        slot_time: shortest time that a pattern may be shown, seconds.

    Raises:
        SettingError: a number that is impossible.
    """

    full_well: float | None = None
    read_noise_electrons: float = 0.0
    read_noise: float = 0.0
    bits: int | None = None
    exposure: float | None = None
    pattern_rate: float | None = None
    slot_time: float | None = None

    def __post_init__(self) -> None:
        for name in ("exposure", "pattern_rate", "slot_time"):
            if getattr(self, name) is not None:
                check_range(name, getattr(self, name), above=0)
        if self.exposure is None and (self.pattern_rate or self.slot_time):
            raise SettingError("exposure", "none beside a pattern rate or slot time", "the exposure time in seconds")
        self.sensor()

    def sensor(self) -> Sensor:
        """As the camera's sensor."""
        return Sensor(
            read_noise=self.read_noise, full_well=self.full_well, read_noise_electrons=self.read_noise_electrons,
            bits=self.bits,
        )  # fmt: skip

    @property
    def most_slots(self) -> int | None:
        """Slots that fit the exposure; None where nothing limits them."""
        return floor(self.exposure / self.shortest * (1 + 1e-9)) if self.exposure and self.shortest else None

    @property
    def shortest(self) -> float:
        """Time that a pattern needs, seconds; 0 where nothing limits it."""
        return max(1 / self.pattern_rate if self.pattern_rate else 0.0, self.slot_time or 0.0)

    def allowed(self, slots: Sequence[int] | None) -> list[int]:
        """Numbers of slots above 1 to try: those asked for, or those of ``SLOTS`` that fit.

        Raises:
            SettingError: one that is asked for does not fit the exposure.
        """
        most, remedy = self.most_slots, "expose longer, or use faster patterns"
        if most == 0:
            text = f"{self.exposure:g} s, shorter than one pattern"
            raise SettingError("exposure", text, f"at least {self.shortest:g} s", remedy)
        if slots is None:
            return [k for k in SLOTS if most is None or k <= most]
        for k in slots:
            check_range("slots", k, 1)
            if most is not None and k > most:
                text = f"{k} slots in an exposure of {self.exposure:g} s"
                raise SettingError("slots", text, f"at most {most}", remedy)
        return sorted({k for k in slots if k > 1})


@dataclass(frozen=True)
class Candidate:
    """A design with what it is expected to gain.

    Args:
        design: codes.
        held_out: name of each example scene → PSNR (dB) with the prior of the others.
        gains: the same → gain over the static design (dB).
    """

    design: Design
    held_out: dict[str, float]
    gains: dict[str, float]

    @property
    def gain(self) -> float:
        """Mean over the example scenes, dB."""
        return sum(self.gains.values()) / len(self.gains)

    @property
    def spread(self) -> float | None:
        """Standard deviation of a scene's gain, dB; None with one scene."""
        return stdev(self.gains.values()) if len(self.gains) > 1 else None


@dataclass(frozen=True)
class Advice:
    """Designs for a sensor, and which of them to use.

    Args:
        static: the static design.
        surveyed: designs after the survey, the static one, from which the others' gains are counted, first.
        chosen: the best of them, searched as long as the static one; None where one slot is all that fits.
        noise: (read noise, shot) in snapshot units.
        sheet: of the sensor.
        left_out: (kind, K) of codes that cannot let through the share of light that was asked for.
        throughput: that share; None where the light is free.
    """

    static: Candidate
    surveyed: list[Candidate]
    chosen: Candidate | None
    noise: tuple[float, float]
    sheet: SensorSheet
    left_out: tuple[tuple[str, int], ...] = ()
    throughput: float | None = None

    @property
    def multiplex(self) -> bool:
        """Whether more than one slot is worth it."""
        return self.chosen is not None and self.chosen.gain >= WORTH

    @property
    def best(self) -> Candidate:
        """The design to use."""
        return self.chosen if self.chosen is not None and self.multiplex else self.static


def advise(
    examples: Examples,
    sheet: SensorSheet,
    *,
    slots: Sequence[int] | None = None,
    kinds: Sequence[str] = ("free", "one-hot"),
    period: tuple[int, int] = (32, 32),
    survey: Effort = SURVEY,
    effort: Effort | None = None,
    throughput: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    **camera: Any,
) -> Advice:
    """Search static and time-multiplexed codes for a sensor with the same effort, at equal exposure time.

    A survey tries everything; the best of it and the static code are then searched with more effort.

    Args:
        examples: scenes to design for; gains are judged on each of them under the prior of the others.
        sheet: sensor and modulator.
        slots: numbers of slots to try; those of ``SLOTS`` that fit the exposure without.
        kinds: structures of codes to try; free codes also start from the static design, which they contain.
        period: (rows, columns) of the tile, pixels.
        survey: effort of each search of the survey.
        effort: of the last two searches.
        throughput: share of light that all codes shall let through, kinds that cannot are left out; free if None.
        seed: of the random codes.
        progress: called with the share that is done and what is done.
        camera: ``camera_type`` and further arguments of it, see ``designable``.

    Raises:
        SettingError: impossible sensor, slots that do not fit, unknown kind.
    """
    noise = sheet.sensor().noise(designable("static", 1, period, **camera).full_scale)
    task = _Task(examples, (noise.read, noise.shot), period, throughput, seed, camera)
    kinds = sorted(dict.fromkeys(kinds), key=lambda kind: kind == "free")  # which then starts from the others
    asked = [(kind, k) for k in sheet.allowed(slots) for kind in kinds]
    plan = [(kind, k) for kind, k in asked if task.reaches(kind, k)]
    out = tuple(sorted(set(asked) - set(plan)))
    effort = effort or Effort()
    searches = [survey] * (len(plan) + 1) + [effort] * 2
    part = Parts(progress, [each.descents * each.steps + _FLIP * each.flips for each in searches])
    static = task.candidate("static", 1, survey, part("survey: static"))
    surveyed = [static]
    for kind, k in plan:
        starts = _contained(surveyed, k) if kind == "free" else []
        surveyed.append(task.candidate(kind, k, survey, part(f"survey: {kind}, K = {k}"), starts, static))
    final, chosen = task.candidate("static", 1, effort, part("static"), [static]), None
    if (best := _best(surveyed[1:])) is not None:
        kind, k = best.design.kind, best.design.slots
        starts = [best, final] if kind == "free" else [best]
        chosen = task.candidate(kind, k, effort, part(f"{kind}, K = {k}"), starts, final)
    return Advice(final, surveyed, chosen, task.noise, sheet, out, throughput)


def _contained(candidates: Sequence[Candidate], slots: int) -> list[Candidate]:
    """Designs that free codes of so many slots contain: the best one of fewer slots, and those of as many, all of one
    bucket."""
    candidates = [c for c in candidates if c.design.camera.buckets == 1]
    fewer = [c for c in candidates if c.design.slots < slots and slots % c.design.slots == 0]
    return [min(fewer, key=lambda c: c.design.mse), *(c for c in candidates if c.design.slots == slots)]


def _best(candidates: Sequence[Candidate]) -> Candidate | None:
    """Of those within ``WORTH`` of the largest gain, the one with the fewest slots; None without candidates."""
    top = max((c.gain for c in candidates), default=0.0)
    near = [c for c in candidates if c.gain >= top - WORTH]
    return min(near, key=lambda c: (c.design.slots, -c.gain)) if near else None


@dataclass(frozen=True)
class _Task:
    """What all searches of an advice share."""

    examples: Examples
    noise: tuple[float, float]
    period: tuple[int, int]
    throughput: float | None
    seed: int
    camera: dict[str, Any]

    def reaches(self, kind: str, slots: int) -> bool:
        """Whether codes of a kind can let through the share of light that is asked for."""
        if self.throughput is None:
            return True
        camera = designable(kind, slots, self.period, seed=self.seed, **self.camera)
        hold_throughput(camera, self.throughput)
        return abs(camera.throughput() - self.throughput) < _LIGHT

    def candidate(
        self,
        kind: str,
        slots: int,
        effort: Effort,
        progress: Callable[[float], None],
        starts: Sequence[Candidate] = (),
        static: Candidate | None = None,
    ) -> Candidate:
        """The best design of a kind; gains are counted from the static design, its own without."""
        design = search(
            kind, slots, self.period, self.examples.tile_mse(*self.noise),
            starts=[start.design.camera for start in starts], effort=effort, throughput=self.throughput,
            seed=self.seed, progress=progress, **self.camera,
        )  # fmt: skip
        held_out = {n: decibels(v) for n, v in self.examples.held_out(design.camera, *self.noise).items()}
        before = static.held_out if static else held_out
        return Candidate(design, held_out, {name: psnr - before[name] for name, psnr in held_out.items()})
