"""What a snapshot says of the motion of every part of a scene, and of how fine the scene is there.

That is the evidence of a motion: the probability of the measurements of blocks under the Gaussian prior of scenes that
move so, summed over the blocks around a place. How fine the scene is is decided first; else a smooth scene at rest
would be taken for one that a motion blurs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, inf, log
from typing import NamedTuple

import torch
from torch import Tensor

from tmca.decoders.decoder import Progress
from tmca.decoders.lmmse import solved_parts
from tmca.operators.block_layout import BlockLayout, Places, usual_stride
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.operators.taps import Taps
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.gaussian_posterior import BlockPosterior, GaussianSolver
from tmca.priors.moving import moving_prior, reach_of, smoother_prior
from tmca.sensor import Noise

BLURS = (0, 4)
"""Pixels, less one, of the kernels by which scenes may be smoother than those of the prior. A third, 2, changed next to
nothing on a validation scene."""
NEGLIGIBLE = 1e-2
"""Probability of a motion that adds nothing worth its time."""
_SPLIT, _FINEST = 3, 0.5  # parts of a square of displacements along an axis, and the side at which parting ends, pixels
_PARTED, _BEHIND = 2, 6.0  # squares that are parted together, where they are no further behind the best in log evidence


class Motions(NamedTuple):
    """Displacements over the exposure that are as likely: a square around ``centre`` (rows, columns), pixels; rest,
    without a side."""

    centre: tuple[float, float] = (0.0, 0.0)
    side: float = 0.0

    def displacements(self) -> list[tuple[float, float]]:
        """Evenly through the square, at most a pixel apart."""
        return self._grid(max(2, ceil(self.side))) if self.side else [self.centre]

    def parts(self) -> list[Motions]:
        """Smaller squares that fill it."""
        return [Motions(centre, self.side / _SPLIT) for centre in self._grid(_SPLIT)]

    def _grid(self, count: int) -> list[tuple[float, float]]:
        steps = [self.side * ((step + 0.5) / count - 0.5) for step in range(count)]
        return [(self.centre[0] + down, self.centre[1] + across) for down in steps for across in steps]


REST = Motions()
Key = tuple[int, Motions]
"""A blur (pixels) and a motion."""
Place = tuple[int, int]
"""(top, left) of a block."""


@dataclass(frozen=True)
class MotionPriors:
    """Gaussian priors of the frames of moving scenes, behind one camera.

    Args:
        still: prior of scenes that stand still.
        frames: G of equal length in the exposure.
        motion: largest displacement over the exposure along each axis, pixels.
        block: (rows, columns) at most.
        taps, noise: of the camera whose channels are those of all frames.
    """

    still: GaussianPrior
    frames: int
    motion: float
    block: tuple[int, int]
    taps: Taps
    noise: Noise

    @cached_property
    def blurs(self) -> list[int]:
        """Kernels for which the prior's blocks have room."""
        room = min(side - least for side, least in zip(self.still.block[1:], self.block, strict=True))
        return [blur for blur in BLURS if blur <= max(0, room - reach_of(self.motion))]

    def prior(self, blur: int, motion: Motions) -> GaussianPrior:
        """Of scenes of some blur that move so."""
        still = smoother_prior(self.still, blur) if blur else self.still
        return moving_prior(still, self.frames, self.motion, self.block, motion.displacements())

    @cached_property
    def model(self) -> BlockModel:
        """Of the blocks behind the camera."""
        return BlockModel.of(self.taps, self.prior(0, REST).block)

    def solver(self, blur: int, motion: Motions) -> GaussianSolver:
        """Of blocks of such scenes; made anew each time, as it holds tens of megabytes once it was used."""
        return GaussianSolver(self.prior(blur, motion), self.model, self.noise)


