"""A spectral-depth camera and a two-headed network that learn together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from tmca.cameras import SpectralDepthCamera
from tmca.decoders import PatchLikelihood
from tmca.decoders.nets.two_headed import DepthEstimate, TwoHeadedUNet, first_likelihood, first_stage
from tmca.errors import SettingError
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor
from tmca.training.faults import DrawnFaults
from tmca.training.imaging import torch_seed
from tmca.training.losses import LOSSES, psnr_of
from tmca.training.patches import Patch
from tmca.training.spectral_depth.windows import DepthWindows

_NOISE, _CHECK, _FAULTS = 2, 3, 4
"""Streams of random numbers: the sensor's noise in training, in validation."""
SURPRISE = 0.1
"""What a nat counts beside the error of depth, as a share of the range."""


class DepthSystem(nn.Module):
    """A camera whose mask, shutter and filters may learn, and the network behind it (thesis 5.2).

    The loss is that of the cube plus ``depth_weight`` times what depth costs where it is known: the mean absolute error
    of inverse depth, as a share of the range, and ``SURPRISE`` times the cross entropy of its planes, without which
    networks got stuck at one plane. What lies in the margin sends its light into the patch, but is not decoded and does
    not count. The codes' gradient passes through the snapshot; a physics-based first stage is taken as it is. While
    codes learn, ``likelihood_weight`` times what depth costs the patch likelihood is added in some steps: codes need a
    decoder that sees depth from the first step on, which a network is not.

    Args:
        camera: of the size of patches and margin.
        network: decoder.
        sensors: one of them, in turn, in each step.
        prior: of the first stage, and of the patch likelihood that codes learn from.
        validation: scenes (L + 1, H, W) of the camera's size.
        margin: pixels around every patch, whole tiles.
        loss: of the cube, name in ``LOSSES``.
        depth_weight: of the depth error.
        likelihood_weight: of that of the patch likelihood.
        likelihood_every: steps from one of these errors to the next, which counts as often.
        faults: of the bench, drawn in every step and for every validation scene; the decoder is not told.
        seed: of noise and faults.

    Raises:
        SettingError: no prior for a network that wants a first stage, or for codes that learn from the likelihood.
    """

    def __init__(
        self,
        camera: SpectralDepthCamera,
        network: TwoHeadedUNet,
        sensors: Sequence[Sensor],
        prior: GaussianPrior | None,
        validation: Sequence[Tensor],
        *,
        margin: int = 0,
        loss: str = "l1",
        depth_weight: float = 0.1,
        likelihood_weight: float = 0.0,
        likelihood_every: int = 1,
        faults: DrawnFaults | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.windows = DepthWindows(prior) if prior is not None and camera.learnable and likelihood_weight else None
        if prior is None and (network.start == "likelihood" or (camera.learnable and likelihood_weight)):
            raise SettingError("prior", "none", "one for a network, or for codes, that start from the likelihood")
        self.camera, self.network = camera, network
        self.sensors, self.prior, self.validation = tuple(sensors), prior, tuple(validation)
        self.loss, self.depth_weight, self.seed = LOSSES[loss], depth_weight, seed
        self.likelihood_weight, self.likelihood_every = likelihood_weight, likelihood_every
        self.margin, self.frozen, self.faults = margin, not camera.learnable, faults or DrawnFaults()
        self.faults.check(camera)
        self._likelihood: PatchLikelihood | None = None
        self._checked: dict[tuple[int, int], Tensor] = {}

    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """Mean loss of a batch; ``start`` holds its first stage where it is known."""
        scenes = torch.stack([patch.scene for patch in patches]).to(self.camera.response.device)
        snapshot = self._recorded(scenes, step, indexes)
        loss = self._loss(self._decode(snapshot, self._sensor(step), start), scenes)
        if self.windows is None or self.frozen or step % self.likelihood_every:
            return loss
        return loss + self.likelihood_every * self._unlikely(snapshot, scenes, self._sensor(step))

    @torch.no_grad()
    def start(self, patches: Sequence[Patch], step: int, indexes: Sequence[int]) -> Tensor:
        """(B, L + D, h, w) first stage of a batch of patches."""
        scenes = torch.stack([patch.scene for patch in patches]).to(self.camera.response.device)
        return self._first(self._recorded(scenes, step, indexes), self._sensor(step))

    def groups(self) -> dict[str, list[nn.Parameter]]:
        """Parameters of the decoder, of the masks, and of shutter and filters."""
        parts: dict[str, tuple[nn.Module, ...]] = {"decoder": (self.network,), "masks": (self.camera.point_spread,)}
        parts |= {"codes": (self.camera.shutter, self.camera.filters)}
        return {name: [p for part in own for p in part.parameters() if p.requires_grad] for name, own in parts.items()}

    def anneal(self, slope: float) -> None:
        """Set the slope of the codes' surrogate derivative; filters are mixtures while they learn."""
        self.camera.shutter.slope = self.camera.filters.plane.slope = slope
        self.camera.filters.relax(self.camera.filters.learnable and not self.frozen)

    def hold(self) -> None:
        """Nothing is held."""

    def figures(self) -> dict[str, float]:
        """Light throughput."""
        return {"throughput": self.camera.throughput()}

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean PSNR of cubes, mean absolute error of depth in metres; the negative loss is the score."""
        self.eval()
        relaxed = self.camera.filters.plane.relaxed
        self.camera.filters.relax(False)
        rows = [
            self._check(place, index) for place in range(len(self.sensors)) for index in range(len(self.validation))
        ]
        self.camera.filters.relax(relaxed)
        self.train()
        return {name: float(np.nanmean([row[name] for row in rows])) for name in (rows[0] if rows else {})}

    def _check(self, place: int, index: int) -> dict[str, float]:
        scene, sensor = self.validation[index][None].to(self.camera.response.device), self.sensors[place]
        bench = self.faults.bench(self.camera, sensor, (self.seed, _CHECK, _FAULTS, place, index))
        snapshot = self._exposed(scene, *bench, [(self.seed, _CHECK, place, index)])
        found = self._decode(snapshot, sensor, self._first_of((place, index), snapshot, sensor))
        planes, cube = self.camera.planes, found.cube.float().clamp_min(0)
        error = (found.decoded(planes).depth - self._metres(self._inner(scene[:, -1:]))).abs()
        loss = float(self._loss(found, scene) + self._unlikely(snapshot, scene, sensor))
        return {
            "psnr": psnr_of(float((cube - self._inner(scene[:, :-1])).square().mean())),
            "depth_mae": float(error.nanmean()),
            "score": -loss,
        }

    def _inner(self, values: Tensor) -> Tensor:
        """(…, h, w) without the margin."""
        own = [slice(self.margin, side - self.margin) for side in values.shape[-2:]]
        return values[..., own[0], own[1]]

    def _loss(self, found: DepthEstimate, scenes: Tensor) -> Tensor:
        scenes = self._inner(scenes)
        return self.loss(found.cube.float(), scenes[:, :-1]) + self.depth_weight * _away(found, scenes[:, -1:])

    def _unlikely(self, snapshot: Tensor, scenes: Tensor, sensor: Sensor) -> Tensor:
        """What depth costs the patch likelihood that codes learn from."""
        if self.windows is None:
            return snapshot.new_zeros(())
        self.camera.sensor = sensor
        with torch.autocast(snapshot.device.type, enabled=False):
            found, place = self.windows(self.camera, self._inner(snapshot), self._inner(scenes[:, -1:]))
        return self.likelihood_weight * _known_mean(found.expected_error, place)

    def _decode(self, snapshot: Tensor, sensor: Sensor, start: Tensor | None) -> DepthEstimate:
        if start is None and self.network.start == "likelihood":
            start = self._first(snapshot, sensor)
        noise, seen = sensor.noise(self.camera.white, self.camera.exposures), self._inner(snapshot)
        found: DepthEstimate = self.network(seen, self.camera, noise, None if start is None else start.to(snapshot))
        return found

    def _first(self, snapshot: Tensor, sensor: Sensor) -> Tensor:
        """What the exact model makes of snapshots; its covariances are kept while the codes stay as they are."""
        assert self.prior is not None
        self.camera.sensor = sensor
        likelihood = self._likelihood
        if likelihood is None or likelihood.device != snapshot.device:
            likelihood = first_likelihood(self.network, self.prior, self.camera)
        self._likelihood = likelihood if self.frozen else None
        with torch.autocast(snapshot.device.type, enabled=False):
            return self._inner(first_stage(likelihood, snapshot))

    def _first_of(self, check: tuple[int, int], snapshot: Tensor, sensor: Sensor) -> Tensor | None:
        """First stage of a validation scene, computed once where the codes stay as they are."""
        if self.network.start != "likelihood":
            return None
        if check in self._checked:
            return self._checked[check]
        found = self._first(snapshot, sensor)
        if self.frozen:
            self._checked[check] = found
        return found

    def _recorded(self, scenes: Tensor, step: int, indexes: Sequence[int]) -> Tensor:
        bench = self.faults.bench(self.camera, self._sensor(step), (self.seed, _FAULTS, step))
        return self._exposed(scenes, *bench, [(self.seed, _NOISE, step, index) for index in indexes])

    def _exposed(
        self, scenes: Tensor, bench: SpectralDepthCamera, sensor: Sensor, seeds: Sequence[tuple[int, ...]]
    ) -> Tensor:
        """Snapshots whose noise depends on each patch's own seed, not on who else is in the batch."""
        with torch.autocast(scenes.device.type, enabled=False):
            exact = bench.exact(scenes[:, :-1], self._metres(scenes[:, -1:]))
            white, exposures = self.camera.white, self.camera.exposures
            rows = [
                sensor(exact[i : i + 1], white, torch_seed(seed, exact.device), exposures)
                for i, seed in enumerate(seeds)
            ]
        return torch.cat(rows)

    def _sensor(self, step: int) -> Sensor:
        return self.sensors[step % len(self.sensors)]

    def _metres(self, place: Tensor) -> Tensor:
        return self.camera.planes.depth_of(place)


def _away(found: DepthEstimate, place: Tensor) -> Tensor:
    """What depth costs, mean over where it is known."""
    return _known_mean(lambda true: (found.place() - true).abs() + SURPRISE * found.surprise(true), place)


def _known_mean(error: Callable[[Tensor], Tensor], place: Tensor) -> Tensor:
    """Mean of an error of places (B, 1, H, W) over where they are known."""
    known = torch.isfinite(place)
    return (error(place.nan_to_num()) * known).sum() / known.sum().clamp_min(1)
