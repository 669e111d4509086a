"""Phase masks for every number of slots, searched with the same effort, and which of them to take."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.design.search import Parts, Progress
from tmca.design.spectral_depth import confusion, depth_information, design_masks, window_covariance
from tmca.errors import SettingError, check_choice, check_range
from tmca.optics import MODES, PhaseMaskBench, Stroke, mask_heights
from tmca.priors import GaussianPrior
from tmca.summaries import Summary

if TYPE_CHECKING:
    import pandas as pd

SEARCHED = ("zernike", "free-form", "rotational")
"""Families of masks with random starts."""
SIZE = (64, 64)
"""Pixels of the cameras."""
_APART = 1000
"""Of the seeds of two starts."""
_OWN, _RMS = 0.05, 0.1e-6
"""Share of variance that slots have of their own when they start from one mask; height of random masks, metres."""
_JUDGING = 0.3
"""Share of the time, as a rule, in which designs are judged."""
WORTH = 0.1
"""Share of the static mask's error that more slots have to save."""
Judge = Callable[[SpectralDepthCamera], float]
"""From a camera to an error of depth, in bins."""


@dataclass(frozen=True)
class MaskEffort:
    """How hard is searched; the same for every number of slots.

    Args:
        starts: descents. The last begins from what is contained: the best so far of one slot, for more slots the best
            static mask in all of them; the others are random.
        steps: of each descent.
        rate: see ``design_masks``.

    Raises:
        SettingError: none of them, or a rate that is not above 0.
    """

    starts: int = 3
    steps: int = 40
    rate: float = 0.003

    def __post_init__(self) -> None:
        check_range("starts", self.starts, 1)
        check_range("steps", self.steps, 1)
        check_range("rate", self.rate, above=0)


@dataclass(frozen=True)
class MaskTask:
    """What all searches share.

    Args:
        bench: that the masks stand on.
        camera: further arguments of ``SpectralDepthCamera`` but size, slots, mask and shutter.
        shutter: family of the shutter where there are several slots; a static mask has it open.
        family: of the masks, one of ``SEARCHED``.
        rms: of random heights, metres; if None 100 nm, or less where the stroke is small.
        modes: number of Zernike modes.
        stroke: of the device.
        learn: some of ``"mask"``, ``"shutter"``, ``"filters"``.
        window: side of the windows of a snapshot that are judged, pixels.
        seed: of what is random.

    Raises:
        SettingError: a family without random starts, nothing to learn, no window, or fewer than three depth planes.
    """

    bench: PhaseMaskBench
    camera: Mapping[str, Any]
    shutter: str = "one-hot"
    family: str = "zernike"
    rms: float | None = None
    stroke: Stroke | None = None
    learn: Collection[str] = ("mask",)
    window: int = 8
    seed: int = 0
    modes: int = MODES

    def __post_init__(self) -> None:
        check_choice("mask", self.family, SEARCHED)
        if not self.learn:
            raise SettingError("learn", "nothing", "some of mask, shutter, filters")
        check_range("window", self.window, 1, unit="pixels")
        check_range("planes", self.camera.get("planes", 8), 3)

    def camera_of(self, slots: int, number: int = 0) -> SpectralDepthCamera:
        """A camera with the random masks of a start; those of other seeds are others.

        Raises:
            SettingError: heights of this rms are beyond the stroke, or nothing is learnable with so many slots.
        """
        usual = _RMS if self.stroke is None else min(_RMS, (self.stroke.high - self.stroke.low) / 12)
        heights = mask_heights(
            self.family, slots, self.bench, rms=usual if self.rms is None else self.rms, stroke=self.stroke,
            modes=self.modes, seed=self.seed + _APART * number, learnable="mask" in self.learn,
        )  # fmt: skip
        if self.stroke is not None and self.rms is not None:
            self.stroke.check(heights.profile(), "heights of random masks")
        shutter = "open" if slots == 1 else self.shutter
        learnable = [part for part in self.learn if part != "shutter" or shutter != "open"]
        return SpectralDepthCamera(
            **{**self.camera, "size": SIZE, "slots": slots, "bench": self.bench, "mask": heights, "shutter": shutter},
            seed=self.seed, learnable=learnable,
        )  # fmt: skip

    @torch.no_grad()
    def covariance(self, camera: SpectralDepthCamera, prior: GaussianPrior) -> Tensor:
        """(D, n, n) of ``window_covariance``."""
        return window_covariance(camera, prior, self.window)

    @torch.no_grad()
    def information(self, camera: SpectralDepthCamera, prior: GaussianPrior) -> Tensor:
        """(D,) of ``depth_information``."""
        return depth_information(camera, prior, self.window)


@dataclass(frozen=True)
class MaskCandidate:
    """The best masks for a number of slots.

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
        return self.confusion if self.errors is None else self.errors[0]


@dataclass(frozen=True, repr=False)
class MaskAdvice(Summary):
    """The best masks for each number of slots, and which of them to take.

    Args:
        candidates: the static one first.
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

    def to_pandas(self) -> pd.DataFrame:
        """A row for every number of slots: expected error in bins, and the share of the static mask's that is saved."""
        import pandas as pd

        rows = [{"slots": c.slots, "expected": c.expected, "saved": self.saved(c)} for c in self.candidates]
        return pd.DataFrame(rows)

    _uncut = ("advice",)

    def _facts(self) -> dict[str, str]:
        return {"advice": mask_advice(self), "masks": f"K = {self.best.slots}"}


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
        f"is {_compared(advice, top)} {static}; {WORTH:.0%} less would be worth it."
    )