class Evidence:
    """What one snapshot says of scenes and their motion, at places about a block apart; some rows between the blocks, a
    quarter of them at most, say nothing.

    Args:
        priors: of moving scenes.
        snapshot: (1, R, H, W').
    """

    def __init__(self, priors: MotionPriors, snapshot: Tensor) -> None:
        self.priors = priors
        self.layout, stride = _apart(priors)
        self.snapshot = self.layout.grid.pad_snapshot(snapshot)
        self.places = [place for group in self.layout.groups for place in group]
        self._index = {place: index for index, place in enumerate(self.places)}
        at = torch.tensor(self.places)
        self.whole = Motions((0.0, 0.0), 2 * priors.motion)
        self.around = ((at[:, None] - at).abs() <= torch.tensor(stride)).all(-1)

    def of(self, solver: GaussianSolver, here: Tensor) -> Tensor:
        """(P,) log evidence at the places ``here`` (P,), minus infinity elsewhere: the sum of the blocks around."""
        values = torch.zeros(len(self.places), dtype=torch.float64)
        needed = self.around[here].any(0)
        groups = some_of(self.layout.groups, {place for place, index in self._index.items() if needed[index]})
        for block in solved_blocks(self.layout, solver, groups, self.snapshot):
            said = block.posterior.log_evidence(block.number, block.measured)
            values[[self._index[place] for place in block.places]] = said.to(values)
        return torch.where(here, self.around.double() @ values, -inf)

    def probable(self, rest: float, progress: Progress | None = None) -> dict[Key, Tensor]:
        """(P,) probability at every place of blurs and motions; ``rest`` is that, beforehand, of a part at rest."""
        logs, blurs = self._first(rest), self.priors.blurs
        for index, blur in enumerate(blurs):
            if progress:
                progress((index + 1) / (len(blurs) + 1))
            if self.whole.side and (blur, self.whole) in logs:
                logs |= {(blur, motion): one for motion, one in self._closer(blur, logs, log(1 - rest)).items()}
        probabilities = torch.softmax(torch.stack(list(logs.values())), 0)
        return {key: one for key, one in zip(logs, probabilities, strict=True) if (one > NEGLIGIBLE).any()}

    def _first(self, rest: float) -> dict[Key, Tensor]:
        """(P,) logs of rest and of all motions together, under the blur that is most likely at each place."""
        everywhere = torch.ones(len(self.places), dtype=torch.bool)
        shares = {REST: rest, self.whole: 1 - rest} if self.whole.side else {REST: 1.0}
        logs = {
            (blur, motion): self.of(self.priors.solver(blur, motion), everywhere) + log(share)
            for blur in self.priors.blurs
            for motion, share in shares.items()
            if share
        }
        best = torch.stack(list(logs.values())).amax(0)
        chosen = {blur: torch.stack([one for key, one in logs.items() if key[0] == blur]).amax(0) == best
                  for blur in self.priors.blurs}  # fmt: skip
        return {key: torch.where(chosen[key[0]], one, -inf) for key, one in logs.items() if chosen[key[0]].any()}

    def _closer(self, blur: int, logs: Mapping[Key, Tensor], moves: float) -> dict[Motions, Tensor]:
        """(P,) logs of all motions and of ever smaller squares of them, where these say more than rest and all motions
        together do. A square that is parted leaves half of its probability beforehand to its parts.

        Args:
            moves: log probability of motion beforehand.
        """
        known = torch.maximum(logs[blur, self.whole], logs.get((blur, REST), logs[blur, self.whole]))
        every, before = {self.whole: logs[blur, self.whole]}, {self.whole: moves}
        parted = {self.whole: every[self.whole] > known - _BEHIND}
        while parted and next(iter(parted)).side > _FINEST:
            tried: dict[Motions, Tensor] = {}
            for motion, here in parted.items():
                every[motion] = torch.where(here, every[motion] - log(2), every[motion])
                share = before[motion] - log(2 * _SPLIT**2)
                before |= dict.fromkeys(motion.parts(), share)
                tried |= {part: self.of(self.priors.solver(blur, part), here) + share for part in motion.parts()}
            every |= tried
            gains = {motion: float((one - known).clamp_min(0).nan_to_num().sum()) for motion, one in tried.items()}
            known = torch.maximum(known, torch.stack(list(tried.values())).amax(0))
            best = sorted((motion for motion in tried if gains[motion] > 0), key=gains.__getitem__, reverse=True)
            likely = {motion: tried[motion] > known - _BEHIND for motion in best[:_PARTED]}
            parted = {motion: here for motion, here in likely.items() if here.any()}
        return every


class SolvedBlock(NamedTuple):
    """Blocks that see equal codes: where they lie, which one of a posterior they are, and their measurements (N, m)."""

    places: Places
    number: int
    measured: Tensor
    posterior: BlockPosterior


def solved_blocks(
    layout: BlockLayout, solver: GaussianSolver, groups: list[Places], snapshot: Tensor, variance: bool = False
) -> Iterator[SolvedBlock]:
    """Blocks of some groups under one prior, for a padded snapshot (1, R, H, W')."""
    for part, posterior in solved_parts(layout, solver, groups, 0, variance):  # no rows: the solver is used but once
        assert isinstance(posterior, BlockPosterior)
        for number, places in enumerate(part):
            measured = layout.grid.snapshot_windows(snapshot, places).flatten(0, 1)
            yield SolvedBlock(places, number, measured, posterior)


def _apart(priors: MotionPriors) -> tuple[BlockLayout, tuple[int, int]]:
    """Blocks whose measurements hardly overlap, and the rows and columns from one to the next: of those that estimates
    are blended from, so that blocks under the same part of a tile share their matrices."""
    model, code = priors.model, priors.taps.code
    down, across = usual_stride(model, code)
    rows, columns = -(-model.block[1] // down), max(1, model.columns // across)
    every = BlockGrid.cover(model, (code.shape[1], code.shape[2]), (down, across))
    grid = replace(every, tops=every.tops[::rows], lefts=every.lefts[::columns])
    return BlockLayout(grid, grid.pad_code(code.detach())), (rows * down, columns * across)


def some_of(groups: list[Places], places: set[Place]) -> list[Places]:
    """The groups with these places alone; none that are empty."""
    parts = ([place for place in group if place in places] for group in groups)
    return [part for part in parts if part]
