"""Phase masks for every number of slots, searched with the same effort, and which of them to take."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.design.depth_information import depth_information
from tmca.design.mask_advice import MaskAdvice, MaskCandidate
from tmca.design.spectral_depth import confusion, design_masks, window_covariance
from tmca.errors import SettingError
from tmca.optics import MODES, HeightMaps, PhaseMaskBench, Stroke, mask_heights
from tmca.priors import GaussianPrior

SEARCHED = ("zernike", "free-form", "rotational")
"""Families of masks with random starts."""
SIZE = (64, 64)
"""Pixels of the cameras."""
_APART = 1000
"""Of the seeds of two starts."""
_OWN, _RMS = 0.05, 0.1e-6
"""Share of variance that slots have of their own when they start from one mask, metres."""
_SEARCHING = 0.7
"""Share of the time, as a rule, until designs are judged."""
Told = Callable[[float, str], None]
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
        if self.starts < 1 or self.steps < 1 or not self.rate > 0:
            found = f"{self.starts} starts of {self.steps} steps at rate {self.rate:g}"
            raise SettingError("search", found, "a start and a step or more, and a rate above 0")


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
        if self.family not in SEARCHED:
            raise SettingError("mask", repr(self.family), f"one of {', '.join(SEARCHED)}, which have random starts")
        if not self.learn:
            raise SettingError("learn", "nothing", "some of mask, shutter, filters")
        if self.window < 1:
            raise SettingError("window", str(self.window), "1 pixel or more")
        if int(self.camera.get("planes", 8)) < 3:
            raise SettingError("planes", str(self.camera["planes"]), "3 or more depth planes")

    def made(self, slots: int, number: int) -> SpectralDepthCamera:
        """A camera with the random masks of a start; those of other seeds are others.

        Raises:
            SettingError: heights of this rms are beyond the stroke, or nothing is learnable with so many slots.
        """
        reach = float("inf") if self.stroke is None else (self.stroke.high - self.stroke.low) / 12
        heights = mask_heights(
            self.family, slots, self.bench, rms=min(_RMS, reach) if self.rms is None else self.rms, stroke=self.stroke,
            modes=self.modes, seed=self.seed + _APART * number, learnable="mask" in self.learn,
        )  # fmt: skip
        if self.stroke is not None and self.rms is not None:
            self.stroke.check(heights.profile(), "heights of random masks")
        shutter = "open" if slots == 1 else self.shutter
        learned = [part for part in self.learn if part != "shutter" or shutter != "open"]
        return SpectralDepthCamera(
            **{**self.camera, "size": SIZE, "slots": slots, "bench": self.bench, "mask": heights, "shutter": shutter},
            seed=self.seed, learnable=learned,
        )  # fmt: skip

    def covariance(self, camera: SpectralDepthCamera, prior: GaussianPrior) -> Tensor:
        """(D, n, n) of ``window_covariance``, without gradients."""
        with torch.no_grad():
            return window_covariance(camera, prior, self.window)

    def information(self, camera: SpectralDepthCamera, prior: GaussianPrior) -> Tensor:
        """(D,) of ``depth_information``, without gradients."""
        with torch.no_grad():
            return depth_information(camera, prior, self.window)


def search_masks(
    task: MaskTask,
    prior: GaussianPrior,
    slots: Sequence[int],
    effort: MaskEffort | None = None,
    progress: Told | None = None,
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
        progress: told the share that is done and what is done.
        judge: how wrong depth is behind a camera; the confusion without.

    Raises:
        SettingError: no slots, or what ``MaskTask`` and ``design_masks`` refuse.
        ShapeError: a prior that does not fit.
    """
    counts = sorted({1, *slots})
    if counts[0] < 1:
        raise SettingError("slots", str(counts[0]), "1 or more")
    search, found = _Search(task, prior, effort or MaskEffort(), judge), list[MaskCandidate]()
    for place, count in enumerate(counts):
        told = _part(progress, place / len(counts), 1 / len(counts), f"masks, K = {count}")
        found.append(search(count, found[0] if found else None, told))
    return MaskAdvice(tuple(found))


