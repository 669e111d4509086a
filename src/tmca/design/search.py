"""The best codes of a kind for a noise: descent from random codes, then flips, within a stated effort."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log10
from typing import Any

from tmca.cameras import CodedCamera
from tmca.design.descent import Best, Descent, Parts, descend, learnable
from tmca.design.flips import flip_greedily
from tmca.design.kinds import designable, hold_throughput
from tmca.design.tile import CodeError, TileMse
from tmca.errors import SettingError, check_range


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
    error: CodeError,
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
        error: expected error of a tile; for flips a ``TileMse``.
        effort: descents, steps and flips.
        starts: cameras whose codes the first descents start from, see ``designable``; the others from random codes.
            The answer is never worse than those that are used.
        throughput: share of light to hold; free if None.
        seed: of the random codes.
        progress: called with the share that is done.
        camera: ``camera_type`` and further arguments of it, see ``designable``.

    Raises:
        SettingError: unknown kind, starts of another kind, no effort, or flips on another error than a ``TileMse``.
    """
    effort, begun = effort or Effort(), time.process_time()
    if effort.flips and not isinstance(error, TileMse):
        raise SettingError("flips", f"{effort.flips} on a {type(error).__name__}", "0: flips need a TileMse")
    part = Parts(progress and (lambda share, _: progress(share)), [1.0] * effort.descents + [2.0] * (effort.flips > 0))
    candidates = []
    for number in range(effort.descents):
        start = starts[number] if number < len(starts) else None
        candidate = designable(kind, slots, period, seed=seed + number, start=start, **camera)
        how = Descent(steps=effort.steps, throughput=throughput, seed=seed + number)
        candidates.append((descend(candidate, error, how, part()), number, candidate))
    mse, _, chosen = min(candidates)
    if effort.flips and isinstance(error, TileMse):
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
