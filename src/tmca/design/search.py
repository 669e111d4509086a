"""The best codes of a kind for a noise: descent from random codes, then flips, within a stated effort."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import log10
from typing import Any

from tmca.cameras import SpectralCamera
from tmca.design.descent import Best, Descent, descend, learned
from tmca.design.flips import flip_greedily
from tmca.design.spectral import designable
from tmca.design.tile import CodeError, TileMse
from tmca.errors import SettingError


@dataclass(frozen=True)
class Effort:
    """How hard is searched; the same for static and time-multiplexed codes.

    Args:
        restarts: random codes that are started from.
        steps: of each descent.
        sweeps: of flips over the best of them.
        flips: pixels that are tried in each sweep, at most.
    """

    restarts: int = 1
    steps: int = 240
    sweeps: int = 1
    flips: int = 6000

    def __post_init__(self) -> None:
        if self.restarts < 1 or self.steps < 1 or self.sweeps < 0 or self.flips < 1:
            raise SettingError("effort", str(self), "restarts, steps and flips ≥ 1, sweeps ≥ 0")


SURVEY = Effort(restarts=1, steps=60, sweeps=0)
"""Comes within about 0.1 dB of what more effort finds, in seconds."""


STARTS = 3
"""Searches of every design."""


@dataclass(frozen=True)
class Design:
    """Codes that were found.

    Args:
        kind: their structure, name in ``KINDS``.
        camera: of one period, with these codes.
        mse: expected mean squared error, squared irradiance.
        random: mean of the same over the random codes that were started from.
        seconds: CPU time of the search.
    """

    kind: str
    camera: SpectralCamera
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
    start: SpectralCamera | None = None,
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
        error: expected error of a tile; for sweeps of flips a ``TileMse``.
        effort: restarts, steps and sweeps.
        start: a camera whose codes are started from, see ``designable``; the answer is never worse than it.
        throughput: share of light to hold; free if None.
        seed: of the random codes.
        progress: told the share that is done.
        camera: further arguments of ``SpectralCamera``.

    Raises:
        SettingError: unknown kind, no effort, or flips on another error than a ``TileMse``.
    """
    effort, begun, found = effort or Effort(), time.process_time(), []
    if effort.sweeps and not isinstance(error, TileMse):
        raise SettingError("sweeps", f"{effort.sweeps} on a {type(error).__name__}", "0: flips need a TileMse")
    told = progress or (lambda share: None)
    parts = effort.restarts + (effort.sweeps > 0)
    for restart in range(effort.restarts):
        own = designable(kind, slots, period, seed=seed + restart, start=start, **camera)
        before = error.whole(own)
        how = Descent(steps=effort.steps, throughput=throughput, seed=seed + restart)
        after = descend(own, error, how, lambda share, done=restart: told((done + share) / parts))  # type: ignore[misc]
        found.append((after, restart, own, before))
    best, _, chosen, _ = min(found)
    if effort.sweeps and isinstance(error, TileMse):
        best = _polish(chosen, error, effort, best, seed, throughput)
    told(1.0)
    mean = sum(before for *_, before in found) / len(found)
    return Design(kind, chosen, best, mean, time.process_time() - begun)


def best_design(
    kind: str,
    slots: int,
    period: tuple[int, int],
    error: CodeError,
    *,
    contained: Sequence[SpectralCamera] = (),
    effort: Effort | None = None,
    **others: Any,
) -> Design:
    """The best of several searches, as many for static codes as for free ones.

    Args:
        kind: name in ``KINDS``.
        slots: number of time slots K.
        period: (rows, columns) of the tile, pixels.
        error: expected error of a tile.
        contained: designs that free codes start from as well, since they contain them: two for equal effort.
        effort: of each search.
        others: further arguments of ``search``.
    """
    effort = effort or Effort()
    if kind != "free":
        whole = replace(effort, restarts=STARTS * effort.restarts)
        return search(kind, slots, period, error, effort=whole, **others)
    found = [search(kind, slots, period, error, effort=effort, start=s, **others) for s in (None, *contained)]
    best = min(found, key=lambda design: design.mse)
    return replace(best, seconds=sum(design.seconds for design in found), random=found[0].random)


def _polish(
    camera: SpectralCamera, error: TileMse, effort: Effort, before: float, seed: int, throughput: float | None
) -> float:
    """Flip, and take the flips back if blocks that the flips did not see say so; the error that is left."""
    latents = learned(camera)
    kept = Best(before, [latent.detach().clone() for latent in latents])
    light = None if throughput is None else (camera.throughput(), 0.005)
    flip_greedily(camera, error, sweeps=effort.sweeps, most=effort.flips, seed=seed, throughput=light)
    kept.meet(camera, error, latents)
    return kept.leave(latents)


def decibels(mse: float) -> float:
    """PSNR of a mean squared error against a peak of 1."""
    return -10 * log10(max(mse, 1e-30))
