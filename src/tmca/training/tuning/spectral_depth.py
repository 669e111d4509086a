"""A trained two-headed network that learns on, from captures instead of simulated snapshots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.nets.network import TILE
from tmca.decoders.nets.tiles import Tile
from tmca.decoders.nets.two_headed import DepthEstimate, TwoHeadedUNet
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor
from tmca.training.losses import psnr_of
from tmca.training.patches import Patch
from tmca.training.spectral_depth.system import DepthSystem
from tmca.training.tuning.captured import KeptCaptures, Window, Windows


class TunedDepth(DepthSystem):
    """A two-headed network that learns from windows of captures (thesis 5.3); masks, shutter and filters stay.

    The loss is that of ``DepthSystem``, of cube and depth where it is known. A window passes the network with all
    around it that it sees, so that its loss is that of the same pixels of the whole estimate.

    Args:
        camera: that took the captures, as it is known.
        network: trained.
        prior: of the first stage, for networks that have one.
        captures: with their truth; the first of them are learned from.
        windows: that are drawn from these.
        loss: of the cube, name in ``LOSSES``.
        depth_weight: of the depth error.

    Raises:
        SettingError: no prior for a network that needs one.
    """

    def __init__(
        self,
        camera: SpectralDepthCamera,
        network: TwoHeadedUNet,
        prior: GaussianPrior | None,
        captures: KeptCaptures,
        windows: Windows,
        *,
        loss: str = "l1",
        depth_weight: float = 0.1,
    ) -> None:
        super().__init__(
            camera, network, (camera.sensor,), prior, (), loss=loss, depth_weight=depth_weight, seed=windows.seed
        )
        self.captures, self.drawn, self.frozen = captures, windows, True

    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """Mean loss of a batch: ``patches`` hold the truth of its windows; ``start`` is not used."""
        device = self.camera.response.device
        losses = [
            self._loss(self.estimate(self.drawn(step, index)), patch.truth.to(device))
            for patch, index in zip(patches, indexes, strict=True)
        ]
        return torch.stack(losses).mean()

    def estimate(self, window: Window) -> DepthEstimate:
        """Cube and planes of a window of a capture."""
        tile = Tile.of(self.network, window.place[1:], self.camera.size, self.camera.tile_size)
        seen, inner = (..., *tile.seen), (..., *tile.inner)
        light = self.captures.values[window.which].to(self.camera.response.device)
        start = None
        if self.network.start == "likelihood":
            start = self.captures.start(window.which, self._made)[seen].to(light)
        sensor = self.captures.sensors[window.which]
        noise = sensor.noise(self.camera.white, self.camera.exposures)
        found: DepthEstimate = self.network(light[seen], self.camera, noise, start)
        return DepthEstimate(found.cube[inner], found.logits[inner])

    @torch.no_grad()
    def _made(self, values: Tensor, sensor: Sensor) -> Tensor:
        return self._first(values.to(self.camera.response.device), sensor)

    @torch.no_grad()
    def whole(self, which: int) -> DepthEstimate:
        """Cube and planes of a whole capture."""
        height, width = self.camera.size
        values = self.captures.values[which].to(self.camera.response.device)
        cube = values.new_zeros(len(values), self.network.bands, height, width)
        logits = values.new_zeros(len(values), self.network.planes, height, width)
        for window in self.drawn.covering(which, TILE):
            found = self.estimate(window)
            cube[window.place], logits[window.place] = found.cube.float(), found.logits.float()
        return DepthEstimate(cube, logits)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean PSNR of cubes, mean absolute error of depth in metres; the negative loss is the score."""
        self.eval()
        rows = [self._judged(which) for which in self.captures.held_out]
        self.train()
        return {name: float(np.nanmean([row[name] for row in rows])) for name in (rows[0] if rows else {})}

    def _judged(self, which: int) -> dict[str, float]:
        truth = self.captures.truth(Window(which, 0, self.camera.size[0], 0, self.camera.size[1]))
        truth, found = truth.to(self.camera.response.device), self.whole(which)
        error = (found.decoded(self.camera.planes).depth - self._metres(truth[:, -1:])).abs()
        return {
            "psnr": psnr_of(float((found.cube.clamp_min(0) - truth[:, :-1]).square().mean())),
            "depth_mae": float(error.nanmean()),
            "score": -float(self._loss(found, truth)),
        }
