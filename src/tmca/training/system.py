"""A camera and a network that learn together: what a batch costs and how good validation scenes become."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from tmca.decoders.nets.network import NEED_PRIOR
from tmca.decoders.nets.tiles import Tile
from tmca.errors import SettingError
from tmca.sensor import Noise, Sensor
from tmca.training.faults import DrawnFaults
from tmca.training.losses import LOSSES, psnr_of
from tmca.training.patches import Patch

_WINDOWS, _NOISE, _VALIDATION, _FAULTS = 1, 2, 3, 4
"""Streams of random numbers: windows of the codes, the sensor's noise in training, in validation, faults."""
Window = tuple[int, int, int, int]
"""First row and column, rows and columns of the codes that image a patch."""


class Seen(NamedTuple):
    """Snapshots, and what their decoder knows of how they were taken.

    Args:
        snapshot: (B, C, H, W').
        optics: what the network is given of the camera: an operator, or the camera itself.
        sensor: that took them, without faults.
    """

    snapshot: Tensor
    optics: Any
    sensor: Sensor


def starts_from_prior(network: Any) -> bool:
    """Whether a network's first estimate needs a prior."""
    return network.start in (*NEED_PRIOR, "likelihood")


class System(nn.Module, ABC):
    """A camera and a decoder that learn together, as the training loop sees them.

    Args:
        camera: its codes are learned where they are parameters.
        network: decoder.
    """

    def __init__(self, camera: Any, network: Any) -> None:
        super().__init__()
        self.camera, self.network = camera, network
        self.frozen = not camera.learnable
        """Whether the codes stay as they are for the rest of the run."""

    @abstractmethod
    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        """Mean loss of a batch; ``start`` holds its first estimates where they are cached."""

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Figures of merit on validation scenes; ``score``, else ``psnr``, chooses the best step."""

    def anneal(self, slope: float) -> None:
        """Set the slope of the codes' surrogate derivative; called before every step."""

    def hold(self) -> None:
        """Bring the codes back to what is demanded of them; called after every step in which they learn."""

    def groups(self) -> dict[str, list[nn.Parameter]]:
        """Parameters of the decoder and of groups of codes, those of ``OptimiserSettings.code_rates``."""
        parts = {"decoder": self.network, "codes": self.camera}
        return {name: [p for p in part.parameters() if p.requires_grad] for name, part in parts.items()}

    def figures(self) -> dict[str, float]:
        """Numbers for the log."""
        return {"throughput": self.camera.throughput()}


