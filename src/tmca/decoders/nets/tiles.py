"""A trained network over whole frames: what it starts from, and tiles that bound its memory and leave no seam."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass
from itertools import product
from math import lcm
from typing import Any

import torch
from torch import Tensor

from tmca.arguments import described
from tmca.cameras import SpectralDepthCamera
from tmca.decoders.batches import part_of
from tmca.decoders.decoder import Progress, Raw
from tmca.decoders.least_squares import tikhonov
from tmca.decoders.likelihood import DepthRaw
from tmca.decoders.lmmse import PatchEstimator
from tmca.decoders.nets.network import NEED_PRIOR, STARTS, TILE, Network
from tmca.decoders.nets.two_headed import DepthEstimate, TwoHeadedUNet, check_sizes, first_likelihood, first_stage
from tmca.errors import SettingError, check_choice, check_range
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Noise

_STARTED = {"collapsed": 0.9, "likelihood": 0.8}
"""Share of the time that a first estimate takes, as a rule."""
_LEAST_READ_NOISE = 5e-4
"""Snapshot units: float32 is enough above it, and networks have no use for more."""
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


@dataclass(frozen=True)
class PatchStart:
    """First estimates (B, L, H, W) by the patch LMMSE or mixture."""

    estimator: PatchEstimator

    def __call__(self, snapshot: Tensor, progress: Progress | None) -> Tensor:
        return self.estimator(snapshot, progress=progress).estimate.to(snapshot.dtype)


def prepared_start(
    kind: str,
    operator: TapOperator,
    noise: Noise,
    prior: GaussianPrior | GaussianMixturePrior | None = None,
    *,
    differentiable: bool = False,
) -> Callable[[Tensor, Progress | None], Tensor]:
    """What makes first estimates (B, L, H, W) of snapshots (B, 1, H, W') of one camera.

    Args:
        kind: ``"adjoint"`` (Φᵀy, the thesis' start), ``"dagger"`` (least-norm scene), ``"tikhonov"`` (least squares
            with a smooth scene), ``"lmmse"`` or ``"mixture"``.
        operator: that took the snapshots.
        noise: of the sensor.
        prior: for the LMMSE, or of the mixture.
        differentiable: let gradients reach code and snapshot through Tikhonov's or the LMMSE too.

    Raises:
        SettingError: unknown kind, no prior, or one of the other kind.
    """

    def smooth(snapshot: Tensor, progress: Progress | None) -> Tensor:
        with torch.set_grad_enabled(differentiable and torch.is_grad_enabled()):
            return tikhonov(operator, snapshot, progress=progress)

    check_choice("start", kind, STARTS)
    if kind not in NEED_PRIOR:
        adjoint, dagger = operator.A_adjoint, operator.A_dagger
        return {"adjoint": lambda y, _: adjoint(y), "dagger": lambda y, _: dagger(y), "tikhonov": smooth}[kind]
    if not isinstance(prior, GaussianPrior if kind == "lmmse" else GaussianMixturePrior):
        found = "none" if prior is None else described(prior)
        raise SettingError("prior", found, f"one for a network that starts from {kind}")
    quiet = Noise(max(noise.read, _LEAST_READ_NOISE), noise.shot)
    return PatchStart(PatchEstimator(prior, operator.taps, quiet, dtype=torch.float32, differentiable=differentiable))


def first_estimate(
    kind: str,
    snapshot: Tensor,
    operator: TapOperator,
    noise: Noise,
    prior: GaussianPrior | GaussianMixturePrior | None = None,
    *,
    differentiable: bool = False,
) -> Tensor:
    """(B, 1, H, W') → (B, L, H, W); arguments and errors as in `prepared_start`."""
    return prepared_start(kind, operator, noise, prior, differentiable=differentiable)(snapshot, None)


class CollapsedNetwork:
    """A network behind a collapsed camera: ``run(snapshot) -> Raw`` of the scene and, of a network that predicts it,
    its standard deviation; any height and width.

    Args:
        network: trained.
        operator: of the camera.
        noise: of its sensor.
        prior: of the first estimate; None where it needs none.
        tile: rows of the scene that pass the network at once, no more than its own ``tile``, and as many columns where
            the optics mix no columns; None for all. The estimate is the same to rounding.

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
    ) -> None:
        check_range("tile", 1 if tile is None else tile, 1)
        self.network, self.operator, self.noise = network, operator, noise
        self.start = prepared_start(network.start, operator, noise, prior)
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
