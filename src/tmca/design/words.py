"""What a search advises, in a sentence."""

from __future__ import annotations

from tmca.design import Advice, MaskAdvice, MaskCandidate
from tmca.design.advised import WORTH as WORTH_DECIBELS
from tmca.design.mask_search import WORTH as WORTH_SHARE


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
        return f"Do not multiplex: no design gains {WORTH_DECIBELS} dB over the static code."
    best = advice.best
    use = f"Use {best.design.slots} slots with {best.design.kind} codes: {best.gain:+.1f} dB over the static code, "
    if best.spread is None:
        return use + "on one example scene that the estimate knows; give more to see the spread."
    sure = "" if best.gain > best.spread else ", no more than the spread"
    return use + f"± {best.spread:.1f} dB from scene to scene{sure}."


def _more_slots(advice: Advice) -> str:
    """What more slots gained; empty where the best has the most that were tried."""
    if not advice.multiplex or not advice.more_slots:
        return ""
    said = ", ".join(f"K = {slots} {gain:+.1f} dB" for slots, gain in advice.more_slots.items())
    taken = f"within {WORTH_DECIBELS} dB{f' or {advice.within:.0%}' if advice.within else ''} of the best"
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
    parts += [f"static: {advice.static.psnr:.1f} dB", f"a burst of two frames: {advice.burst.psnr:.1f} dB"]
    return " ".join(part for part in (f"This sensor {'; '.join(parts)}.", _second_bucket(advice)) if part)


def _second_bucket(advice: Advice) -> str:
    if advice.one is None or advice.two is None:
        return ""
    gain = advice.two.gain - advice.one.gain
    if advice.two is advice.chosen:
        return f"The second bucket gains {gain:.1f} dB, as no light is lost."
    return f"The second bucket is not worth it ({gain:+.1f} dB)."


def _against_burst(advice: Advice) -> str:
    """Whether the codes beat the burst, and what speaks for each."""
    rival, best = advice.burst, advice.best
    if rival is None:
        return ""
    if best is advice.two and best.alike:
        return "These codes are a burst themselves: all pixels change buckets together. Two frames do the same."
    gain, name = best.gain - rival.gain, "codes" if advice.multiplex else "static code"
    if gain >= WORTH_DECIBELS:
        return f"The {name} gain{'' if advice.multiplex else 's'} {gain:.1f} dB over the burst."
    if gain > -WORTH_DECIBELS:
        return f"The burst is as good where the scene stands still; take the {name} if it moves."
    said = (
        f"The burst is {-gain:.1f} dB better: prefer it if the scene stands still and the sensor can be read twice in "
    )
    more = " With two buckets a pixel, one reading holds both frames: add --buckets 2." if advice.two is None else ""
    return f"{said}this time.{more}"


def _careful(advice: Advice) -> str:
    spread = advice.best.spread
    if advice.burst is None or not advice.multiplex or spread is None:
        return ""
    return f"Trust differences to within ± {max(spread, WORTH_DECIBELS):.1f} dB, and only for scenes like the examples."


def _left_out(advice: Advice) -> str:
    """Which codes were not tried, and why; empty where all were."""
    if not advice.left_out:
        return ""
    slots: dict[str, list[str]] = {}
    for kind, count in advice.left_out:
        slots.setdefault(kind, []).append(str(count))
    named = "; ".join(f"{kind}, K = {', '.join(counts)}" for kind, counts in slots.items())
    return f"Left out, as they cannot let through {100 * (advice.throughput or 0):g}% of the light: {named}."


def mask_advice(advice: MaskAdvice) -> str:
    """Slots to use, and how much less error or confusion they leave."""
    static = f"the best static mask's ({advice.static.expected:.3g} bins)"
    what = "predicted depth confusion" if advice.static.errors is None else "depth error on the example scenes"
    if len(advice.candidates) == 1:
        return "One slot is all that was tried or fits the exposure: take the static mask."
    if advice.multiplex:
        return f"Use {advice.best.slots} slots: the {what} is {_compared(advice, advice.best)} {static}."
    top = max(advice.candidates[1:], key=advice.saved)
    return (
        f"A static mask is enough: the {what} of K = {top.slots}, the best with more slots, "
        f"is {_compared(advice, top)} {static}; {WORTH_SHARE:.0%} less would be worth it."
    )


def _compared(advice: MaskAdvice, candidate: MaskCandidate) -> str:
    change = advice.saved(candidate)
    return f"{abs(change):.0%} {'below' if change >= 0 else 'above'}"
