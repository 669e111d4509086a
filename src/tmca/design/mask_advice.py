"""What masks were found for every number of slots, and which of them to take."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.design.spectral_depth import confusion, drawn_error

WORTH = 0.1
"""Share of the static mask's error that more slots have to save."""


@dataclass(frozen=True)
class MaskCandidate:
    """Masks that were found.

    Args:
        camera: that shows them.
        covariance: (D, n, n) of windows at every plane.
        information: (D,) of ``depth_information``.
        random: camera with the first random masks.
        random_covariance, random_information: the same of it.
        start: which descent found them.
        seconds: CPU time of the search.
        history: confusion after every step of that descent.
        judged: error in bins that a judge found of these masks and of the random ones; None without a judge.
    """

    camera: SpectralDepthCamera
    covariance: Tensor = field(repr=False)
    information: Tensor = field(repr=False)
    random: SpectralDepthCamera
    random_covariance: Tensor = field(repr=False)
    random_information: Tensor = field(repr=False)
    start: str
    seconds: float
    history: tuple[float, ...] = field(repr=False)
    judged: tuple[float, float] | None = None

    @property
    def slots(self) -> int:
        """K."""
        return self.camera.slots

    @property
    def confusion(self) -> float:
        """Bound on the mean error, bins."""
        return float(confusion(self.covariance))

    @property
    def expected(self) -> float:
        """What designs are ordered by, in bins: the judge's error, or the confusion."""
        return self.confusion if self.judged is None else self.judged[0]

    def row(self) -> dict[str, Any]:
        """For tables and files."""
        judged = self.judged or (None, None)
        return {
            "judged": judged[0], "random_judged": judged[1],
            "slots": self.slots, "confusion": self.confusion,
            "random_confusion": float(confusion(self.random_covariance)),
            "error": drawn_error(self.covariance), "random_error": drawn_error(self.random_covariance),
            "throughput": self.camera.throughput(), "start": self.start, "seconds": self.seconds,
            "fisher": self.information.tolist(), "random_fisher": self.random_information.tolist(),
        }  # fmt: skip


@dataclass(frozen=True)
class MaskAdvice:
    """What was found.

    Args:
        candidates: one for each number of slots, the static one first.
    """

    candidates: tuple[MaskCandidate, ...]

    @property
    def static(self) -> MaskCandidate:
        """The best static mask."""
        return self.candidates[0]

    def saved(self, candidate: MaskCandidate) -> float:
        """Share of the static mask's error that is saved."""
        return 1 - candidate.expected / max(self.static.expected, 1e-30)

    @property
    def best(self) -> MaskCandidate:
        """The fewest slots that save as much of the static mask's error as any, but for ``WORTH`` of it."""
        most = max(map(self.saved, self.candidates))
        return next(c for c in self.candidates if self.saved(c) > most - WORTH or self.saved(c) == most)

    @property
    def multiplex(self) -> bool:
        """Whether more than one slot is worth it."""
        return self.best is not self.static

    def sentence(self) -> str:
        """The advice in words."""
        static = f"the best static mask's ({self.static.expected:.3g} bins)"
        what = "foretold depth confusion" if self.static.judged is None else "depth error on the example scenes"
        if len(self.candidates) == 1:
            return "One slot is all that was tried or fits the exposure: take the static mask."
        if not self.multiplex:
            top = max(self.candidates[1:], key=self.saved)
            return (
                f"A static mask is enough: the {what} of K = {top.slots}, the best with more slots, "
                f"is {self._compared(top)} {static}; {WORTH:.0%} less would be worth it."
            )
        return f"Use {self.best.slots} slots: the {what} is {self._compared(self.best)} {static}."

    def _compared(self, candidate: MaskCandidate) -> str:
        change = self.saved(candidate)
        return f"{abs(change):.0%} {'below' if change >= 0 else 'above'}"
