"""A network that learns a little more from the snapshot at hand: test-time adaptation, which needs no truth.

Some pixels are hidden from the network, and it learns to predict them from the others. Pixels that are hidden all the
time say when to stop: from where their error grows the network learns the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from math import isnan, nan
from typing import Any, Self

import torch
from torch import Tensor

from tmca.decoders.batches import part_of
from tmca.decoders.decoder import Progress
from tmca.decoders.nets.tiles import CollapsedNetwork, Tile, window_of
from tmca.errors import check_range
from tmca.operators import TapOperator, Taps

RATE = 1e-4
"""Of Adam. Of a real capture (``studies/real/adaptation.py``) hidden pixels were predicted best after 20 steps."""
HIDDEN = 0.1
"""Share of the pixels that are hidden at a time."""
_FOLDS = 3
"""Sets of hidden pixels that are learned from."""
_ROWS = 96
"""Of a frame that are learned from in a step."""
_EVERY, _PATIENCE = 5, 3
"""Steps from one look at the pixels of the stop to the next, and looks without a gain."""
_STARTED = 0.5
"""Share of the time that first estimates take, as a rule."""


@dataclass(frozen=True)
class Blind:
    """A snapshot some pixels of which are hidden, and what it starts from.

    Args:
        hidden: (H, W') True where a pixel is.
        snapshot: (B, R, H, W'), zero there.
        operator: that sees nothing there.
        start: (B, L, H, W) first estimates.
    """

    hidden: Tensor
    snapshot: Tensor
    operator: TapOperator
    start: Tensor

    @classmethod
    def of(cls, run: CollapsedNetwork, snapshot: Tensor, hidden: Tensor) -> Self:
        operator = TapOperator(without(run.operator.taps, hidden))
        seen = snapshot * ~hidden
        return cls(hidden, seen, operator, run.starts(operator)(seen, None))

    def error(self, network: Any, run: CollapsedNetwork, snapshot: Tensor, tile: Tile) -> tuple[Tensor, Tensor]:
        """Sums over the hidden pixels of a tile's rows: of squared errors of their prediction, and of their squares."""
        light, part = window_of(self.operator, self.snapshot, tile)
        estimate = network.outputs(light, part, run.noise, self.start[(..., *tile.seen)])[0]
        truth, whole = window_of(run.operator, snapshot, tile)
        rows, columns = tile.inner[0], slice(tile.seen[1].start, tile.seen[1].start + truth.shape[-1])
        hidden = self.hidden[tile.seen[0], columns][rows]
        return (
            ((whole.A(estimate) - truth)[..., rows, :].square() * hidden).sum(),
            (truth[..., rows, :].square() * hidden).sum(),
        )


def without(taps: Taps, hidden: Tensor) -> Taps:
    """The taps of a sensor of which some pixels (H, W') see nothing."""
    open_, columns = (~hidden).to(taps.code), taps.code.shape[2]
    shown = torch.stack([open_[:, offset : offset + columns] for offset in taps.offsets])
    return replace(taps, code=taps.code * shown)


@dataclass(frozen=True)
class AdaptedNetwork:
    """A network after adaptation.

    Args:
        run: the decoder with it.
        steps: that it learned.
        before, after: relative error of the pixels that say when to stop, root mean square; NaN where they are dark.
    """

    run: CollapsedNetwork
    steps: int
    before: float
    after: float

    def __str__(self) -> str:
        if isnan(self.before):
            return "0 steps: the hidden pixels are dark"
        return f"{self.steps} steps, hidden pixels {self.before:.2%} → {self.after:.2%}"


def adapt_network(
    run: CollapsedNetwork, snapshot: Tensor, steps: int, *, stop: bool = True, progress: Progress | None = None
) -> AdaptedNetwork:
    """Adapt a network to a snapshot of its camera; the given one stays as it is.

    Only the estimate is learned; a standard deviation that the network predicts changes with it, and is not.

    Args:
        run: the network behind its camera.
        snapshot: (1, R, H, W').
        steps: of Adam, at most.
        stop: end where the error of pixels that are never learned from has not fallen for a while, and take the step
            at which it was least; False takes the last step.
        progress: called with the share that is done.

    Raises:
        SettingError: less than a step.
    """
    check_range("adapt", steps, 1)
    random = torch.Generator().manual_seed(0)
    watched, *learned = _blinds(run, snapshot, random, part_of(progress, 0, _STARTED))
    network = deepcopy(run.network).requires_grad_(True)
    before = _watched(watched, network, run, snapshot)
    if isnan(before):
        return AdaptedNetwork(run, 0, before, before)
    best, look = _Best(network, before), partial(_watched, watched, network, run, snapshot)
    optimiser, report = torch.optim.Adam(network.parameters(), RATE), part_of(progress, _STARTED, 1)
    for step in range(1, steps + 1):
        _learn(learned[step % _FOLDS], network, run, snapshot, optimiser, random)
        report(step / steps)
        if stop and (step % _EVERY == 0 or step == steps) and best.is_past(look(), step):
            break
    report(1.0)
    if not stop:
        return AdaptedNetwork(run.with_network(network), steps, before, look())
    network.load_state_dict(best.state)
    return AdaptedNetwork(run.with_network(network), best.step, before, best.error)


class _Best:
    """A network at its least error so far."""

    def __init__(self, network: Any, error: float) -> None:
        self.network, self.error, self.step, self._waited = network, error, 0, 0
        self.state = deepcopy(network.state_dict())

    def is_past(self, error: float, step: int) -> bool:
        """Take the state after a step if its error is less; whether it has not been less for some looks."""
        if error < self.error:
            self.error, self.step, self._waited = error, step, 0
            self.state = deepcopy(self.network.state_dict())
        else:
            self._waited += 1
        return self._waited == _PATIENCE


def _blinds(
    run: CollapsedNetwork, snapshot: Tensor, random: torch.Generator, report: Callable[[float], None]
) -> list[Blind]:
    """The snapshot without each of some sets of pixels, the first of which says when to stop."""
    draw = torch.rand(snapshot.shape[-2:], generator=random).to(snapshot.device)
    made = list[Blind]()
    for fold in range(_FOLDS + 1):
        hidden = (draw >= HIDDEN * fold) & (draw < HIDDEN * (fold + 1))
        made.append(Blind.of(run, snapshot, hidden))
        report(len(made) / (_FOLDS + 1))
    return made


@torch.enable_grad()
def _learn(
    blind: Blind, network: Any, run: CollapsedNetwork, snapshot: Tensor, optimiser: Any, random: torch.Generator
) -> None:
    """One step on some rows of a frame; none where their hidden pixels are dark."""
    height, width = run.size
    rows = min(_ROWS, height)
    top = int(torch.randint((height - rows) // network.multiple + 1, (), generator=random)) * network.multiple
    place = (slice(top, top + rows), slice(0, width))
    whole = Tile(place, place, (slice(0, rows), slice(0, width)))
    optimiser.zero_grad()
    error, power = blind.error(network, run, snapshot, whole)
    if float(power) > 0:
        (error / power).backward()
        optimiser.step()


@torch.no_grad()
def _watched(blind: Blind, network: Any, run: CollapsedNetwork, snapshot: Tensor) -> float:
    """Relative error of the hidden pixels of a whole frame; NaN where they are dark."""
    sums = torch.stack([torch.stack(blind.error(network, run, snapshot, tile)) for tile in run.tiles]).sum(0)
    return float((sums[0] / sums[1]).sqrt()) if float(sums[1]) > 0 else nan
