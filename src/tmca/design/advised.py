"""What a search of codes for a sensor found, and what it advises, in sentences."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from statistics import stdev
from typing import TYPE_CHECKING

from tmca.design.search import Design
from tmca.design.sheet import SensorSheet, family_of
from tmca.summaries import Summary

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

WORTH = 0.1
"""Gain in dB below which more than one slot is not worth it."""
WITHIN = 0.1
"""Share of the largest gain below which more slots are not worth it."""


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
    def psnr(self) -> float:
        """Mean over the example scenes, each under the prior of the others, dB."""
        return sum(self.held_out.values()) / len(self.held_out)

    @property
    def gain(self) -> float:
        """Mean over the example scenes, dB."""
        return sum(self.gains.values()) / len(self.gains)

    @property
    def spread(self) -> float | None:
        """Standard deviation of a scene's gain, dB; None with one scene."""
        return stdev(self.gains.values()) if len(self.gains) > 1 else None

    @property
    def alike(self) -> bool:
        """Whether all pixels have the same shutter: two buckets are then a burst."""
        shutter = self.design.camera.codes.shutter.tile()
        return bool((shutter == shutter[:, :1, :1]).all())


@dataclass(frozen=True, repr=False)
class Advice(Summary):
    """Designs for a sensor, and which of them to use.

    Args:
        static: the static design.
        surveyed: designs after the survey, the static one, from which the others' gains are counted, first.
        one: the best of them that needs one bucket, searched on; None where one slot is all that fits.
        two: the same of those that need two; None without a second bucket.
        burst: the rival, two static frames or more one after the other in the same time; None where only one pattern
            fits.
        noise: (read noise, shot) in snapshot units.
        sheet: of the sensor.
        left_out: (kind, K) of codes that cannot let through the share of light that was asked for.
        throughput: that share; None where the light is free.
        within: share of the largest gain that fewer slots may lack.
    """

    static: Candidate
    surveyed: list[Candidate]
    one: Candidate | None
    two: Candidate | None
    burst: Candidate | None
    noise: tuple[float, float]
    sheet: SensorSheet
    left_out: tuple[tuple[str, int], ...] = ()
    throughput: float | None = None
    within: float = WITHIN

    @property
    def chosen(self) -> Candidate | None:
        """The better one of those with one bucket and with two, with one if the second gains nothing; no burst."""
        if self.one is None or self.two is None:
            return self.one or self.two
        return self.two if self.two.gain >= self.one.gain + WORTH else self.one

    @property
    def more_slots(self) -> dict[int, float]:
        """K → what codes of more slots than the best gained over it in the survey, dB; of those with as many buckets,
        the best of each K."""
        family, own = family_of(self.best.design.kind), (self.best.design.kind, self.best.design.slots)
        before = next((c.gain for c in self.surveyed if (c.design.kind, c.design.slots) == own), None)
        if before is None:
            return {}
        gains: dict[int, float] = {}
        for each in self.surveyed:
            if family_of(each.design.kind) == family and each.design.slots > own[1]:
                gains[each.design.slots] = max(gains.get(each.design.slots, -inf), each.gain - before)
        return dict(sorted(gains.items()))

    @property
    def finals(self) -> list[Candidate]:
        """All that were searched on, the static one first and the burst last."""
        return [each for each in (self.static, self.one, self.two, self.burst) if each is not None]

    @property
    def multiplex(self) -> bool:
        """Whether more than one slot is worth it."""
        return self.chosen is not None and self.chosen.gain >= WORTH

    @property
    def best(self) -> Candidate:
        """The design to use."""
        return self.chosen if self.chosen is not None and self.multiplex else self.static

    def to_pandas(self) -> pd.DataFrame:
        """A row for each of ``finals``: codes, slots, buckets, PSNR and gain over the static code, dB, and light."""
        import pandas as pd

        rows = [
            {"codes": each.design.kind, "slots": each.design.slots, "buckets": each.design.camera.buckets,
             "expected_psnr": each.design.psnr, "held_out_psnr": each.psnr, "gain": each.gain, "spread": each.spread,
             "throughput": each.design.camera.throughput()} for each in self.finals
        ]  # fmt: skip
        return pd.DataFrame(rows)

    _uncut = ("advice",)

    def _facts(self) -> dict[str, str]:
        own = self.best.design
        codes = f"{own.kind}, K = {own.slots}, {own.camera.buckets} bucket{'s'[: own.camera.buckets != 1]}"
        return {"advice": code_advice(self), "codes": codes, "held out": f"{self.best.psnr:.1f} dB"}

    def _picture(self) -> Figure:
        return self.best.design.camera._picture()


def code_advice(advice: Advice) -> str:
    """Slots and codes to use and their gain, beside the rivals, with the codes that were left out."""
    return " ".join(advice_lines(advice))