def _compared(advice: MaskAdvice, candidate: MaskCandidate) -> str:
    change = advice.saved(candidate)
    return f"{abs(change):.0%} {'below' if change >= 0 else 'above'}"


def search_masks(
    task: MaskTask,
    prior: GaussianPrior,
    slots: Sequence[int],
    effort: MaskEffort | None = None,
    progress: Progress | None = None,
    judge: Judge | None = None,
) -> MaskAdvice:
    """Search masks for one slot and for every number of slots, with the same effort.

    Descents go down the confusion. Which of them is taken, if not random masks, and which number of slots, is for the
    judge, who may know what the prior does not.

    Args:
        task: the bench and what is searched.
        prior: of scenes, see ``design_masks``.
        slots: numbers of slots K; 1 is always among them.
        effort: starts and steps.
        progress: called with the share that is done and what is done.
        judge: how wrong depth is behind a camera; the confusion without.

    Raises:
        SettingError: no slots, or what ``MaskTask`` and ``design_masks`` refuse.
        ShapeError: a prior that does not fit.
    """
    counts = sorted({1, *slots})
    check_range("slots", counts[0], 1)
    search, part = _Search(task, prior, effort or MaskEffort(), judge), Parts(progress, [1.0] * len(counts))
    candidates = [search(1, None, part("masks, K = 1"))]
    for count in counts[1:]:
        candidates.append(search(count, candidates[0], part(f"masks, K = {count}")))
    return MaskAdvice(tuple(candidates))


@dataclass(frozen=True)
class _Run:
    """A camera, where its descent began, and its confusion after every step."""

    camera: SpectralDepthCamera
    start: str
    history: tuple[float, ...]

    @property
    def confusion(self) -> float:
        return min(self.history)


@dataclass(frozen=True)
class _Search:
    """The same for every number of slots; see ``search_masks``."""

    task: MaskTask
    prior: GaussianPrior
    effort: MaskEffort
    judge: Judge | None

    def __call__(self, slots: int, static: MaskCandidate | None, progress: Callable[[float], None]) -> MaskCandidate:
        """The best of all descents; for a judge random masks are good enough, too."""
        begun, random, errors = time.process_time(), self.task.camera_of(slots), None
        drawn = self.task.covariance(random, self.prior)
        starts, designs = self.effort.starts, self.effort.starts + 1 + (static is not None)
        judging = [] if self.judge is None else [_JUDGING / designs] * designs
        part = Parts(lambda share, _: progress(share), [(1 - _JUDGING) / starts] * starts + judging)
        runs = self._descents(slots, static, part)
        best = min(runs, key=lambda run: run.confusion)
        if self.judge is not None:
            runs.append(_Run(random, "random, as drawn", (float(confusion(drawn)),)))
            errors_of_runs = []
            for run in runs:
                errors_of_runs.append(self.judge(run.camera))
                part()(1.0)
            best, errors = runs[errors_of_runs.index(min(errors_of_runs))], (min(errors_of_runs), errors_of_runs[-1])
        seconds, covariance = time.process_time() - begun, self.task.covariance(best.camera, self.prior)
        designed, others = (self.task.information(camera, self.prior) for camera in (best.camera, random))
        return MaskCandidate(
            best.camera, covariance, designed, drawn, others, best.start, seconds, best.history, errors
        )

    def _descents(self, slots: int, static: MaskCandidate | None, part: Parts) -> list[_Run]:
        """One from every start, and the static mask in all slots as it is."""
        runs: list[_Run] = []
        for number in range(self.effort.starts):
            camera, start = self.task.camera_of(slots, number), f"random {number + 1}"
            last = number == self.effort.starts - 1
            if last and static is not None:
                alike = self.task.camera_of(slots, number)
                _contain(alike, static.camera)
                value = float(confusion(self.task.covariance(alike, self.prior)))
                runs.append(_Run(alike, "static mask in all slots", (value,)))
                _contain(camera, static.camera, _OWN)
                start = "near the static mask in all slots"
            elif last and runs:
                _contain(camera, min(runs, key=lambda run: run.confusion).camera)
                start = "best so far"
            how: dict[str, Any] = {"window": self.task.window, "steps": self.effort.steps, "rate": self.effort.rate}
            runs.append(_Run(camera, start, design_masks(camera, self.prior, **how, progress=part()).confusion))
        return runs


def _contain(camera: SpectralDepthCamera, source: SpectralDepthCamera, rest: float = 0.0) -> None:
    """Show the masks and filters of another camera of one slot, or as many, but for a share of the maps' variance."""
    maps, start = camera.point_spread.heights, source.point_spread.heights.metres()
    with torch.no_grad():
        getattr(maps, maps.name).mul_(rest**0.5).add_((1 - rest) ** 0.5 * start / maps.unit)
    camera.filters.load_state_dict(source.filters.state_dict())
    if camera.slots == source.slots:
        camera.shutter.load_state_dict(source.shutter.state_dict())
