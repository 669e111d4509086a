"""A coded camera as something that can be trained: codes, snapshot, first estimate, network, loss."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera
from tmca.decoders import Network, first_estimate
from tmca.decoders.nets.network import NEED_PRIOR
from tmca.design import hold_throughput, throughput_of
from tmca.errors import SettingError
from tmca.operators import LinearOperator, TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Noise, Sensor
from tmca.training.faults import DrawnFaults
from tmca.training.losses import LOSSES, psnr_of
from tmca.training.patches import Patch
from tmca.training.settings import CodeSettings

_WINDOWS, _NOISE, _CHECK, _FAULTS = 1, 2, 3, 4
"""Streams of random numbers: windows of the code, the sensor's noise in training, in validation, faults."""


class ImagingSystem(nn.Module):
    """A coded camera and a network that learn together (thesis 1.7, 4.2).

    A batch is seen through one window of the codes with one of the sensors; a patch is a scene of its own, dark around.

    Args:
        camera: its codes are learned where they are parameters.
        network: decoder.
        sensors: one of them, in turn, in each step.
        prior: for networks that start from the patch LMMSE.
        validation: scenes (L, H, W), bands or views, no larger than the camera.
        loss: name in ``LOSSES``.
        codes: throughput and how it is held.
        through_start: let the codes' gradient pass through the first estimate as well as through the network.
        faults: of the bench, drawn in every step and for every validation scene; the decoder is not told.
        seed: of windows, noise and faults.
    """

    def __init__(
        self,
        camera: CodedCamera,
        network: Network,
        sensors: Sequence[Sensor],
        prior: GaussianPrior | GaussianMixturePrior | None,
        validation: Sequence[Tensor],
        *,
        loss: str = "l2",
        codes: CodeSettings | None = None,
        through_start: bool = False,
        faults: DrawnFaults | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        camera.taps()  # refuses optics that keep the slots apart
        if network.start in NEED_PRIOR and prior is None:
            raise SettingError("prior", "none", f"one for a network that starts from {network.start}")
        self.camera, self.network = camera, network
        self.sensors, self.prior, self.validation = tuple(sensors), prior, tuple(validation)
        self.loss, self.codes, self.seed = LOSSES[loss], codes or CodeSettings(), seed
        self.faults = faults or DrawnFaults()
        self.faults.check(camera)
        self.through_start = through_start and camera.codes.learnable
        if self.through_start and network.start == "mixture":
            raise SettingError(
                "codes.through_start",
                "true with start mixture",
                "false, or start lmmse",
                "codes learn with start lmmse",
            )
        self.frozen = not camera.codes.learnable
        self._checked: dict[tuple[int, int], Tensor] = {}

    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """Mean loss of a batch; ``start`` holds its first estimates where they are known."""
        truth = torch.stack([patch.truth for patch in patches]).to(self.camera.response.device)
        estimate = self.decode(*self._seen(patches, step, indexes), start)
        loss = self.loss(estimate.float(), truth)
        if self.codes.throughput is not None and self.codes.hold == "penalty":
            loss = loss + self.codes.penalty * (throughput_of(self.camera) - self.codes.throughput) ** 2
        return loss

    @torch.no_grad()
    def start(self, patches: Sequence[Patch], step: int, indexes: Sequence[int]) -> Tensor:
        """(B, L, H, W) first estimates of a batch."""
        return self._first(*self._seen(patches, step, indexes))

    def decode(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor | None = None) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W): first estimate, unless it is known, then the network."""
        if start is None:
            start = self._first(snapshot, operator, noise)
        return self.network(snapshot, operator, noise, start.to(snapshot))

    def _first(self, snapshot: Tensor, operator: TapOperator, noise: Noise) -> Tensor:
        through = self.through_start and not self.frozen
        with torch.autocast(snapshot.device.type, enabled=False):
            return first_estimate(self.network.start, snapshot, operator, noise, self.prior, differentiable=through)

    def _seen(self, patches: Sequence[Patch], step: int, indexes: Sequence[int]) -> tuple[Tensor, TapOperator, Noise]:
        """Snapshots of a batch, the operator that took them, and the sensor's noise."""
        scenes = torch.stack([patch.scene for patch in patches]).to(self.camera.response.device)
        window = self._window(step, scenes.shape[-2:])
        sensor = self.sensors[step % len(self.sensors)]
        seeds = [(self.seed, _NOISE, step, index) for index in indexes]
        bench, faulty = self.faults.bench(self.camera, sensor, (self.seed, _FAULTS, step))
        operator = self._windowed(window)
        imaging = bench.moving_window(*window) if scenes.ndim == 5 else self._seen_by(bench, operator, window)
        return self._recorded(imaging, scenes, faulty, seeds), operator, self._noise(sensor)

    def groups(self) -> dict[str, list[nn.Parameter]]:
        """Parameters of the decoder and of the codes."""
        learned = [p for p in self.camera.parameters() if p.requires_grad]
        return {"decoder": [p for p in self.network.parameters() if p.requires_grad], "codes": learned}

    def anneal(self, slope: float) -> None:
        """Set the slope of the codes' surrogate derivative."""
        self.camera.codes.anneal(slope)

    def hold(self) -> None:
        """Bring the throughput back to a hard target."""
        if self.codes.throughput is not None and self.codes.hold == "hard":
            hold_throughput(self.camera, self.codes.throughput)

    def figures(self) -> dict[str, float]:
        """Light throughput, share of open aperture and shutter pixels."""
        codes = self.camera.codes
        with torch.no_grad():
            return {
                "throughput": self.camera.throughput(),
                "transmittance": codes.transmittance(),
                "duty": codes.duty(),
            }

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean PSNR over validation scenes, for each sensor and over all."""
        self.eval()
        found: dict[str, list[float]] = {}
        for place, sensor in enumerate(self.sensors):
            for index, truth in enumerate(self.validation):
                scene = truth[None].to(self.camera.response.device)
                window = (0, 0, int(truth.shape[1]), int(truth.shape[2]))
                operator = self._windowed(window)
                bench, faulty = self.faults.bench(self.camera, sensor, (self.seed, _CHECK, _FAULTS, place, index))
                imaging = self._seen_by(bench, operator, window)
                snapshot = self._recorded(imaging, scene, faulty, [(self.seed, _CHECK, place, index)])
                first = self._first_of((place, index), snapshot, operator, self._noise(sensor))
                estimate = self.decode(snapshot, operator, self._noise(sensor), first).float().clamp_min(0)
                error = float((estimate - scene).square().mean())
                found.setdefault(f"psnr_{place}", []).append(psnr_of(error))
        self.train()
        means = {name: float(np.mean(values)) for name, values in found.items()}
        return {"psnr": float(np.mean(list(means.values()))), **(means if len(means) > 1 else {})} if means else {}

    def _first_of(self, check: tuple[int, int], snapshot: Tensor, operator: TapOperator, noise: Noise) -> Tensor:
        """First estimate of a validation scene, computed once where the codes stay as they are."""
        if check in self._checked:
            return self._checked[check]
        found = self._first(snapshot, operator, noise)
        if self.frozen:
            self._checked[check] = found
        return found

    def _window(self, step: int, size: Sequence[int]) -> tuple[int, int, int, int]:
        rng = np.random.default_rng((self.seed, _WINDOWS, step))
        height, width = int(size[0]), int(size[1])
        free = (self.camera.size[0] - height, self.camera.size[1] - width)
        return (int(rng.integers(free[0] + 1)), int(rng.integers(free[1] + 1)), height, width)

    def _windowed(self, window: tuple[int, int, int, int]) -> TapOperator:
        return TapOperator(self.camera.taps().window(*window))

    def _seen_by(self, bench: CodedCamera, known: TapOperator, window: tuple[int, int, int, int]) -> LinearOperator:
        """What images: the known operator, unless the bench has faults."""
        return known if bench is self.camera else bench.window(*window)

    def _recorded(
        self, operator: LinearOperator, scenes: Tensor, sensor: Sensor, seeds: Sequence[tuple[int, ...]]
    ) -> Tensor:
        """Snapshots whose noise depends on each patch's own seed, not on who else is in the batch."""
        with torch.autocast(scenes.device.type, enabled=False):
            exact = operator.A(scenes)
            light = self._light()
            rows = [
                sensor(exact[i : i + 1], light[0], torch_seed(seed, exact.device), light[1])
                for i, seed in enumerate(seeds)
            ]
        return torch.cat(rows)

    def _light(self) -> tuple[float, int]:
        return self.camera.white, self.camera.exposures

    def _noise(self, sensor: Sensor) -> Noise:
        return sensor.noise(*self._light())


def torch_seed(seed: tuple[int, ...], device: torch.device) -> torch.Generator:
    """A generator whose stream is a function of these numbers."""
    state = int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0] >> np.uint64(1))
    return torch.Generator(device=device).manual_seed(state)
