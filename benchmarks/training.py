"""What half precision and the channels-last layout gain in a training step: ``python benchmarks/training.py``.

One thread, CPU time of forward and backward of each network without its first estimates, medians; ratios to float32 in
the ordinary layout, in one run. Last, a whole step of ``tmca train spectral-depth --preset quick`` (snapshots, network,
loss, backward, AdamW; float32) with first stages that are kept: 0.3 s, measured beside other work on the processor.
"""

from __future__ import annotations

from unittest.mock import patch

import torch
from timing import milliseconds

from tmca.cameras import SpectralCamera
from tmca.decoders import build_network
from tmca.decoders.nets.build import build_depth_network
from tmca.priors import GaussianPrior
from tmca.sensor import Noise, Sensor
from tmca.training import training_settings
from tmca.training.depth_system import DepthSystem
from tmca.training.patches import Patch
from tmca.training.starting_masks import starting_camera

BANDS, BATCH, PATCH = 12, 8, 64


def step(network: torch.nn.Module, half: bool, channels_last: bool) -> float:
    """Milliseconds of forward and backward."""
    camera = SpectralCamera(bands=BANDS, size=(PATCH, PATCH), slots=8)
    operator, scene = camera.operator(), torch.rand(BATCH, BANDS, PATCH, PATCH)
    snapshot = operator.A(scene)

    def task() -> None:
        network.zero_grad()
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            estimate = network(snapshot, operator, Noise(0.01, 0.0), scene)
        (estimate.float() - scene).square().mean().backward()

    layout = torch.channels_last if channels_last else torch.contiguous_format
    with patch("torch.channels_last", layout):
        return milliseconds(task, 9)


def depth_step() -> float:
    """Milliseconds of a step of the quick spectral-depth preset."""
    settings = training_settings("spectral-depth", "quick")
    camera, batch = starting_camera(settings), settings.data.batch
    network = build_depth_network(settings.decoder, camera)
    prior = GaussianPrior.learn([torch.rand(camera.bands, 8, 8)], (2, 2))  # unused: all first stages are there
    sensors = [Sensor(**noise.model_dump()) for noise in settings.noise]
    margin = (camera.size[0] - settings.data.patch) // 2
    system = DepthSystem(camera, network, sensors, prior, [], margin=margin)
    scenes = [torch.rand(camera.bands + 1, *camera.size) for _ in range(batch)]
    start = torch.rand(batch, camera.bands + camera.planes.count, settings.data.patch, settings.data.patch)
    optimiser = torch.optim.AdamW(system.groups()["decoder"])

    def task() -> None:
        optimiser.zero_grad()
        system([Patch(scene, scene, "") for scene in scenes], 0, range(batch), start).backward()
        optimiser.step()

    return milliseconds(task, 9)


if __name__ == "__main__":
    torch.set_num_threads(1)
    for kind in ("unet", "unrolled"):
        times = {
            name: step(build_network(kind, bands=BANDS), half, last)
            for name, half, last in (
                ("float32", False, False), ("float32, channels-last", False, True),
                ("bfloat16", True, False), ("bfloat16, channels-last", True, True),
            )
        }  # fmt: skip
        for name, value in times.items():
            print(f"{kind:10} {name:26} {value:7.1f} ms  {value / times['float32']:.2f}")
    print(f"quick spectral-depth step {depth_step() / 1e3:.2f} s")
