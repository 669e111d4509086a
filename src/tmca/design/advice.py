"""What codes to use with a given sensor, from the expected error of designs alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tmca.codes import BURST
from tmca.design.advised import WITHIN, WORTH, Advice, Candidate
from tmca.design.flips import MOST_TILE, tile_bytes
from tmca.design.kinds import designable, hold_throughput
from tmca.design.search import SURVEY, Effort, Parts, Progress, decibels, search
from tmca.design.sheet import SensorSheet, family_of
from tmca.design.transfer import Examples

_FLIP = 0.1
"""Steps of a descent that take as long as a flip."""
_LIGHT = 0.02
"""How far the light of codes may be from the share that is asked for."""
_READINGS = 4
"""Steps of one reading a pixel that take as long as a step of two."""


def advise(
    examples: Examples,
    sheet: SensorSheet,
    *,
    slots: Sequence[int] | None = None,
    kinds: Sequence[str] | None = None,
    period: tuple[int, int] = (32, 32),
    survey: Effort = SURVEY,
    effort: Effort | None = None,
    throughput: float | None = None,
    within: float = WITHIN,
    seed: int = 0,
    progress: Progress | None = None,
    **camera: Any,
) -> Advice:
    """Search static and time-multiplexed codes for a sensor with the same effort, at equal exposure time.

    A survey tries everything, and a burst of two frames, the rival, or of more where they are asked for. The static
    code, the burst and the best with one bucket and with two are then searched with more effort.

    Args:
        examples: scenes to design for; gains are judged on each of them under the prior of the others.
        sheet: sensor and modulator.
        slots: numbers of slots to try; those of ``SLOTS`` that fit the exposure without.
        kinds: structures of codes to try, see ``SensorSheet.kinds``; free codes also start from the static design,
            which they contain, those of two buckets from the burst. Bursts have two frames, or as many as ``slots``
            that are given.
        period: (rows, columns) of the tile, pixels.
        survey: effort of each search of the survey.
        effort: of the last searches; one descent where pixels are read twice, as each of its steps takes as long as
            four.
        throughput: share of light that all codes shall let through, kinds that cannot are left out; free if None.
        within: share of the largest gain in the survey that codes of fewer slots may lack to be taken, or ``WORTH`` dB
            where that is more.
        seed: of the random codes.
        progress: called with the share that is done and what is done.
        camera: ``camera_type`` and further arguments of it, see ``designable``.

    Raises:
        SettingError: impossible sensor, slots that do not fit, unknown kind.
    """
    noise = sheet.sensor().noise(designable("static", 1, period, **camera).full_scale)
    task = _Task(examples, (noise.read, noise.shot), period, throughput, seed, camera)
    asked = [(kind, k) for k in sheet.allowed(slots) for kind in sheet.kinds(kinds)]
    asked = [(kind, k) for kind, k in asked if kind != BURST or k == 2 or slots is not None]
    plan = [each for each in asked if task.reaches(*each)]
    out = tuple(sorted(set(asked) - set(plan)))
    if asked and task.has_rival():
        plan = list(dict.fromkeys([(BURST, 2), *plan]))
    effort = effort or Effort()
    families = list(dict.fromkeys(family_of(kind) for kind, _ in plan))
    part = Parts(progress, _lengths(plan, families, survey, effort))
    surveyed = task.surveyed(plan, survey, part)
    final = task.candidate("static", 1, effort, part("static"), surveyed[:1])
    best = {family: task.searched_on(_best(surveyed[1:], family, within), final, effort, part) for family in families}
    surveyed.sort(key=lambda candidate: candidate.design.kind == BURST)  # the rival last
    found = (best.get("one"), best.get("two"), best.get(BURST))
    return Advice(final, surveyed, *found, task.noise, sheet, out, throughput, within)


def _last(family: str, effort: Effort) -> Effort:
    """Of the last search of a family."""
    return effort if family == "one" else replace(effort, descents=1)


def _lengths(plan: Sequence[tuple[str, int]], families: Sequence[str], survey: Effort, effort: Effort) -> list[float]:
    """Of all searches, in steps of codes of one bucket."""
    searches = [(family_of(kind), survey) for kind, _ in [("static", 1), *plan]]
    searches += [("one", effort), *((family, _last(family, effort)) for family in families)]
    return [
        (each.descents * each.steps + _FLIP * each.flips) * (1 if family == "one" else _READINGS)
        for family, each in searches
    ]


def _starts_of(candidates: Sequence[Candidate], kind: str, slots: int) -> list[Candidate]:
    """Designs that codes of a kind with so many slots contain: free codes the best one of fewer slots, and those of as
    many, all of one bucket; codes of two buckets the best one of two, bursts among them; a burst the best shorter
    one."""
    divisors = [c for c in candidates if slots % c.design.slots == 0]
    if family_of(kind) == "two":
        twice = [c for c in divisors if c.design.camera.buckets == 2]
        return [min(twice, key=lambda c: c.design.mse)] if twice else []
    if kind == BURST:
        bursts = [c for c in divisors if c.design.kind == BURST]
        return [min(bursts, key=lambda c: c.design.mse)] if bursts else []
    if kind != "free":
        return []
    divisors = [c for c in divisors if c.design.camera.buckets == 1]
    fewer = [c for c in divisors if c.design.slots < slots]
    return [min(fewer, key=lambda c: c.design.mse), *(c for c in divisors if c.design.slots == slots)]


def _best(candidates: Sequence[Candidate], family: str, within: float) -> Candidate:
    """Of those of a family within ``WORTH``, or a share, of the largest gain, the one with the fewest slots."""
    candidates = [c for c in candidates if family_of(c.design.kind) == family]
    top = max(c.gain for c in candidates)
    near = [c for c in candidates if c.gain >= top - max(WORTH, within * top)]
    return min(near, key=lambda c: (c.design.slots, -c.gain))


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

    def has_rival(self) -> bool:
        """Whether a burst of two frames can be searched: it fits the memory, and the share of light."""
        twice = self.examples.model.for_buckets(2)
        return tile_bytes(twice, self.period) <= MOST_TILE and self.reaches(BURST, 2)

    def surveyed(self, plan: Sequence[tuple[str, int]], effort: Effort, part: Parts) -> list[Candidate]:
        """The static design, and those of a plan (kind, K), which may start from the ones before them."""
        static = self.candidate("static", 1, effort, part("survey: static"))
        found = [static]
        for kind, k in plan:
            starts = _starts_of(found, kind, k)
            found.append(self.candidate(kind, k, effort, part(f"survey: {kind}, K = {k}"), starts, static))
        return found

    def searched_on(self, start: Candidate, static: Candidate, effort: Effort, part: Parts) -> Candidate:
        """A design of the survey, searched with more effort; free codes start from the static one too."""
        kind, k = start.design.kind, start.design.slots
        starts = [start, static] if kind == "free" else [start]
        how = _last(family_of(kind), effort)
        return self.candidate(kind, k, how, part(f"{kind}, K = {k}"), starts, static)

    def candidate(
        self,
        kind: str,
        slots: int,
        effort: Effort,
        progress: Callable[[float], None],
        starts: Sequence[Candidate] = (),
        static: Candidate | None = None,
    ) -> Candidate:
        """The best design of a kind, from the best of its starts if there are fewer descents; gains are counted from
        the static design, its own without."""
        if effort.descents < len(starts):
            starts = sorted(starts, key=lambda start: start.design.mse)
        design = search(
            kind, slots, self.period, self.examples.tile_mse(*self.noise),
            starts=[start.design.camera for start in starts], effort=effort, throughput=self.throughput,
            seed=self.seed, progress=progress, **self.camera,
        )  # fmt: skip
        held_out = {n: decibels(v) for n, v in self.examples.held_out(design.camera, *self.noise).items()}
        before = static.held_out if static else held_out
        return Candidate(design, held_out, {name: psnr - before[name] for name, psnr in held_out.items()})
