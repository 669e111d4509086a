"""Greedy flips of single code pixels, each judged exactly by a low-rank update of the expected error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.codes import CodePlane
from tmca.design.block_mse import BlockState
from tmca.design.descent import learnable
from tmca.design.tile import TileMse, count_places, even_places, windows
from tmca.priors.gaussian import BlockModel

_SHIFTS = 2
"""Of the blocks: judged by one set of them alone, flips favour pixels by their place in a block."""


@dataclass(frozen=True)
class Flip:
    """One pixel of a plane turned over; where exactly one slot is open, one pixel moved to another slot."""

    plane: CodePlane
    place: tuple[int, int, int]

    def present(self) -> bool:
        """Whether the pixel shows already what the flip would make it show."""
        return self.plane.family == "one-hot" and int(self.plane.latent[:, *self.place[1:]].argmax()) == self.place[0]

    @torch.no_grad()
    def do(self) -> Tensor:
        """Turn it; returns what ``undo`` needs."""
        slot, row, column = self.place
        before = self.plane.latent[:, row, column].clone()
        if self.plane.family == "one-hot":
            self.plane.latent[:, row, column] = -before.abs().max()
            self.plane.latent[self.place] = before.abs().max()
        else:
            self.plane.latent[self.place] = -before[slot] if before[slot] != 0 else 1e-3
        return before

    @torch.no_grad()
    def undo(self, before: Tensor) -> None:
        """Turn it back."""
        self.plane.latent[:, self.place[1], self.place[2]] = before


def tile_bytes(model: BlockModel, period: tuple[int, int]) -> int:
    """Memory that flips need for the blocks of one tile, bytes."""
    measurements, taps = model.measurements, len(model.offsets)
    block = 8 * measurements * measurements * (2 * taps + 2)
    return block * count_places(model, period, _SHIFTS)


def flip_greedily(
    camera: CodedCamera,
    error: TileMse,
    *,
    most: int | None = None,
    batch: int = 48,
    seed: int = 0,
    throughput: tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> float:
    """Turn over, pixel by pixel in random order, what lowers the expected error, in place.

    Args:
        camera: as large as one period of its codes, with learnable planes.
        error: of its tile; blocks stay where they are, so that the error falls with every flip.
        most: pixels that are tried in all sweeps; every pixel once if None. Ends earlier when a sweep finds nothing.
        batch: flips that are judged together.
        seed: of the order.
        throughput: share of light to hold and how far it may stray from it.
        progress: called with the share that is done.

    Returns:
        Expected mean squared error of the codes that the camera is left with, of the same blocks.

    Raises:
        SettingError: nothing to turn.
    """
    state, flips = TileState.of(camera, error), _flips(camera)
    generator, most = torch.Generator().manual_seed(seed), len(flips) if most is None else most
    left, helped = most, True
    while left > 0 and helped:
        order, helped = torch.randperm(len(flips), generator=generator)[:left].tolist(), False
        for start in range(0, len(order), batch):
            helped |= _turn(camera, state, [flips[i] for i in order[start : start + batch]], throughput) > 0
            if progress:
                progress(min(1.0, 1 - (left - start - batch) / most))
        left -= len(order)
    return state.value


@dataclass
class TileState:
    """The blocks that share out one period, each with its present weights."""

    error: TileMse
    code: Tensor
    blocks: list[BlockState]

    @classmethod
    def of(cls, camera: CodedCamera, error: TileMse) -> TileState:
        code = camera.taps().code.detach().double()
        state = cls(error, code, [])
        state.blocks = [BlockState.of(error.error, weights) for weights in state.weights(code[None])[0]]
        return state

    @property
    def value(self) -> float:
        """Mean squared error of the tile."""
        return sum(block.value for block in self.blocks) / len(self.blocks)

    def weights(self, codes: Tensor) -> Tensor:
        """(B, P, m, T) weights of the blocks under codes (B, taps, rows, columns)."""
        model = self.error.model
        places = even_places(model, (codes.shape[2], codes.shape[3]), _SHIFTS)
        seen = windows(codes.flatten(0, 1), model.block, places)  # (P, B·taps, h, w)
        seen = seen.unflatten(1, codes.shape[:2]).transpose(0, 1).flatten(0, 1)
        return self.error.error.weights(seen).unflatten(0, (len(codes), len(places)))

    def gains(self, changes: Tensor) -> tuple[Tensor, Tensor]:
        """(B,) by how much changes (B, taps, rows, columns) of the code lower the error, and (B, P) whom they touch."""
        weights = self.weights(changes)
        touched = (weights != 0).flatten(2).any(2)
        gains = torch.zeros(len(changes), dtype=torch.float64)
        for place, block in enumerate(self.blocks):
            those = touched[:, place].nonzero().flatten()
            if len(those):
                gains[those] += (block.value - block.after(weights[those, place])) / len(self.blocks)
        return gains, touched

    def move(self, code: Tensor, touched: Sequence[bool]) -> None:
        """Take over a code that differs in the blocks that are touched."""
        self.code, weights = code, self.weights(code[None])[0]
        for place, is_touched in enumerate(touched):
            if is_touched:
                self.blocks[place] = BlockState.of(self.error.error, weights[place])


def _flips(camera: CodedCamera) -> list[Flip]:
    learnable(camera)  # refuses a camera without any
    planes = [p for p in (camera.codes.aperture, camera.codes.shutter) if p.learnable]
    return [Flip(plane, (k, y, x)) for plane in planes for k, y, x in product(*map(range, plane.latent.shape))]


@torch.no_grad()
def _turn(camera: CodedCamera, state: TileState, flips: list[Flip], throughput: tuple[float, float] | None) -> int:
    """Judge some flips together, do those that help and do not touch each other's blocks; how many were done."""
    flips = [flip for flip in flips if not flip.present()]
    if not flips:
        return 0
    gains, touched = state.gains(torch.stack([_change(camera, state, flip) for flip in flips]))
    done, taken = 0, torch.zeros(len(state.blocks), dtype=torch.bool)
    for index in gains.argsort(descending=True).tolist():
        if gains[index] <= 1e-9 * state.error.error.variance:
            break
        if (touched[index] & taken).any() or flips[index].present():
            continue
        before, light = flips[index].do(), camera.throughput()
        if throughput is not None and abs(light - throughput[0]) > throughput[1]:
            flips[index].undo(before)
            continue
        taken |= touched[index]
        state.move(camera.taps().code.detach().double(), touched[index].tolist())
        done += 1
    return done


def _change(camera: CodedCamera, state: TileState, flip: Flip) -> Tensor:
    before = flip.do()
    change = camera.taps().code.detach().double() - state.code
    flip.undo(before)
    return change
