"""Phase masks for every number of slots, searched with the same effort, and which of them to take."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.codes import BURST
from tmca.design.mask_advised import MaskAdvice, MaskCandidate
from tmca.design.search import Parts, Progress
from tmca.design.spectral_depth import confusion, depth_information, design_masks, window_covariance
from tmca.devices import search_device
from tmca.errors import SettingError, check_choice, check_range
from tmca.optics import MODES, PhaseMaskBench, Stroke, mask_heights
from tmca.priors import GaussianPrior

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
_READINGS = 2.5
"""Steps of one reading a pixel that take as long as a step of two."""
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
        device: where masks are searched.

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
    device: torch.device = field(default_factory=search_device)

    def __post_init__(self) -> None:
        check_choice("mask", self.family, SEARCHED)
        if not self.learn:
            raise SettingError("learn", "nothing", "some of mask, shutter, filters")
        check_range("window", self.window, 1, unit="pixels")
        check_range("planes", self.camera.get("planes", 8), 3)

    def camera_of(self, slots: int, number: int = 0) -> SpectralDepthCamera:
        """A camera with the random masks of a start, on the task's device; those of other seeds are others.

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
        learnable = [part for part in self.learn if part != "shutter" or shutter not in ("open", BURST)]
        return SpectralDepthCamera(
            **{**self.camera, "size": SIZE, "slots": slots, "bench": self.bench, "mask": heights, "shutter": shutter},
            seed=self.seed, learnable=learnable,
        ).to(self.device)  # fmt: skip

    def with_two_buckets(self, shutter: str = "balanced") -> MaskTask:
        """The same for pixels with two buckets; their shutter is balanced, or that of a burst of frames."""
        return replace(self, camera={**self.camera, "buckets": 2}, shutter=shutter)

    @torch.no_grad()
    def covariance(self, camera: SpectralDepthCamera, prior: GaussianPrior) -> Tensor:
        """(D, n, n) of ``window_covariance``."""
        return window_covariance(camera, prior, self.window)

    def is_burst(self, slots: int) -> bool:
        """Whether two buckets with so many slots read what a burst reads: a slot each, in an order that is fixed."""
        return slots == 2 and "shutter" not in self.learn

    @torch.no_grad()
    def information(self, camera: SpectralDepthCamera, prior: GaussianPrior) -> Tensor:
        """(D,) of ``depth_information``."""
        return depth_information(camera, prior, self.window)