def advice_lines(advice: Advice) -> list[str]:
    """The same in short lines: what to use, the burst, what the sensor gives, more slots, how far to trust it, what was
    left out."""
    parts = (_recommended(advice), _against_burst(advice), _compared_codes(advice), _more_slots(advice))
    return [part for part in (*parts, _careful(advice), _left_out(advice)) if part]


def _recommended(advice: Advice) -> str:
    if advice.chosen is None and advice.left_out:
        return "No codes of several slots could be tried: use the static code."
    if advice.chosen is None:
        return "One slot is all that was tried or fits the exposure: use the static code."
    if not advice.multiplex:
        return f"Do not multiplex: no design gains {WORTH} dB over the static code."
    best = advice.best
    use = f"Use {best.design.slots} slots with {best.design.kind} codes: {best.gain:+.1f} dB over the static code, "
    if best.spread is None:
        return use + "on one example scene that the estimate knows; give more to see the spread."
    sure = "" if best.gain > best.spread else ", no more than the spread: it may not be better"
    return use + f"± {best.spread:.1f} dB from scene to scene{sure}."


def _more_slots(advice: Advice) -> str:
    """What more slots gained; empty where the best has the most that were tried."""
    if not advice.multiplex or not advice.more_slots:
        return ""
    said = ", ".join(f"K = {slots} {gain:+.1f} dB" for slots, gain in advice.more_slots.items())
    taken = f"within {WORTH} dB{f' or {advice.within:.0%}' if advice.within else ''} of the best"
    return f"These are the fewest slots {taken}; more gave in the survey: {said}."


def _compared_codes(advice: Advice) -> str:
    """What the sensor gives with two buckets, with one, without time slots and with two frames."""
    if advice.burst is None:
        return ""
    own = {"with two buckets": advice.two, "with one bucket": advice.one}
    parts = [
        f"{name}: {each.psnr:.1f} dB ({each.design.kind}, K = {each.design.slots})"
        for name, each in own.items()
        if each is not None
    ]
    parts += [f"static: {advice.static.psnr:.1f} dB", f"a burst of {frames_of(advice)}: {advice.burst.psnr:.1f} dB"]
    return " ".join(part for part in (f"This sensor {'; '.join(parts)}.", _second_bucket(advice)) if part)


def frames_of(advice: Advice) -> str:
    """How many frames the burst has, in words."""
    frames = 2 if advice.burst is None else advice.burst.design.slots
    return f"{ {2: 'two', 3: 'three', 4: 'four'}.get(frames, frames) } frames"


def _second_bucket(advice: Advice) -> str:
    if advice.one is None or advice.two is None:
        return ""
    gain = advice.two.gain - advice.one.gain
    if advice.two is advice.chosen:
        return f"The second bucket gains {gain:.1f} dB, as the light of closed slots is read too."
    return f"The second bucket is not worth it ({gain:+.1f} dB)."


def _against_burst(advice: Advice) -> str:
    """Whether the codes beat the burst, and what speaks for each."""
    rival, best = advice.burst, advice.best
    if rival is None:
        return ""
    if best is advice.two and best.alike:
        return "These codes are a burst themselves: all pixels change buckets together. Two frames do the same."
    gain, name = best.gain - rival.gain, "codes" if advice.multiplex else "static code"
    if gain >= WORTH:
        return f"The {name} gain{'' if advice.multiplex else 's'} {gain:.1f} dB over the burst."
    if gain > -WORTH:
        return f"The burst is as good where the scene stands still; take the {name} if it moves."
    times = "twice" if rival.design.slots == 2 else f"{rival.design.slots} times"
    said = f"The burst is {-gain:.1f} dB better: prefer it if the scene stands still and the sensor can be read {times}"
    both = advice.two is None and rival.design.slots == 2
    more = " With two buckets a pixel, one reading holds both frames: add --buckets 2." if both else ""
    return f"{said} in this time.{more}"


def _careful(advice: Advice) -> str:
    spread = advice.best.spread
    if advice.burst is None or not advice.multiplex or spread is None:
        return ""
    return f"Trust differences to within ± {max(spread, WORTH):.1f} dB, and only for scenes like the examples."


def _left_out(advice: Advice) -> str:
    """Which codes were not tried, and why; empty where all were."""
    if not advice.left_out:
        return ""
    slots: dict[str, list[str]] = {}
    for kind, count in advice.left_out:
        slots.setdefault(kind, []).append(str(count))
    named = "; ".join(f"{kind}, K = {', '.join(counts)}" for kind, counts in slots.items())
    return f"Left out, as they cannot let through {100 * (advice.throughput or 0):g}% of the light: {named}."
