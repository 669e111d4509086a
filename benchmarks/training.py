"""What half precision and the channels-last layout gain in a training step: ``python benchmarks/training.py``.

One thread, CPU time of forward and backward of each network without its first estimates, medians; ratios to float32 in
the ordinary layout, in one run.
"""

from __future__ import annotations

from unittest.mock import patch

import torch
from spectral import milliseconds

from tmca.cameras import SpectralCamera
from tmca.decoders.network import build_network
from tmca.sensor import Noise

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