def search_masks(
    task: MaskTask,
    prior: GaussianPrior,
    slots: Sequence[int],
    effort: MaskEffort | None = None,
    progress: Progress | None = None,
    judge: Judge | None = None,
    buckets: int = 1,
) -> MaskAdvice:
    """Search masks for one slot and for every number of slots, with the same effort.

    For pixels with two buckets also masks beside a balanced shutter, for every number of several slots, and those of a
    burst of two frames, their rival. Two slots beside two buckets read what the burst reads, a frame in either bucket:
    its masks are theirs, or where shutters are searched their last descent begins from them.

    Descents go down the confusion. Which of them is taken, if not random masks, and which number of slots, is for the
    judge, who may know what the prior does not.

    Args:
        task: the bench and what is searched.
        prior: of scenes, see ``design_masks``.
        slots: numbers of slots K; 1 is always among them.
        effort: starts and steps.
        progress: called with the share that is done and what is done.
        judge: how wrong depth is behind a camera; the confusion without.
        buckets: of the sensor's pixels, 1 or 2.

    Raises:
        SettingError: no slots, other buckets, a task of two where they are compared with one, or what ``MaskTask`` and
            ``design_masks`` refuse.
        ShapeError: a prior that does not fit.
    """
    one, *more = sorted({1, *slots})
    check_range("slots", one, 1)
    check_range("buckets", buckets, 1, 2)
    if buckets == 2 and task.camera.get("buckets", 1) != 1:
        raise SettingError("buckets", "2 beside a task of two buckets", "a task of one bucket")
    search, twice = _Search(task, prior.to(task.device), effort or MaskEffort(), judge), more if buckets == 2 else []
    searched = [k for k in twice if not task.is_burst(k)]
    part = Parts(progress, [1.0] * (1 + len(more)) + [_READINGS] * (bool(twice) + len(searched)))
    static = search(1, None, part("masks, K = 1"))
    candidates = [static, *(search(k, static, part(f"masks, K = {k}")) for k in more)]
    if not twice:
        return MaskAdvice(tuple(each.cpu() for each in candidates))
    burst = replace(search, task=task.with_two_buckets(BURST))(2, static, part("masks, burst of two frames"))
    search = replace(search, task=task.with_two_buckets())
    for k in twice:
        if k in searched:
            begun = burst if k == 2 else static
            candidates.append(search(k, begun, part(f"masks, two buckets, K = {k}")))
        else:
            candidates.append(search.showing(burst))
    return MaskAdvice(tuple(each.cpu() for each in candidates), burst.cpu())


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
    """The same for every number of slots and buckets; see ``search_masks``."""

    task: MaskTask
    prior: GaussianPrior
    effort: MaskEffort
    judge: Judge | None

    def __call__(self, slots: int, within: MaskCandidate | None, progress: Callable[[float], None]) -> MaskCandidate:
        """The best of all descents, and of the masks that it contains, which are ``within``; for a judge random masks
        are good enough, too."""
        begun, random, errors = time.process_time(), self.task.camera_of(slots), None
        drawn = self.task.covariance(random, self.prior)
        starts, designs = self.effort.starts, self.effort.starts + 1 + (within is not None)
        judging = [] if self.judge is None else [_JUDGING / designs] * designs
        part = Parts(lambda share, _: progress(share), [(1 - _JUDGING) / starts] * starts + judging)
        runs = self._descents(slots, within, part)
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

    def showing(self, burst: MaskCandidate) -> MaskCandidate:
        """The masks of a burst beside two buckets of as many slots, in which a snapshot has the same readings."""
        camera = self.task.camera_of(burst.slots)
        _contain(camera, burst.camera)
        covariance = self.task.covariance(camera, self.prior)
        return replace(burst, camera=camera, covariance=covariance, start="masks of the burst", seconds=0.0)

    def _descents(self, slots: int, within: MaskCandidate | None, part: Parts) -> list[_Run]:
        """One from every start, and the masks that it contains as they are."""
        runs: list[_Run] = []
        contained = "static mask in all slots" if within is None or within.slots == 1 else "masks of the burst"
        for number in range(self.effort.starts):
            camera, start = self.task.camera_of(slots, number), f"random {number + 1}"
            last = number == self.effort.starts - 1
            if last and within is not None:
                alike = self.task.camera_of(slots, number)
                _contain(alike, within.camera)
                value = float(confusion(self.task.covariance(alike, self.prior)))
                runs.append(_Run(alike, contained, (value,)))
                _contain(camera, within.camera, _OWN)
                start = f"near the {contained}"
            elif last and runs:
                _contain(camera, min(runs, key=lambda run: run.confusion).camera)
                start = "best so far"
            how: dict[str, Any] = {"window": self.task.window, "steps": self.effort.steps, "rate": self.effort.rate}
            runs.append(_Run(camera, start, design_masks(camera, self.prior, **how, progress=part()).confusion))
        return runs


def _contain(camera: SpectralDepthCamera, source: SpectralDepthCamera, rest: float = 0.0) -> None:
    """Show the masks and filters of another camera of one slot, or as many, but for a share of the maps' variance; the
    shutter, too, where both have as many slots and one of a family."""
    maps, start = camera.point_spread.heights, source.point_spread.heights.metres()
    with torch.no_grad():
        getattr(maps, maps.name).mul_(rest**0.5).add_((1 - rest) ** 0.5 * start / maps.unit)
    camera.filters.load_state_dict(source.filters.state_dict())
    if camera.slots == source.slots and camera.shutter.family == source.shutter.family:
        camera.shutter.load_state_dict(source.shutter.state_dict())
