"""A trained network behind a collapsed camera that learns on, from captures instead of simulated snapshots."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.decoders import Network
from tmca.decoders.nets.tiles import Tile, window_of
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Sensor
from tmca.training.imaging import ImagingSystem
from tmca.training.losses import psnr_of
from tmca.training.patches import Patch
from tmca.training.tuning.captured import KeptCaptures, Window, Windows


class TunedImaging(ImagingSystem):
    """A network that learns from windows of captures (thesis 5.3); camera and codes stay as they are.

    The first estimate is made of the whole capture, and a window passes the network with all around it that it sees, so
    that the loss of a window is that of the same pixels of the whole estimate.

    Args:
        camera: that took the captures, as it is known.
        network: trained.
        prior: for networks that start from the patch LMMSE.
        captures: with their truth; the first of them are learned from.
        windows: that are drawn from these.
        loss: name in ``LOSSES``.

    Raises:
        SettingError: optics that keep the slots apart, or no prior for a network that needs one.
    """

    def __init__(
        self,
        camera: CodedCamera,
        network: Network,
        prior: GaussianPrior | GaussianMixturePrior | None,
        captures: KeptCaptures,
        windows: Windows,
        *,
        loss: str = "l2",
    ) -> None:
        super().__init__(camera, network, (camera.sensor,), prior, (), loss=loss, seed=windows.seed)
        self.captures, self.windows, self.frozen = captures, windows, True

    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """Mean loss of a batch: ``patches`` hold the truth of its windows; ``start`` is not used."""
        losses = [
            self.loss(self.estimate(self.windows(step, index)).float(), patch.truth.to(self.camera.response.device))
            for patch, index in zip(patches, indexes, strict=True)
        ]
        return torch.stack(losses).mean()

    def estimate(self, window: Window) -> Tensor:
        """(B, L, h, w) of a window of a capture."""
        tile = Tile.of(self.network, window.place[1:], self.camera.size)
        light = self.captures.values[window.which].to(self.camera.response.device)
        light, part = window_of(TapOperator(self.camera.taps()), light, tile)
        start = self.captures.start(window.which, self._made)[(..., *tile.seen)].to(light)
        noise = self._noise(self.captures.sensors[window.which])
        return self.network(light, part, noise, start)[(..., *tile.inner)]

    @torch.no_grad()
    def _made(self, values: Tensor, sensor: Sensor) -> Tensor:
        whole = TapOperator(self.camera.taps())
        return self._first(values.to(self.camera.response.device), whole, self._noise(sensor))

    @torch.no_grad()
    def whole(self, which: int) -> Tensor:
        """(B, L, H, W) estimate of a whole capture, without negative irradiance."""
        values = self.captures.values[which]
        found = values.new_zeros(len(values), self.network.bands, *self.camera.size)
        for window in self.windows.covering(which, self.network.tile):
            found[window.place] = self.estimate(window).float().clamp_min(0).to(found)
        return found

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean PSNR over the captures that are held out."""
        self.eval()
        found = []
        for which in self.captures.held_out:
            truth = self.captures.truth(Window(which, 0, self.camera.size[0], 0, self.camera.size[1]))
            found.append(psnr_of(float((self.whole(which) - truth).square().mean())))
        self.train()
        return {"psnr": float(np.mean(found))} if found else {}
