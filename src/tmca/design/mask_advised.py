"""What a search of phase masks for a sensor found, and what it advises, in sentences."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from torch import Tensor
from torch.nn import Module

from tmca.cameras import SpectralDepthCamera
from tmca.design.spectral_depth import confusion
from tmca.summaries import Summary

if TYPE_CHECKING:
    import pandas as pd

WORTH = 0.1
"""Share of the static mask's error that more slots have to save."""


@dataclass(frozen=True)
class MaskCandidate:
    """The best masks for a number of slots and of buckets.

    Args:
        camera: that shows them.
        covariance: (D, n, n) of windows at every plane.
        information: (D,) of ``depth_information``.
        random_covariance, random_information: the same of the first random masks.
        start: where their descent began.
        seconds: CPU time of the search.
        history: confusion after every step of that descent.
        errors: in bins, by a judge, of these masks and of the random ones; None without a judge.
    """

    camera: SpectralDepthCamera
    covariance: Tensor = field(repr=False)
    information: Tensor = field(repr=False)
    random_covariance: Tensor = field(repr=False)
    random_information: Tensor = field(repr=False)
    start: str
    seconds: float
    history: tuple[float, ...] = field(repr=False)
    errors: tuple[float, float] | None = None

    def cpu(self) -> MaskCandidate:
        """The same on the processor; its camera is moved there."""
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        moved: dict[str, Any] = {name: part.cpu() for name, part in parts.items() if isinstance(part, Tensor | Module)}
        return replace(self, **moved)

    @property
    def slots(self) -> int:
        """K."""
        return self.camera.slots

    @property
    def buckets(self) -> int:
        """R, of a burst its frames."""
        return self.camera.buckets

    @property
    def alike(self) -> bool:
        """Whether each bucket has one slot of every pixel: what a burst reads, in another order."""
        return self.buckets > 1 and bool((self.camera.tile()[1].sum(1) == 1).all())

    @property
    def confusion(self) -> float:
        """Bound on the mean error, bins."""
        return float(confusion(self.covariance))

    @property
    def expected(self) -> float:
        """What designs are ordered by, in bins: the judge's error, or the confusion."""
        return self.confusion if self.errors is None else self.errors[0]


@dataclass(frozen=True, repr=False)
class MaskAdvice(Summary):
    """The best masks for each number of slots, and which of them to take.

    Args:
        candidates: the static one first, those of two buckets last.
        burst: the rival of two buckets, two static frames, one after the other in the same time; None without them.
    """

    candidates: tuple[MaskCandidate, ...]
    burst: MaskCandidate | None = None

    @property
    def static(self) -> MaskCandidate:
        """The best static mask."""
        return self.candidates[0]

    @property
    def finals(self) -> tuple[MaskCandidate, ...]:
        """All that were searched, the burst last."""
        return self.candidates if self.burst is None else (*self.candidates, self.burst)

    def named(self, candidate: MaskCandidate) -> str:
        """A candidate in words: its slots and, where they are two, its buckets."""
        if candidate is self.burst:
            return "burst of two frames"
        return f"K = {candidate.slots}" + (", two buckets" if candidate.buckets == 2 else "")

    def saved(self, candidate: MaskCandidate) -> float:
        """Share of the static mask's error that is saved."""
        return 1 - candidate.expected / max(self.static.expected, 1e-30)

    @property
    def best(self) -> MaskCandidate:
        """The fewest slots, of one bucket before two, that save as much of the static mask's error as any but the
        burst, but for ``WORTH`` of it."""
        most = max(map(self.saved, self.candidates))
        return next(c for c in self.candidates if self.saved(c) > most - WORTH or self.saved(c) == most)

    @property
    def multiplex(self) -> bool:
        """Whether more than one slot is worth it."""
        return self.best is not self.static

    def to_pandas(self) -> pd.DataFrame:
        """A row for each of ``finals``: slots, buckets, expected error in bins, and the share of the static mask's that
        is saved."""
        import pandas as pd

        return pd.DataFrame(
            [{"slots": c.slots, "buckets": c.buckets, "expected": c.expected, "saved": self.saved(c)}
             for c in self.finals]
        )  # fmt: skip

    _uncut = ("advice",)

    def _facts(self) -> dict[str, str]:
        return {"advice": mask_advice(self), "masks": self.named(self.best)}


def mask_advice(advice: MaskAdvice) -> str:
    """Slots to use, and how much less error or confusion they leave, beside the rivals."""
    return " ".join(mask_advice_lines(advice))


def mask_advice_lines(advice: MaskAdvice) -> list[str]:
    """The same in short lines: what to use, the burst, what the second bucket gives."""
    return [line for line in (_recommended(advice), _against_burst(advice), _second_bucket(advice)) if line]


def _recommended(advice: MaskAdvice) -> str:
    static = f"the best static mask's ({advice.static.expected:.3g} bins)"
    what = "predicted depth confusion" if advice.static.errors is None else "depth error on the example scenes"
    if len(advice.candidates) == 1:
        return "One slot is all that was tried or fits the exposure: take the static mask."
    if advice.multiplex:
        with_buckets = " with two buckets" if advice.best.buckets == 2 else ""
        use = f"Use {advice.best.slots} slots{with_buckets}"
        return f"{use}: the {what} is {_compared(advice, advice.best)} {static}."
    top = max(advice.candidates[1:], key=advice.saved)
    return (
        f"A static mask is enough: the {what} of {advice.named(top)}, the best with more slots, "
        f"is {_compared(advice, top)} {static}; {WORTH:.0%} less would be worth it."
    )


def _compared(advice: MaskAdvice, candidate: MaskCandidate) -> str:
    change = advice.saved(candidate)
    return f"{abs(change):.0%} {'below' if change >= 0 else 'above'}"


def _against_burst(advice: MaskAdvice) -> str:
    """Whether the masks beat the burst, and what speaks for each."""
    rival, best = advice.burst, advice.best
    if rival is None:
        return ""
    if best.alike:
        return "These masks are a burst themselves, a frame in either bucket: two frames do the same."
    found, gain = f"A burst of two frames is {_compared(advice, rival)} it", advice.saved(best) - advice.saved(rival)
    if gain >= WORTH:
        return f"{found}."
    if gain > -WORTH:
        masks = "masks" if advice.multiplex else "static mask"
        return f"{found}: as good where the scene stands still; take the {masks} if it moves."
    return f"{found}: prefer it if the scene stands still and the sensor can be read twice in this time."


def _second_bucket(advice: MaskAdvice) -> str:
    """What two buckets leave and what one leaves, each with the best of several slots."""
    one, two = ([c for c in advice.candidates[1:] if c.buckets == buckets] for buckets in (1, 2))
    if not one or not two:
        return ""
    best = [max(found, key=advice.saved) for found in (two, one)]
    left = [f"{found.expected:.3g} bins (K = {found.slots})" for found in best]
    gain, worth = advice.saved(best[0]) - advice.saved(best[1]), "" if advice.best.buckets == 2 else "not "
    saved = f"{gain:.0%} of the static mask's error, {worth}worth it" if gain > 0 else "nothing"
    return f"Two buckets leave {left[0]}, one {left[1]}: the second bucket saves {saved}."
