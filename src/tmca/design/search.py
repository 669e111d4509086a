"""The best codes of a kind for a noise: descent from random codes, then flips, within a stated effort.

A descent keeps codes binary through a smooth stand-in, or goes from grey to binary. What every search shares is here,
too: the best parameters so far, and the progress of its parts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, log10
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera
from tmca.design.expected_error import BlockMse, TileMse
from tmca.design.flips import flip_greedily
from tmca.design.kinds import designable, hold_throughput, learnable
from tmca.errors import SettingError, check_range

Progress = Callable[[float, str], None]
"""Called with the share that is done and what is done."""


class Parts:
    """Progress of parts one after the other.

    Args:
        progress: of all of them; nobody is told if None.
        lengths: of each, in any unit.
    """

    def __init__(self, progress: Progress | None, lengths: Sequence[float]) -> None:
        self.progress, self.lengths, self.done, self.number = progress, lengths, 0.0, 0

    def __call__(self, what: str = "") -> Callable[[float], None]:
        """What takes the share that is done of the next part."""
        progress, before, length, total = self.progress, self.done, self.lengths[self.number], sum(self.lengths)
        self.done, self.number = before + length, self.number + 1
        return lambda share: progress((before + length * share) / total, what) if progress else None


@dataclass
class Best:
    """The parameters of the lowest value so far; those that they begin with before any."""

    parameters: Sequence[nn.Parameter]
    value: float = inf
    copies: list[Tensor] = field(init=False)

    def __post_init__(self) -> None:
        self.copies = [parameter.detach().clone() for parameter in self.parameters]

    def meet(self, value: float) -> None:
        """Take over the present parameters if their value is lower."""
        if value < self.value:
            self.value, self.copies = value, [parameter.detach().clone() for parameter in self.parameters]

    @torch.no_grad()
    def restore(self) -> float:
        """Bring them back; their value."""
        for parameter, copy in zip(self.parameters, self.copies, strict=True):
            parameter.copy_(copy)
        return self.value


@dataclass(frozen=True)
class Descent:
    """How codes descend.

    Args:
        steps: of Adam.
        rate: its learning rate, in units of the latent values, which stay within ±1.
        slope: first and last slope of the smooth stand-in, raised geometrically.
        relaxed: let the codes be grey on the way, ever nearer to 0 and 1, instead of binary all the time.
        throughput: share of light to hold after every step; free if None.
        seed: of the blocks' shifts.
        checks: how often the binary codes are judged; the best of them stay.

    Raises:
        SettingError: no steps or checks, no rate, or slopes that do not rise from above 0.
    """

    steps: int = 300
    rate: float = 0.1
    slope: tuple[float, float] = (2.0, 20.0)
    relaxed: bool = False
    throughput: float | None = None
    seed: int = 0
    checks: int = 12

    def __post_init__(self) -> None:
        check_range("descent steps", self.steps, 1)
        check_range("descent rate", self.rate, above=0)
        check_range("descent checks", self.checks, 1)
        if not 0 < self.slope[0] <= self.slope[1]:
            raise SettingError("descent slope", str(self.slope), "slopes rising from above 0")


def descend(
    camera: CodedCamera,
    error: TileMse,
    how: Descent | None = None,
    progress: Callable[[float], None] | None = None,
) -> float:
    """Lower the expected error of a camera of one period by its learnable codes, in place.

    Args:
        camera: as large as one period of its codes, see ``designable``.
        error: of its tile.
        how: settings.
        progress: called with the share that is done.

    Returns:
        Expected mean squared error of the binary codes that the camera is left with, never above the first, once those
        hold the throughput.

    Raises:
        SettingError: nothing to learn.
    """
    how, error = how or Descent(), error.for_buckets(camera.buckets)
    latents = learnable(camera)
    if how.throughput is not None:
        hold_throughput(camera, how.throughput)
    best = Best(latents, error.whole(camera))
    optimiser = torch.optim.Adam(latents, lr=how.rate)
    shifts = torch.randint(1 << 16, (how.steps, 2), generator=torch.Generator().manual_seed(how.seed)).tolist()
    for step, shift in enumerate(shifts, 1):
        value = _relaxed_error(camera, error, how, (step - 1) / how.steps, (shift[0], shift[1]))
        optimiser.zero_grad()
        value.log().backward()
        optimiser.step()
        with torch.no_grad():
            for latent in latents:
                latent.clamp_(-1, 1)
        if how.throughput is not None:
            hold_throughput(camera, how.throughput)
        if step % max(1, how.steps // how.checks) == 0 or step == how.steps:
            best.meet(error.whole(camera))
        if progress:
            progress(step / how.steps)
    return best.restore()


def _relaxed_error(camera: CodedCamera, error: TileMse, how: Descent, share: float, shift: tuple[int, int]) -> Tensor:
    """Error of the codes as they are shown once this share of the steps is done."""
    camera.codes.anneal(how.slope[0] * (how.slope[1] / how.slope[0]) ** share)
    camera.codes.relax(how.relaxed)
    value = error(camera.taps().code, shift)
    camera.codes.relax(False)
    return value


@dataclass(frozen=True)
class Effort:
    """How hard is searched; the same for static and time-multiplexed codes.

    Args:
        descents: from given codes and from random ones, in all.
        steps: of each descent.
        flips: pixels that are tried afterwards, in sweeps over the best codes until none helps or as many are tried.

    Raises:
        SettingError: no descents or steps.
    """

    descents: int = 3
    steps: int = 240
    flips: int = 6000

    def __post_init__(self) -> None:
        check_range("descents", self.descents, 1)
        check_range("steps", self.steps, 1)
        check_range("flips", self.flips, 0)


QUICK = Effort(descents=1, steps=30, flips=0)
"""Of a first look: a quarter of the survey."""
SURVEY = Effort(descents=2, steps=60, flips=0)
"""Seconds a design; on three CAVE scenes 0.1 to 0.3 dB below what the whole effort finds."""


@dataclass(frozen=True)
class Design:
    """Codes of the lowest expected error of a search.

    Args:
        kind: their structure, name in ``KINDS``.
        camera: of one period, with these codes.
        mse: expected mean squared error, squared irradiance.
        random: the same of random codes of its kind.
        seconds: CPU time of the search.
    """

    kind: str
    camera: CodedCamera
    mse: float
    random: float
    seconds: float

    @property
    def slots(self) -> int:
        """K."""
        return self.camera.slots

    @property
    def psnr(self) -> float:
        """Expected, dB."""
        return decibels(self.mse)


def search(
    kind: str,
    slots: int,
    period: tuple[int, int],
    error: TileMse,
    *,
    effort: Effort | None = None,
    starts: Sequence[CodedCamera] = (),
    throughput: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **camera: Any,
) -> Design:
    """The codes of lowest expected error that the effort finds.

    Args:
        kind: name in ``KINDS``.
        slots: number of time slots K.
        period: (rows, columns) of the tile, pixels.
        error: expected error of a tile; for flips of a ``BlockMse``.
        effort: descents, steps and flips.
        starts: cameras whose codes the first descents start from, see ``designable``; the others from random codes.
            The answer is never worse than those that are used.
        throughput: share of light to hold; free if None.
        seed: of the random codes.
        progress: called with the share that is done.
        camera: ``camera_type`` and further arguments of it, see ``designable``.

    Raises:
        SettingError: unknown kind, starts of another kind, no effort, or flips on a mixture.
    """
    effort, begun = effort or Effort(), time.process_time()
    if effort.flips and not isinstance(error.error, BlockMse):
        raise SettingError("flips", f"{effort.flips} on a {type(error.error).__name__}", "0: flips need a BlockMse")
    part = Parts(progress and (lambda share, _: progress(share)), [1.0] * effort.descents + [2.0] * (effort.flips > 0))
    candidates = []
    for number in range(effort.descents):
        start = starts[number] if number < len(starts) else None
        candidate = designable(kind, slots, period, seed=seed + number, start=start, **camera)
        how = Descent(steps=effort.steps, throughput=throughput, seed=seed + number)
        candidates.append((descend(candidate, error, how, part()), number, candidate))
    mse, _, chosen = min(candidates)
    if effort.flips:
        mse = _polish(chosen, error, effort.flips, mse, seed, throughput, part())
    random = designable(kind, slots, period, seed=seed, **camera)
    if throughput is not None:
        hold_throughput(random, throughput)
    return Design(kind, chosen, mse, error.whole(random), time.process_time() - begun)


def _polish(
    camera: CodedCamera,
    error: TileMse,
    flips: int,
    before: float,
    seed: int,
    throughput: float | None,
    progress: Callable[[float], None],
) -> float:
    """Flip, and take the flips back if blocks that the flips did not see say so; the error that is left."""
    best = Best(learnable(camera), before)
    light = None if throughput is None else (camera.throughput(), 0.005)
    flip_greedily(camera, error, most=flips, seed=seed, throughput=light, progress=progress)
    progress(1.0)
    best.meet(error.whole(camera))
    return best.restore()


def decibels(mse: float) -> float:
    """PSNR of a mean squared error against a peak of 1."""
    return -10 * log10(max(mse, 1e-30))
