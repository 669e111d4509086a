"""How probable a snapshot is where the mask lies somewhere else, under a Gaussian prior of blocks of the scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.codes import Codes
from tmca.operators.block_layout import Places, usual_stride
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.priors import GaussianPrior
from tmca.priors.gaussian_posterior import GaussianSolver
from tmca.registration.placement import SmoothPlanes, seen_from
from tmca.sensor import Noise

_ROWS, _COMPLETE = 8, 48
"""Most rows of a block, and columns that see all their light from inside: many small blocks tell where a mask lies
better than few large ones, whose time grows with the square of their measurements."""


class MaskEvidence:
    """Log probability density of blocks of a snapshot, for places of the mask.

    Args:
        camera: a `CodedCamera`, whose mask is moved.
        values: (B, R, H, W') of the snapshot; B are the colours of a light field.
        prior: of blocks of its scenes.
    """

    def __init__(self, camera: Any, values: Tensor, prior: GaussianPrior) -> None:
        self.camera, self.values, taps = camera, values, camera.taps()
        self.aperture, self.shutter = (plane.detach() for plane in camera.codes())
        self.planes, self.size = SmoothPlanes(self.aperture), tuple(self.aperture.shape[-2:])
        _, rows, columns = prior.block
        small = prior.cut(min(rows, _ROWS), min(columns, max(taps.offsets) - min(taps.offsets) + _COMPLETE))
        self.solver = GaussianSolver(small, BlockModel.of(taps, small.block), camera.noise, torch.float32)
        self.grid = BlockGrid.cover(self.solver.model, taps.code.shape[1:], usual_stride(self.solver.model, taps.code))
        self.seen = self.grid.pad_snapshot(values.float())

    def moved(self, vector: Tensor) -> Any:
        """The camera with its mask elsewhere, as `NAMES` say; light apart."""
        return self.camera.replace(codes=Codes(self.planes(*seen_from(vector, self.size), vector[7]), self.shutter))

    def among(self, radius: float, cells: int) -> Places:
        """The brightest block of each of cells × cells parts of the frame's middle; ``radius`` in pixels."""
        sides = self.solver.model.block[1:]
        inside = [
            place for place in self.grid.positions
            if all(0 <= at <= frame - side for at, frame, side in zip(place, self.grid.frame, sides, strict=True))
        ]  # fmt: skip
        light = self.grid.snapshot_windows(self.seen, inside).flatten(1).mean(1).tolist()
        best: dict[tuple[int, ...], tuple[float, tuple[int, int]]] = {}
        for place, one in zip(inside, light, strict=True):
            away = [at + (side - frame) / 2 for at, side, frame in zip(place, sides, self.grid.frame, strict=True)]
            if max(map(abs, away)) <= radius:
                cell = tuple(int((part + radius) * cells / (2 * radius + 1)) for part in away)
                best[cell] = max(best.get(cell, (-math.inf, place)), (one, place))
        return [place for _, place in best.values()]

    def __call__(self, vector: Tensor, blocks: Places, noise: float = 0.0) -> Tensor:
        """(P,) of some blocks; ``noise`` is the least that they are taken to have, which broadens the maximum."""
        self.solver.noise = Noise(max(noise, self.camera.noise.read), self.camera.noise.shot)
        code = self.moved(vector).taps().code * vector[6].exp()
        posterior = self.solver.posterior(self.grid.code_windows(self.grid.pad_code(code), blocks), 0)
        seen = self.grid.snapshot_windows(self.seen, blocks)
        return torch.stack([posterior.log_evidence(at, one) for at, one in enumerate(seen)]).flatten()

    @torch.no_grad()
    def each(self, vector: np.ndarray, blocks: Places, noise: float = 0.0) -> np.ndarray:
        """(P,) of some blocks."""
        return self(torch.as_tensor(vector, dtype=torch.float32), blocks, noise).numpy()

    def value(self, vector: np.ndarray, blocks: Places, noise: float = 0.0) -> float:
        """Of some blocks together."""
        return float(self.each(vector, blocks, noise).sum())

    def slope(self, vector: np.ndarray, blocks: Places, noise: float = 0.0) -> tuple[float, np.ndarray]:
        """The same and its derivatives."""
        place = torch.tensor(vector, dtype=torch.float32, requires_grad=True)
        value = self(place, blocks, noise).sum()
        (slope,) = torch.autograd.grad(value, place)
        return float(value.detach()), slope.double().numpy()