class TrainingSystem(System):
    """A camera whose codes may learn, and the network behind it (thesis 1.7, 4.2, 5.2).

    A batch is seen with one of the sensors; all randomness follows from the seed, the step and the patch's index.

    Args:
        camera: its codes are learned where they are parameters.
        network: decoder.
        sensors: one of them, in turn, in each step.
        prior: for networks that start from one.
        validation: scenes (L, H, W), no larger than the camera.
        loss: name in ``LOSSES``.
        faults: of the bench, drawn in every step and for every validation scene; the decoder does not know them.
        seed: of windows, noise and faults.

    Raises:
        SettingError: no prior for a network that needs one, or faults that the camera cannot have.
    """

    untrained: ClassVar[tuple[str, ...]] = ()
    """Faults that snapshots can have, but not those of a training."""
    mixes_columns = False
    """Whether the optics lay light of a scene column on other columns."""
    tile_size = 1
    """Pixels of the tile of codes that what a network sees must begin with."""

    def __init__(
        self,
        camera: Any,
        network: Any,
        sensors: Sequence[Sensor],
        prior: Any,
        validation: Sequence[Tensor] = (),
        *,
        loss: str = "l2",
        faults: DrawnFaults | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(camera, network)
        if starts_from_prior(network) and prior is None:
            raise SettingError("prior", "none", f"one for a network that starts from {network.start}")
        self.prior, self.sensors, self.validation = prior, tuple(sensors), tuple(validation)
        self.loss, self.faults, self.seed = LOSSES[loss], faults or DrawnFaults(), seed
        self.faults.check(camera, self.untrained)
        self._first_estimates: dict[tuple[int, int], Tensor | None] = {}

    @abstractmethod
    def optics(self, window: Window | None = None) -> Any:
        """What the network is given of the camera behind a window of the codes, or behind all of them."""

    @abstractmethod
    def image(self, scenes: Tensor, window: Window, bench: Any, optics: Any) -> Tensor:
        """(B, C, h, w') exact snapshots of scenes (B, L, h, w) by the camera, or a bench with its faults."""

    @abstractmethod
    def first(self, seen: Seen) -> Tensor | None:
        """(B, L, h, w) what the network starts from; None where it starts from the snapshot."""

    @abstractmethod
    def cut(self, seen: Seen, tile: Tile) -> Seen:
        """The part of a snapshot that a network needs for a tile."""

    def inner(self, values: Tensor) -> Tensor:
        """(…, h, w) what is decoded of the pixels of a patch or of its snapshot."""
        return values

    def cost(self, estimate: Any, truth: Tensor) -> Tensor:
        """Mean loss of estimates, of the whole truth (B, L, h, w) or of what is decoded of it."""
        return self.loss(estimate.float(), truth)

    def cost_of_codes(self, seen: Seen, truth: Tensor, step: int) -> Tensor | float:
        """What is added to the loss of a step for the codes' sake."""
        return 0.0

    def merit(self, estimate: Any, truth: Tensor, seen: Seen | None = None) -> dict[str, float]:
        """Figures of merit of an estimate, of these snapshots; ``score``, else ``psnr``, chooses the best step."""
        return {"psnr": psnr_of(float((estimate.float().clamp_min(0) - truth).square().mean()))}

    def means(self, rows: Sequence[Sequence[dict[str, float]]]) -> dict[str, float]:
        """Means of figures of merit over sensors and their validation scenes; NaN is left out."""
        every = [row for rows_of_sensor in rows for row in rows_of_sensor]
        return {name: float(np.nanmean([row[name] for row in every])) for name in (every[0] if every else {})}

    def tensors(self, estimate: Any) -> tuple[Tensor, ...]:
        """Pictures (B, …, h, w) that make up an estimate."""
        return (estimate,)

    def estimate_of(self, *tensors: Tensor) -> Any:
        """The estimate that consists of these pictures."""
        return tensors[0]

    def forward(
        self, patches: Sequence[Patch], step: int, indexes: Sequence[int], start: Tensor | None = None
    ) -> Tensor:
        truth, seen = self._batch([patch.truth for patch in patches]), self._taken(patches, step, indexes)
        return self.cost(self.decode(seen, start), truth) + self.cost_of_codes(seen, truth, step)

    @torch.no_grad()
    def start(self, patches: Sequence[Patch], step: int, indexes: Sequence[int]) -> Tensor | None:
        """(B, L, h, w) first estimates of a batch, as the same step makes them."""
        return self.first(self._taken(patches, step, indexes))

    def decode(self, seen: Seen, start: Tensor | None = None) -> Any:
        """The network's estimate of snapshots; ``start`` is their first estimate where it is cached."""
        start = self.first(seen) if start is None else start
        start = None if start is None else start.to(seen.snapshot)
        return self.network(self.inner(seen.snapshot), seen.optics, self.noise(seen.sensor), start)

    def noise(self, sensor: Sensor) -> Noise:
        """Of a sensor behind this camera."""
        return sensor.noise(self.camera.white, self.camera.exposures)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean figures of merit over sensors and validation scenes; nothing without scenes."""
        self.eval()
        scenes = range(len(self.validation))
        rows = [[self._validated(place, index) for index in scenes] for place in range(len(self.sensors))]
        self.train()
        return self.means(rows) if self.validation else {}

    def _validated(self, place: int, index: int) -> dict[str, float]:
        """Figures of merit of a validation scene, seen by one of the sensors."""
        scene = self._batch([self.validation[index]])
        streams = ([(self.seed, _VALIDATION, place, index)], (self.seed, _VALIDATION, _FAULTS, place, index))
        seen = self._exposed(scene, (0, 0, *scene.shape[-2:]), self.sensors[place], *streams)
        if (place, index) not in self._first_estimates or not self.frozen:
            self._first_estimates[place, index] = self.first(seen)
        return self.merit(self.decode(seen, self._first_estimates[place, index]), scene, seen)

    def _batch(self, values: Sequence[Tensor]) -> Tensor:
        return torch.stack(list(values)).to(self.camera.response.device)

    def _taken(self, patches: Sequence[Patch], step: int, indexes: Sequence[int]) -> Seen:
        """A batch as the camera sees it in a step."""
        scenes, sensor = self._batch([patch.scene for patch in patches]), self.sensors[step % len(self.sensors)]
        seeds = [(self.seed, _NOISE, step, index) for index in indexes]
        return self._exposed(scenes, self._window(step, scenes.shape[-2:]), sensor, seeds, (self.seed, _FAULTS, step))

    def _exposed(
        self, scenes: Tensor, window: Window, sensor: Sensor, seeds: Sequence[tuple[int, ...]], faults: tuple[int, ...]
    ) -> Seen:
        """Snapshots whose noise depends on each patch's own seed, not on who else is in the batch."""
        bench, faulty = self.faults.bench(self.camera, sensor, faults)
        optics, white, exposures = self.optics(window), self.camera.white, self.camera.exposures
        with torch.autocast(scenes.device.type, enabled=False):
            exact = self.image(scenes, window, bench, optics)
            rows = [
                faulty(exact[i : i + 1], white, seeded(seed, exact.device), exposures) for i, seed in enumerate(seeds)
            ]
        return Seen(torch.cat(rows), optics, sensor)

    def _window(self, step: int, size: Sequence[int]) -> Window:
        rng = np.random.default_rng((self.seed, _WINDOWS, step))
        top, left = (int(rng.integers(whole - part + 1)) for whole, part in zip(self.camera.size, size, strict=True))
        return top, left, int(size[0]), int(size[1])


def seeded(seed: tuple[int, ...], device: torch.device) -> torch.Generator:
    """A generator whose stream is a function of these numbers."""
    state = int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0] >> np.uint64(1))
    return torch.Generator(device=device).manual_seed(state)