@dataclass(frozen=True)
class _Run:
    """A camera that was found, from which start, and its confusion after every step."""

    camera: SpectralDepthCamera
    start: str
    history: tuple[float, ...]

    @property
    def value(self) -> float:
        """The least confusion, which is the camera's."""
        return min(self.history)


@dataclass(frozen=True)
class _Search:
    """The same for every number of slots; see ``search_masks``."""

    task: MaskTask
    prior: GaussianPrior
    effort: MaskEffort
    judge: Judge | None

    def __call__(self, slots: int, static: MaskCandidate | None, told: Callable[[float], None]) -> MaskCandidate:
        """The best of all descents; for a judge random masks are good enough, too."""
        begun, random = time.process_time(), self.task.made(slots, 0)
        searching = 1.0 if self.judge is None else _SEARCHING
        runs = self._descents(slots, static, lambda share: told(searching * share))
        drawn, errors = self.task.covariance(random, self.prior), None
        best = min(runs, key=lambda run: run.value)
        if self.judge is not None:
            runs.append(_Run(random, "random, as drawn", (float(confusion(drawn)),)))
            judged = self._judged(runs, lambda share: told(searching + (1 - searching) * share))
            best, errors = runs[judged.index(min(judged))], (min(judged), judged[-1])
        seconds, seen = time.process_time() - begun, self.task.covariance(best.camera, self.prior)
        own, others = (self.task.information(camera, self.prior) for camera in (best.camera, random))
        return MaskCandidate(best.camera, seen, own, random, drawn, others, best.start, seconds, best.history, errors)

    def _descents(self, slots: int, static: MaskCandidate | None, told: Callable[[float], None]) -> list[_Run]:
        """One from every start, and the static mask in all slots as it is."""
        runs: list[_Run] = []
        for number in range(self.effort.starts):
            camera, start, last = (
                self.task.made(slots, number),
                f"random {number + 1}",
                number == self.effort.starts - 1,
            )
            if last and static is not None:
                runs.append(self._alike(self.task.made(slots, number), static))
                _contain(camera, static.camera, _OWN)
                start = "near the static mask in all slots"
            elif last and runs:
                _contain(camera, min(runs, key=lambda run: run.value).camera)
                start = "best so far"
            found = design_masks(
                camera, self.prior, window=self.task.window, steps=self.effort.steps, rate=self.effort.rate,
                progress=lambda step, steps, _, done=number: told((done + step / steps) / self.effort.starts),  # type: ignore[misc]
            )  # fmt: skip
            runs.append(_Run(camera, start, found.confusion))
        return runs

    def _alike(self, camera: SpectralDepthCamera, static: MaskCandidate) -> _Run:
        """The static mask in all slots."""
        _contain(camera, static.camera)
        value = float(confusion(self.task.covariance(camera, self.prior)))
        return _Run(camera, "static mask in all slots", (value,))

    def _judged(self, runs: Sequence[_Run], told: Callable[[float], None]) -> list[float]:
        """How wrong depth is behind every camera."""
        assert self.judge is not None
        errors: list[float] = []
        for run in runs:
            errors.append(self.judge(run.camera))
            told(len(errors) / len(runs))
        return errors


def _contain(camera: SpectralDepthCamera, source: SpectralDepthCamera, own: float = 0.0) -> None:
    """Show the masks and filters of another camera of one slot, or as many, but for a share of the maps' variance."""
    maps, given = camera.spread.heights, source.spread.heights
    name = next(name for name in ("coefficients", "heights", "radii") if hasattr(maps, name))
    values, start = getattr(maps, name), getattr(given, name)
    with torch.no_grad():
        values.mul_(own**0.5).add_((1 - own) ** 0.5 * start * (_unit(given) / _unit(maps)))
    camera.filters.load_state_dict(source.filters.state_dict())
    if camera.slots == source.slots:
        camera.shutter.load_state_dict(source.shutter.state_dict())


def _unit(maps: HeightMaps) -> float:
    """Metres of a map's parameters."""
    return maps.unit


def _part(progress: Told | None, done: float, share: float, what: str) -> Callable[[float], None]:
    return lambda within: None if progress is None else progress(done + share * within, what)
