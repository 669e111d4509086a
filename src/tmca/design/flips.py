"""Greedy flips of single code pixels, each judged exactly by a low-rank update of the expected error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.codes import CodePlane
from tmca.design.expected_error import BlockMse, Products, TileMse, count_places, even_places, windows
from tmca.design.kinds import learnable
from tmca.errors import SettingError
from tmca.operators.blocks import BlockModel

_SHIFTS = 2
"""Of the blocks: judged by one set of them alone, flips favour pixels by their place in a block."""


class Flip(NamedTuple):
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
        self.plane.latent[:, *self.place[1:]] = before


MOST_TILE = 4e9
"""Memory for the blocks of one tile, bytes."""


def tile_bytes(model: BlockModel, period: tuple[int, int]) -> int:
    """Memory that flips need for the blocks of one tile, bytes."""
    half = model.measurements**2 // model.buckets * len(model.offsets)
    return 8 * (2 * half + 2 * model.measurements**2) * count_places(model, period, _SHIFTS)


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


@dataclass(frozen=True)
class BlockState:
    """One block under its present weights, and what changes of a few of them do, without a new factorisation for each.

    A changed pixel of a code changes the weights of r of the m measurements of all buckets. Then ``G`` and ``M``
    change in r rows and columns, and ``tr G⁻¹ M`` follows by the Woodbury identity with matrices of size 2r.

    Args:
        error: of such blocks.
        weights: (m, T), float64.
        products: of these weights, a batch of one.
    """

    error: BlockMse
    weights: Tensor
    products: Products

    @classmethod
    def of(cls, error: BlockMse, weights: Tensor) -> BlockState:
        weights = weights.double()
        return cls(error, weights, Products.of(error, weights[None]))

    @property
    def value(self) -> float:
        """Mean squared error over the valid pixels."""
        return self.error.variance - float(self.products.error_removed[0])

    def after(self, changes: Tensor) -> Tensor:
        """(B,) errors under ``weights + changes[b]``, changes (B, m, T), each of them alone."""
        rows, few = _changed_rows(changes)
        inverse, reached = self.products.inverse[0], self.products.reached[0]
        ahead, among = self._forms(self.error.covariance, self.products.covariant, rows, few)
        ahead_reach, among_reach = self._forms(self.error.reach, self.products.reaching, rows, few)
        means = self.error.means
        light = (self.weights * means).sum(-1)[rows]
        changed_light = (light + (few * means[rows]).sum(-1)).clamp_min(0)
        among = among + torch.diag_embed(self.error.shot * (changed_light - light.clamp_min(0)))
        touched = inverse[:, rows].movedim(0, 1)  # (B, m, r): G⁻¹E
        low = torch.cat([touched, inverse @ ahead.mT], -1)  # G⁻¹U with U = [E, Fᵀ]
        inner = low.gather(1, rows[:, :, None].expand(-1, -1, low.shape[2]))  # Eᵀ G⁻¹ U
        bridge = torch.cat([inner, ahead @ low], 1) + _middle(among)
        turned = inner.mT @ (ahead_reach @ low)
        moved = low.mT @ (reached @ low) + turned + turned.mT + inner.mT @ among_reach @ inner
        gained = 2 * (ahead_reach * touched.mT).sum((1, 2)) + (among_reach * inner[..., : rows.shape[1]]).sum((1, 2))
        lost = torch.linalg.solve(bridge, moved).diagonal(dim1=1, dim2=2).sum(1)
        return self.error.variance - (self.products.error_removed[0] + gained - lost)

    def _forms(self, form: Tensor, half: Tensor, rows: Tensor, changes: Tensor) -> tuple[Tensor, Tensor]:
        """(B, r, m) form between changed and present weights, (B, r, r) between changed and changed ones."""
        places = rows % len(form)  # of the pixels that they see, whatever the bucket
        near = half[:, 0, places]  # (m, B, r, T)
        ahead = torch.einsum("mbrt,brt->brm", near, changes)
        pairs = form[places[:, :, None], :, places[:, None, :], :]  # (B, r, r, T, T)
        return ahead, torch.einsum("brt,brstu,bsu->brs", changes, pairs, changes)


def _changed_rows(changes: Tensor) -> tuple[Tensor, Tensor]:
    """(B, r) rows that change, filled up with others, and (B, r, T) what they change by."""
    touched = (changes != 0).any(-1)
    count = max(1, int(touched.sum(1).max()))
    rows = touched.to(torch.uint8).sort(dim=1, descending=True, stable=True).indices[:, :count]
    return rows, changes.gather(1, rows[:, :, None].expand(-1, -1, changes.shape[2]))


def _middle(among: Tensor) -> Tensor:
    """Inverse of ``[[H, 1], [1, 0]]``: ``[[0, 1], [1, -H]]``."""
    one = torch.eye(among.shape[1], dtype=among.dtype, device=among.device).expand_as(among)
    return torch.cat([torch.cat([torch.zeros_like(among), one], 2), torch.cat([one, -among], 2)], 1)


@dataclass
class TileState:
    """The blocks that share out one period, each with its present weights."""

    error: BlockMse
    code: Tensor
    blocks: list[BlockState]

    @classmethod
    def of(cls, camera: CodedCamera, error: TileMse) -> TileState:
        if not isinstance(error.error, BlockMse):
            raise SettingError("flips", f"the error of a {type(error.error).__name__}", "that of a BlockMse")
        blocks = error.error.for_buckets(camera.buckets)
        state = cls(blocks, camera.taps().code.detach().double(), [])
        state.blocks = [BlockState.of(blocks, weights) for weights in state.weights(state.code[None])[0]]
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
        return self.error.weights(seen).unflatten(0, (len(codes), len(places)))

    def gains(self, changes: Tensor) -> tuple[Tensor, Tensor]:
        """(B,) by how much changes (B, taps, rows, columns) of the code lower the error, and (B, P) whom they touch;
        both on the processor, where flips are chosen."""
        weights = self.weights(changes)
        touched = (weights != 0).flatten(2).any(2)
        gains = weights.new_zeros(len(changes))
        for place, block in enumerate(self.blocks):
            those = touched[:, place].nonzero().flatten()
            if len(those):
                gains[those] += (block.value - block.after(weights[those, place])) / len(self.blocks)
        return gains.cpu(), touched.cpu()

    def move(self, code: Tensor, touched: Tensor) -> None:
        """Take over a code that differs in the blocks (P,) that are touched."""
        self.code, weights = code, self.weights(code[None])[0]
        for place in touched.nonzero().flatten().tolist():
            self.blocks[place] = BlockState.of(self.error, weights[place])


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
        if gains[index] <= 1e-9 * state.error.variance:
            break
        if (touched[index] & taken).any() or flips[index].present():
            continue
        before = flips[index].do()
        if throughput is not None and abs(camera.throughput() - throughput[0]) > throughput[1]:
            flips[index].undo(before)
            continue
        taken |= touched[index]
        state.move(camera.taps().code.detach().double(), touched[index])
        done += 1
    return done


def _change(camera: CodedCamera, state: TileState, flip: Flip) -> Tensor:
    before = flip.do()
    change = camera.taps().code.detach().double() - state.code
    flip.undo(before)
    return change
