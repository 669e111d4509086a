"""How probable a snapshot is where the mask lies somewhere else, under a Gaussian prior of blocks of the scene."""

from __future__ import annotations

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
_LIT = 0.1
"""Of the light of the brightest block, that blocks have at least."""


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
        """The brightest block of each of cells × cells parts of the frame's middle; ``radius`` in pixels.

        Dark parts, which say nothing, are left out, and the others divided until there are as many again.
        """
        sides, frame = self.solver.model.block[1:], self.grid.frame
        places, middles = [], []
        for place in self.grid.positions:
            away = [at + (side - whole) / 2 for at, side, whole in zip(place, sides, frame, strict=True)]
            inside = all(0 <= at <= whole - side for at, whole, side in zip(place, frame, sides, strict=True))
            if inside and max(map(abs, away)) <= radius:
                places.append(place)
                middles.append(away)
        if not places:
            return []
        light = self.grid.snapshot_windows(self.seen, places).flatten(1).mean(1).numpy()
        lit, where = light >= _LIT * light.max(), (np.array(middles) + radius) / (2 * radius + 1)
        wanted = len(np.unique((where * cells).astype(int), axis=0))
        chosen = [_brightest(light, where, lit, finer) for finer in range(cells, 3 * cells)]
        best = next((some for some in chosen if len(some) >= wanted), chosen[-1])
        return [places[at] for at in best]

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


def _brightest(light: np.ndarray, where: np.ndarray, lit: np.ndarray, cells: int) -> list[int]:
    """Which of some blocks are the brightest in their cells; ``where`` their middles lie, (N, 2) in [0, 1)."""
    best: dict[tuple[int, ...], int] = {}
    for at in np.flatnonzero(lit):
        cell = tuple((where[at] * cells).astype(int).tolist())
        if cell not in best or light[at] > light[best[cell]]:
            best[cell] = int(at)
    return list(best.values())
