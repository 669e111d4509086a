"""A trained decoder that learns on, from captures instead of simulated snapshots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from tmca.decoders.nets.network import TILE
from tmca.decoders.nets.tiles import Tile, tiles
from tmca.training.patches import Patch
from tmca.training.system import Seen, System, TrainingSystem
from tmca.tuning.captures import Captures, Windows

WHOLE = 256
"""Rows up to which captures are taken whole where the settings do not say."""


class TunedSystem(System):
    """A network that learns from windows of captures (thesis 5.3); camera and codes stay as they are.

    The first estimate is made of the whole capture, and a window passes the network with all around it that it sees, so
    that the loss of a window is that of the same pixels of the whole estimate.

    Args:
        simulated: what the camera and the network are in a training by simulation; its losses and figures of merit
            are taken.
        captures: with their truth; the first of them are learned from.
        side: rows of the windows that are drawn from these, see `Windows`; ``WHOLE`` if None.
        batch: windows per step.
        seed: of the windows.
    """

    def __init__(self, simulated: TrainingSystem, captures: Captures, side: int | None, batch: int, seed: int) -> None:
        super().__init__(simulated.camera, simulated.network)
        self._simulated = (simulated,)  # in a tuple: its modules are those that are registered here
        self.captures = captures
        self.windows = Windows(captures.learned, captures.size, side or WHOLE, simulated.mixes_columns, batch, seed)

    @property
    def simulated(self) -> TrainingSystem:
        """Camera and network in a training by simulation."""
        return self._simulated[0]

    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """See `System`: ``patches`` hold the truth of the windows of this step; ``start`` is not used."""
        losses = []
        for patch, index in zip(patches, indexes, strict=True):
            which, *place = self.windows(step, index)
            losses.append(self.simulated.cost(self.estimate(which, self._tile(place)), self._moved(patch.truth)))
        return torch.stack(losses).mean()

    def estimate(self, which: int, tile: Tile) -> Any:
        """The estimate of a tile of a capture."""
        seen, start = self._seen(which), self._start(which)
        start = None if start is None else start[(..., *tile.seen)].to(seen.snapshot)
        estimate = self.simulated.decode(self.simulated.cut(seen, tile), start)
        parts = (part[(..., *tile.inner)] for part in self.simulated.tensors(estimate))
        return self.simulated.estimate_of(*parts)

    @torch.no_grad()
    def whole(self, which: int, side: int | None = None) -> Any:
        """The estimate of a whole capture, from tiles of at most ``side`` rows (and columns)."""
        size: tuple[int, int] = self.camera.size
        rows: int = side or getattr(self.network, "tile", TILE)  # type: ignore[assignment]
        made = list[Tensor]()
        sides = (rows, size[1] if self.simulated.mixes_columns else rows)
        for tile in tiles(self.network, size, sides, self.simulated.tile_size):
            parts = self.simulated.tensors(self.estimate(which, tile))
            made = made or [part.new_zeros(*part.shape[:-2], *size, dtype=torch.float32) for part in parts]
            for picture, part in zip(made, parts, strict=True):
                picture[(..., *tile.place)] = part.float()
        return self.simulated.estimate_of(*made)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """See `System`: over the captures that are held out."""
        self.eval()
        rows = [
            self.simulated.merit(self.whole(which), self._moved(self.captures.truth(which)))
            for which in self.captures.held_out
        ]
        self.train()
        return self.simulated.means([rows]) if rows else {}

    def figures(self) -> dict[str, float]:
        return self.simulated.figures()

    def _tile(self, place: Sequence[slice]) -> Tile:
        return Tile.of(self.network, (place[0], place[1]), self.camera.size, self.simulated.tile_size)

    def _moved(self, values: Tensor) -> Tensor:
        return values.to(self.camera.response.device)

    def _seen(self, which: int) -> Seen:
        """A whole capture."""
        values, optics = self._moved(self.captures.values[which]), self.simulated.optics()
        return Seen(values, optics, self.captures.sensors[which])

    @torch.no_grad()
    def _start(self, which: int) -> Tensor | None:
        """(B, L, H, W) first estimate of a whole capture."""
        if self.network.start == "snapshot":
            return None

        def compute() -> Tensor:
            first = self.simulated.first(self._seen(which))
            assert first is not None
            return first

        return self.captures.start(which, compute)
