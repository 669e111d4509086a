"""A trained network over whole frames, by tiles that bound its memory and leave no seam."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass
from itertools import product
from math import lcm
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.batches import part_of
from tmca.decoders.certainty import change
from tmca.decoders.decoder import Progress, Raw
from tmca.decoders.likelihood import DepthRaw
from tmca.decoders.nets.network import TILE, Network
from tmca.decoders.nets.starts import PatchStart, Starts, prepared_start
from tmca.decoders.nets.two_headed import DepthEstimate, TwoHeadedUNet, check_sizes, first_likelihood, first_stage
from tmca.errors import SettingError, check_range
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Noise

_STARTED = {"collapsed": 0.9, "likelihood": 0.8}
"""Share of the time that a first estimate takes, as a rule."""
Part = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class Tile:
    """A part of a frame, what a network looks at to make it, and where the tile lies in that."""

    place: Part
    seen: Part
    inner: Part

    @classmethod
    def of(cls, network: Any, place: Part, size: tuple[int, int], period: int = 1) -> Tile:
        """What a tile of a frame (H, W) needs of a network's ``reach``; it begins at a multiple of the network's
        ``multiple`` and of the ``period`` of the codes."""
        margin, step = -(-network.reach // network.multiple) * network.multiple, lcm(network.multiple, period)
        starts = [max(0, (part.start - margin) // step * step) for part in place]
        top, left = (
            slice(start, min(length, part.stop + margin))
            for start, part, length in zip(starts, place, size, strict=True)
        )
        inner = [slice(part.start - start, part.stop - start) for start, part in zip(starts, place, strict=True)]
        return cls(place, (top, left), (inner[0], inner[1]))


def tiles(network: Any, size: tuple[int, int], sides: tuple[int, int], period: int = 1) -> list[Tile]:
    """Tiles of at most so many rows and columns that make up a frame (H, W), row by row."""
    corners = product(*(range(0, length, side) for length, side in zip(size, sides, strict=True)))
    return [
        Tile.of(network, (slice(y, min(y + sides[0], size[0])), slice(x, min(x + sides[1], size[1]))), size, period)
        for y, x in corners
    ]


def over_tiles(
    parts: list[Tile], size: tuple[int, int], made: Callable[[Tile], Iterable[Tensor]], report: Callable[[float], None]
) -> list[Tensor]:
    """Frames (…, H, W) of what is made of the windows (…, rows, columns) that tiles look at."""
    whole: list[Tensor] = []
    for done, tile in enumerate(parts, start=1):
        windows = [*made(tile)]
        whole = whole or [window.new_empty(*window.shape[:-2], *size) for window in windows]
        for values, window in zip(whole, windows, strict=True):
            values[(..., *tile.place)] = window[(..., *tile.inner)]
        report(done / len(parts))
    return whole


class CollapsedNetwork:
    """A network behind a collapsed camera: ``run(snapshot) -> Raw`` of the scene and its deviation; any height and
    width. The deviation is the one that the network predicts; else, if asked for, what it changed around every pixel.

    Args:
        network: trained.
        operator: of the camera.
        noise: of its sensor.
        prior: of the first estimate; None where it needs none.
        tile: rows of the scene that pass the network at once, no more than its own ``tile``, and as many columns where
            the optics mix no columns; None for all. The estimate is the same to rounding.
        starts: makes what makes first estimates of an operator's snapshots; None for the network's own.
        changes: return what was changed where the network predicts no deviation.

    Raises:
        SettingError: tiles of less than one row, or no prior for a network that needs one.
    """

    def __init__(
        self,
        network: Network,
        operator: TapOperator,
        noise: Noise,
        prior: GaussianPrior | GaussianMixturePrior | None = None,
        tile: int | None = TILE,
        starts: Starts | None = None,
        changes: bool = False,
    ) -> None:
        check_range("tile", 1 if tile is None else tile, 1)
        self.network, self.operator, self.noise, self.changes = network, operator, noise, changes
        self.starts = starts or (lambda behind: prepared_start(network.start, behind, noise, prior))
        self.start = self.starts(operator)
        _, height, width = operator.scene_shape
        self.size, side = (height, width), max(height, width) if tile is None else min(tile, network.tile)
        across = side if keeps_columns(operator) else width
        self.tiles = tiles(network, self.size, (side, across))

    def with_network(self, network: Network) -> CollapsedNetwork:
        """The same with another network of its kind."""
        other = copy(self)
        other.network = network
        return other

    def precompute(self) -> None:
        """Compute what first estimates of many snapshots have in common."""
        if isinstance(self.start, PatchStart):
            self.start.estimator.precompute(deviation=False)

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None) -> Raw:
        """Decode snapshots (B, 1, H, W'); ``progress`` is called with the share that is done."""
        begun = _STARTED["collapsed"]
        start = self.start(snapshot, part_of(progress, 0, begun))

        def made(tile: Tile) -> Iterable[Tensor]:
            alone = zip(snapshot.split(1), start.split(1), strict=True)  # a batch would take as many times the memory
            parts = (self._window(one, first[(..., *tile.seen)], tile) for one, first in alone)
            return map(torch.cat, zip(*parts, strict=True))

        values, *deviation = over_tiles(self.tiles, self.size, made, part_of(progress, begun, 1))
        if self.changes and not deviation:
            return Raw(values, change(values, start.reshape(values.shape)))
        return Raw(values, deviation[0] if deviation else None)

    def _window(self, snapshot: Tensor, start: Tensor, tile: Tile) -> tuple[Tensor, ...]:
        light, part = window_of(self.operator, snapshot, tile)
        return self.network.outputs(light, part, self.noise, start)


def window_of(operator: TapOperator, snapshot: Tensor, tile: Tile) -> tuple[Tensor, TapOperator]:
    """The part of a snapshot that a tile's network looks at, and the operator that took it."""
    (rows, columns), taps = tile.seen, operator.taps
    part = TapOperator(taps.window(rows.start, columns.start, rows.stop - rows.start, columns.stop - columns.start))
    return snapshot[:, :, rows, columns.start : columns.start + part.snapshot_shape[2]], part


def keeps_columns(operator: TapOperator) -> bool:
    """Whether the light of every scene column falls on the sensor column of its own."""
    taps = operator.taps
    return not any(taps.offsets) and taps.snapshot_width == taps.scene_shape[2]


class TwoHeadedNetwork:
    """A two-headed network with its first stage: ``run(snapshot) -> DepthRaw``, any height and width.

    Args:
        network: trained.
        camera: that took the snapshots; it says their size, codes and noise.
        prior: of the first stage; None where the network needs none.
        tile: side in pixels of what passes the network at once; the estimate is the same to rounding.

    Raises:
        SettingError: a network of other sizes than the camera's, no prior for a network that needs one, or tiles of
            less than a pixel.
    """

    def __init__(
        self, network: TwoHeadedUNet, camera: SpectralDepthCamera, prior: GaussianPrior | None = None, tile: int = TILE
    ) -> None:
        check_range("tile", tile, 1)
        if network.start == "likelihood" and prior is None:
            raise SettingError("prior", "none", "one for a network that starts from the likelihood")
        check_sizes(network, camera)
        self.network, self.camera, self.tile = network.eval(), camera, tile
        wanted = prior if network.start == "likelihood" else None
        self.likelihood = None if wanted is None else first_likelihood(network, wanted, camera)

    def precompute(self) -> None:
        """Compute what first estimates of many snapshots have in common."""
        if self.likelihood is not None:
            self.likelihood.precompute()

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None) -> DepthRaw:
        """Decode snapshots (B, C, H, W); ``progress`` is called with the share that is done."""
        start, begun = None, 0.0
        if self.likelihood is not None:
            begun = _STARTED["likelihood"]
            start = first_stage(self.likelihood, snapshot, part_of(progress, 0, begun))

        def made(tile: Tile) -> tuple[Tensor, Tensor]:
            seen = (..., *tile.seen)
            first = None if start is None else start[seen]
            estimate = self.network(snapshot[seen], self.camera, self.camera.noise, first)
            return estimate.cube, estimate.logits

        size = (int(snapshot.shape[-2]), int(snapshot.shape[-1]))
        # the network lays the tile of codes from the window's first pixel on
        parts = tiles(self.network, size, (self.tile, self.tile), self.camera.tile_size)
        cube, logits = over_tiles(parts, size, made, part_of(progress, begun, 1))
        return DepthEstimate(cube, logits).decoded(self.camera.planes)
