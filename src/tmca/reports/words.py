"""What a search advises, in a sentence."""

from __future__ import annotations

from tmca.design import Advice, MaskAdvice, MaskCandidate
from tmca.design.advice import WORTH as WORTH_DECIBELS
from tmca.design.mask_search import WORTH as WORTH_SHARE


def code_advice(advice: Advice) -> str:
    """Slots and codes to use and their gain, with the codes that were left out."""
    return " ".join(part for part in (_recommended(advice), _left_out(advice)) if part)


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
