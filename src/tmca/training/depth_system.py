"""A spectral-depth camera and a two-headed network that learn together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras import SpectralDepthCamera
from tmca.decoders import PatchLikelihood
from tmca.decoders.nets.tiles import Tile
from tmca.decoders.nets.two_headed import DepthEstimate, first_likelihood, first_stage
from tmca.errors import SettingError
from tmca.training.depth_windows import DepthWindows
from tmca.training.losses import psnr_of
from tmca.training.system import Seen, TrainingSystem, Window

SURPRISE = 0.1
"""What a nat counts beside the error of depth, as a share of the range."""


class DepthSystem(TrainingSystem):
    """A camera whose mask, shutter and filters may learn, and the network behind it (thesis 5.2).

    Scenes are (L + 1, h, w), the last channel inverse depth as a share of the range, NaN where it is unknown. The loss
    is that of the cube plus ``depth_weight`` times what depth costs where it is known: the mean absolute error of
    inverse depth and ``SURPRISE`` times the cross entropy of its planes, without which networks got stuck at one plane.
    The margin sends its light into the patch, but is not decoded. The codes' gradient passes through the snapshot
    alone. While codes learn, ``likelihood_weight`` times what depth costs the patch likelihood is added in some steps:
    codes need a decoder that sees depth from the first step on, which a network is not.

    Args:
        given: camera of the size of patches and margin, network, sensors, prior (of the first estimate, and of the
            patch likelihood that codes learn from) and validation scenes, as of `TrainingSystem`.
        margin: pixels around every patch, whole tiles.
        depth_weight: of the depth error.
        likelihood_weight: of that of the patch likelihood.
        likelihood_every: steps from one of these errors to the next, which counts as often.
        how: ``loss`` (of the cube), ``faults`` and ``seed`` of `TrainingSystem`.

    Raises:
        SettingError: see `TrainingSystem`; no prior for codes that learn from the likelihood.
    """

    def __init__(
        self,
        *given: Any,
        margin: int = 0,
        depth_weight: float = 0.1,
        likelihood_weight: float = 0.0,
        likelihood_every: int = 1,
        **how: Any,
    ) -> None:
        super().__init__(*given, **how)
        by_likelihood = bool(self.camera.learnable and likelihood_weight)
        if by_likelihood and self.prior is None:
            raise SettingError("prior", "none", "one for codes that learn from the likelihood")
        self.tile_size = self.camera.tile_size
        self.windows = DepthWindows(self.prior) if by_likelihood else None
        self.margin, self.depth_weight = margin, depth_weight
        self.likelihood_weight, self.likelihood_every = likelihood_weight, likelihood_every
        self._likelihood: PatchLikelihood | None = None

    def optics(self, window: Window | None = None) -> SpectralDepthCamera:
        """See `TrainingSystem`; patches are of the camera's size."""
        camera: SpectralDepthCamera = self.camera
        return camera

    def image(self, scenes: Tensor, window: Window, bench: Any, optics: Any) -> Tensor:
        return bench.exact(scenes[:, :-1], self._metres(scenes[:, -1:]))

    def inner(self, values: Tensor) -> Tensor:
        """(…, h, w) without the margin."""
        rows, columns = (slice(self.margin, side - self.margin) for side in values.shape[-2:])
        return values[..., rows, columns]

    def first(self, seen: Seen) -> Tensor | None:
        """See `TrainingSystem`: (B, L + D, h, w); covariances are cached while the codes stay as they are."""
        if self.network.start != "likelihood":
            return None
        self.camera.sensor = seen.sensor
        likelihood = self._likelihood
        if likelihood is None or likelihood.device != seen.snapshot.device:
            likelihood = first_likelihood(self.network, self.prior, self.camera)
        self._likelihood = likelihood if self.frozen else None
        with torch.autocast(seen.snapshot.device.type, enabled=False):
            return self.inner(first_stage(likelihood, seen.snapshot))

    def cut(self, seen: Seen, tile: Tile) -> Seen:
        return seen._replace(snapshot=seen.snapshot[(..., *tile.seen)])

    def cost(self, estimate: DepthEstimate, truth: Tensor) -> Tensor:
        """See `TrainingSystem`: of the cube, and of depth where it is known."""
        truth = self.inner(truth)
        depth = _valid_mean(lambda true: _depth_cost(estimate, true), truth[:, -1:])
        return self.loss(estimate.cube.float(), truth[:, :-1]) + self.depth_weight * depth

    def cost_of_codes(self, seen: Seen, truth: Tensor, step: int) -> Tensor | float:
        """See `TrainingSystem`: what depth costs the patch likelihood, in every ``likelihood_every``-th step."""
        if self.frozen or step % self.likelihood_every:
            return 0.0
        return self.likelihood_every * self._likelihood_cost(seen, truth)

    def merit(self, estimate: DepthEstimate, truth: Tensor, seen: Seen | None = None) -> dict[str, float]:
        """See `TrainingSystem`: PSNR of the cube, mean absolute error of depth in metres, the negative loss."""
        inner, cube = self.inner(truth), estimate.cube.float().clamp_min(0)
        error = (estimate.decoded(self.camera.planes).depth - self._metres(inner[:, -1:])).abs()
        loss = self.cost(estimate, truth) + (0.0 if seen is None else self._likelihood_cost(seen, truth))
        return {
            "psnr": psnr_of(float((cube - inner[:, :-1]).square().mean())),
            "depth_mae": float(error.nanmean()),
            "score": -float(loss),
        }

    def tensors(self, estimate: DepthEstimate) -> tuple[Tensor, ...]:
        return estimate.cube, estimate.logits

    def estimate_of(self, *tensors: Tensor) -> DepthEstimate:
        return DepthEstimate(*tensors)

    def groups(self) -> dict[str, list[nn.Parameter]]:
        """See `TrainingSystem`: the decoder, the masks, and shutter and filters."""
        camera = self.camera
        parts: dict[str, tuple[nn.Module, ...]] = {"decoder": (self.network,), "masks": (camera.point_spread,)}
        parts |= {"codes": (camera.shutter, camera.filters)}
        return {
            name: [p for part in modules for p in part.parameters() if p.requires_grad]
            for name, modules in parts.items()
        }

    def anneal(self, slope: float) -> None:
        """See `TrainingSystem`; filters are mixtures while they learn."""
        filters = self.camera.filters
        self.camera.shutter.slope = filters.plane.slope = slope
        filters.relax(filters.learnable and not self.frozen)

    def validate(self) -> dict[str, float]:
        """See `TrainingSystem`; filters are those that are made, and mixtures again from the next step on."""
        self.camera.filters.relax(False)
        return super().validate()

    def _likelihood_cost(self, seen: Seen, truth: Tensor) -> Tensor | float:
        """What depth costs the patch likelihood that codes learn from."""
        if self.windows is None:
            return 0.0
        self.camera.sensor = seen.sensor
        with torch.autocast(seen.snapshot.device.type, enabled=False):
            estimate, place = self.windows(self.camera, self.inner(seen.snapshot), self.inner(truth[:, -1:]))
        return self.likelihood_weight * _valid_mean(estimate.expected_error, place)

    def _metres(self, place: Tensor) -> Tensor:
        metres: Tensor = self.camera.planes.depth_of(place)
        return metres


def _depth_cost(estimate: DepthEstimate, place: Tensor) -> Tensor:
    """(B, 1, H, W) what the depth of an estimate costs where the true places are these."""
    return (estimate.place() - place).abs() + SURPRISE * estimate.surprise(place)


def _valid_mean(error: Callable[[Tensor], Tensor], place: Tensor) -> Tensor:
    """Mean of an error of places (B, 1, H, W) over where they are known."""
    valid = torch.isfinite(place)
    return (error(place.nan_to_num()) * valid).sum() / valid.sum().clamp_min(1)
