"""Scenes of which every part moves in its own way, or rests: the patch LMMSE under a mixture of motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import log
from typing import Any

import torch
from torch import Tensor

from tmca.cameras.frames import frame_taps
from tmca.decoders.batches import one_by_one, part_of
from tmca.decoders.decoder import Progress
from tmca.decoders.lmmse import Blended, PatchEstimator, blend_window, few
from tmca.decoders.motion_evidence import (
    BLURS,
    NEGLIGIBLE,
    REST,
    Evidence,
    Key,
    MotionPriors,
    Place,
    SolvedBlock,
    solved_blocks,
    some_of,
)
from tmca.decoders.moving import SpaceTimeLMMSE
from tmca.errors import check_range, check_shape
from tmca.operators.block_layout import BlockLayout, Canvas, Places, usual_stride
from tmca.operators.taps import Taps
from tmca.priors.gaussian_posterior import GaussianSolver
from tmca.priors.moving import moving_block, smoother_prior

_MOST = 6  # blurs and motions that are looked at in one block: where a snapshot says little, many are as probable
_MEMORY = 2**28  # bytes of the estimates of blocks that are held at once
Shares = dict[Place, dict[Key, float]]
"""How probable blurs and motions are, by the place of a block."""


class MotionEstimator:
    """Frames of scenes behind snapshots, each part under the motions that are probable there; parts at rest are
    estimated in blocks as large as those of still scenes.

    Args:
        priors: of moving scenes behind the camera.
        taps: of the camera before scenes that stand still.
        rest: probability that a part does not move.
    """

    def __init__(self, priors: MotionPriors, taps: Taps, rest: float) -> None:
        self.priors, self.taps, self.rest = priors, taps, rest
        self.layout = BlockLayout.of(priors.model, priors.taps, usual_stride(priors.model, priors.taps.code))
        self._still: dict[int, PatchEstimator] = {}

    @cached_property
    def window(self) -> Tensor:
        """(G·L, h, w) weights of the places in a block."""
        return blend_window(self.layout, self.priors.solver(0, REST))

    def still(self, blur: int) -> PatchEstimator:
        """Of scenes of some blur that stand still."""
        if blur not in self._still:
            prior = smoother_prior(self.priors.still, blur) if blur else self.priors.still
            estimator = self._still[blur] = PatchEstimator(prior, self.taps, self.priors.noise)
            _ = estimator.window
            if isinstance(estimator.solver, GaussianSolver):
                estimator.solver.drop_rows()  # the window takes hundreds of megabytes of them
        return self._still[blur]

    def __call__(self, snapshot: Tensor, *, uncertainty: bool = False, progress: Progress | None = None) -> Blended:
        """The frames (B, G·L, H, W) behind snapshots (B, R, H, W'), with their standard deviation if asked for."""
        check_shape("snapshot", snapshot, ("B", *self.taps.snapshot_shape))
        parts = [self._one(one, uncertainty, report) for one, report in one_by_one(snapshot, progress)]
        return Blended.joined(parts)

    @torch.no_grad()
    def _one(self, snapshot: Tensor, uncertainty: bool, progress: Progress) -> Blended:
        snapshot = snapshot.to(self.window.dtype)
        evidence = Evidence(self.priors, snapshot)
        probable = self._at_blocks(evidence, evidence.probable(self.rest, part_of(progress, 0, 0.6)))
        shares = self._shares(snapshot, probable)
        blended = self._blended(snapshot, shares, uncertainty, part_of(progress, 0.7, 0.9))
        progress(1.0)
        return blended

    def _at_blocks(self, evidence: Evidence, probable: Mapping[Key, Tensor]) -> Shares:
        """Of every block, what is probable around it, and how much so at most."""
        at, keys, table = torch.tensor(evidence.places), list(probable), torch.stack(list(probable.values()))
        about = torch.stack([table[:, near].amax(1) for near in evidence.around], 1)
        shares: Shares = {}
        for place in self.layout.grid.positions:
            near = about[:, int((at - torch.tensor(place)).abs().amax(-1).argmin())]
            best = near.topk(min(_MOST, len(keys)))
            pairs = zip(best.indices.tolist(), best.values.tolist(), strict=True)
            shares[place] = {keys[index]: share for index, share in pairs if share > NEGLIGIBLE}
        return shares

    def _shares(self, snapshot: Tensor, probable: Shares) -> Shares:
        """What a block's own measurements leave of what is probable around it, as if these were others: a block that
        says little of motion follows its neighbours, and shares are somewhat too sure."""
        logs = {place: {key: log(share) for key, share in some.items()} for place, some in probable.items()}
        contested = {place: some for place, some in probable.items() if len(some) > 1}
        for key, block in self._solved(snapshot, self.layout.groups, contested):
            said = block.posterior.log_evidence(block.number, block.measured).tolist()
            for place, one in zip(block.places, said, strict=True):
                logs[place][key] += one
        return {place: _probabilities(some) for place, some in logs.items()}

    def _solved(
        self, snapshot: Tensor, groups: list[Places], shares: Shares, variance: bool = False
    ) -> Iterator[tuple[Key, SolvedBlock]]:
        """Blocks of some groups under every motion that counts there."""
        padded = self.layout.grid.pad_snapshot(snapshot)
        here = [place for group in groups for place in group if place in shares]
        for key in dict.fromkeys(key for place in here for key in shares[place]):
            some = some_of(groups, {place for place in here if key in shares[place]})
            for block in solved_blocks(self.layout, self.priors.solver(*key), some, padded, variance):
                yield key, block

    def _blended(self, snapshot: Tensor, shares: Shares, uncertainty: bool, progress: Progress) -> Blended:
        grid, window = self.layout.grid, self.window
        first, last = grid.model.valid
        mean, spread = Canvas(grid, 1, window), Canvas(grid, 1, window[..., first:last].contiguous())
        moving = {place: {key: p for key, p in some.items() if key[1] != REST} for place, some in shares.items()}
        left, done = grid.padding[0], 0
        for groups in self._chunks():
            for (top, edge), (estimate, variance) in self._moving(snapshot, groups, moving, uncertainty).items():
                mean.add(top, edge + left, estimate[None])
                if uncertainty:
                    spread.add(top, edge + left + first, variance[None])
            done += len(groups)
            progress(done / len(self.layout.groups))
        return self._with_rest(snapshot, mean.mean(), spread.mean() if uncertainty else None, self._at_rest(shares))

    def _chunks(self) -> Iterator[list[Places]]:
        """Groups of blocks whose estimates are held together."""
        most = max(1, _MEMORY // (self.window.numel() * self.window.element_size()))
        return ([self.layout.groups[index] for index in some] for some in few(self.layout.groups, most))

    def _moving(
        self, snapshot: Tensor, groups: list[Places], moving: Shares, uncertainty: bool
    ) -> dict[Place, tuple[Tensor, Tensor]]:
        """Of every block its estimate (n,), and the variance of its valid columns if asked for, of each motion and
        between motions; both times the probability that it moves."""
        pick, window = self.layout.grid.model.in_valid, self.window
        nothing = window.new_zeros(window.numel())
        means = {place: nothing for group in groups for place in group}
        squares = {place: pick(nothing) for place in means}
        for key, block in self._solved(snapshot, groups, moving, uncertainty):
            ((estimates, variances),) = block.posterior.moments([block.number], [block.measured], uncertainty)
            for number, place in enumerate(block.places):
                share, one = moving[place][key], estimates[number]
                means[place] = means[place] + share * one
                if variances is not None:
                    squares[place] = squares[place] + share * (variances[number] + pick(one).square())
        return {
            place: (one, (squares[place] - pick(one).square() / max(sum(moving[place].values()), 1e-9)).clamp_min(0))
            for place, one in means.items()
        }

    def _at_rest(self, shares: Shares) -> dict[int, Tensor]:
        """(1, G·L, H, W) by blur: how probable rest is."""
        grid, count = self.layout.grid, self.window.numel()
        blurs = sorted({blur for some in shares.values() for blur, motion in some if motion == REST})
        canvases = {blur: Canvas(grid, 1, self.window) for blur in blurs}
        for (top, left), some in shares.items():
            for blur, canvas in canvases.items():
                share = some.get((blur, REST), 0.0)
                canvas.add(top, left + grid.padding[0], self.window.new_full((1, count), share))
        return {blur: canvas.mean() for blur, canvas in canvases.items()}

    def _with_rest(
        self, snapshot: Tensor, moving: Tensor, spread: Tensor | None, rest: Mapping[int, Tensor]
    ) -> Blended:
        """Estimate and variance of what moves, times its probability, and of what rests with that of each blur."""
        estimate, frames = moving, self.priors.frames
        square = None
        if spread is not None:
            moves = 1 - torch.stack(list(rest.values())).sum(0) if rest else torch.ones_like(moving)
            square = spread + moving.square() / moves.clamp_min(1e-6)
        for blur, share in rest.items():
            still = self.still(blur)(snapshot, uncertainty=spread is not None)
            values = still.estimate.repeat(1, frames, 1, 1)
            estimate = estimate + share * values
            if square is not None and still.deviation is not None:
                square = square + share * (still.deviation.repeat(1, frames, 1, 1).square() + values.square())
        return Blended(estimate, None if square is None else (square - estimate.square()).clamp_min(0).sqrt())


def _probabilities(logs: Mapping[Key, float]) -> dict[Key, float]:
    """Those of log probabilities up to a constant, without what is negligible."""
    shares = torch.softmax(torch.tensor(list(logs.values()), dtype=torch.float64), 0)
    shares = torch.where(shares > NEGLIGIBLE, shares, 0)
    return {key: share for key, share in zip(logs, (shares / shares.sum()).tolist(), strict=True) if share}


@dataclass
class SpaceTimeMixture(SpaceTimeLMMSE):
    """All frames under a mixture of Gaussian priors: blocks at rest, and blocks that move by any displacement, each as
    probable as the snapshot makes it.

    Args:
        uncertainty: also predict the standard deviation of every entry.
        frames: how many, of equal length, a divisor or a multiple of the slots; up to four if None.
        motion: largest displacement over the exposure along each axis that is expected, pixels.
        rest: probability, before anything is measured, that a part of the scene does not move, 0 to 1.
    """

    name, label = "space-time-mixture", "space-time mixture"
    room = max(BLURS)
    rest: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("rest", self.rest, 0, 1)

    def setup(self, camera: Any, prior: Any) -> Any:
        frames = self._frames(camera)
        taps = frame_taps(camera, frames)
        still, block = prior.to(taps.code.device), moving_block(camera, frames)
        priors = MotionPriors(still, frames, self.motion, block, taps, camera.noise)
        return MotionEstimator(priors, camera.taps(), self.rest)
