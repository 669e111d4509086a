"""Cameras drawn at random, and scenes that they saw with their first estimates: what the network learns from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from studies.shipped.scenes import drawn_scene
from tmca.cameras import SpectralCamera
from tmca.decoders import SubspaceNetwork, first_estimate
from tmca.metrics import psnr
from tmca.operators import TapOperator, Taps
from tmca.priors import SubspacePrior, find_prior, interpolation
from tmca.sensor import Noise

KNOTS = 1e-9 * np.linspace(400, 700, 31)
_BANDS = [453.3, 457.6, 462.1, 466.8, 471.6, 476.5, 481.6, 486.9, 492.4, 498.0, 503.9, 509.9, 516.2, 522.7]
_BANDS += [529.5, 536.5, 543.8, 551.4, 558.6, 567.5, 575.3, 584.3, 594.4, 604.2, 614.4, 625.1, 636.3, 648.1]
TSA = 1e-9 * np.array(_BANDS)
"""Bands of the usual simulation benchmark (Meng, Ma and Yuan 2020), metres."""
_CODES: dict[str, dict[str, Any]] = {
    "static": {"slots": 1, "aperture": "static", "shutter": "open"},
    "dual": {"slots": 1, "aperture": "static", "shutter": "open", "disperser": "dual"},
    "one-hot": {"slots": 4, "aperture": "random", "shutter": "one-hot"},
    "random": {"slots": 8, "aperture": "random", "shutter": "random"},
    "balanced": {"slots": 4, "aperture": "random", "shutter": "balanced", "buckets": 2},
}
_OFTEN = (0.3, 0.05, 0.15, 0.2, 0.3)


@dataclass
class Example:
    """Scenes (N, L, H, W) in half precision, what a camera saw of them, and first estimates in half precision."""

    taps: Taps
    noise: Noise
    wavelengths: tuple[float, ...]
    scenes: Tensor
    snapshots: Tensor
    starts: Tensor

    def part(self, rows: slice, chosen: Tensor) -> tuple[Tensor, Tensor, TapOperator, Tensor]:
        """Scenes, snapshots, operator and first estimates of some rows of some of the scenes."""
        operator = TapOperator(replace(self.taps, code=self.taps.code[:, rows].contiguous()))
        scenes, starts = (values[chosen][:, :, rows].float() for values in (self.scenes, self.starts))
        return scenes, self.snapshots[chosen][:, :, rows], operator, starts


def drawn_camera(rng: np.random.Generator, size: tuple[int, int]) -> tuple[SpectralCamera, Noise]:
    """A camera of other bands, dispersion, codes and buckets each time, and the noise of its sensor."""
    code = _CODES[str(rng.choice([*_CODES], p=_OFTEN))]
    kind = rng.choice(3, p=(0.35, 0.25, 0.4))
    low, high, count = rng.uniform(400, 480), rng.uniform(600, 700), int(rng.integers(8, 29))
    bands = (TSA, 1e-9 * np.linspace(400, 700, 12), 1e-9 * np.linspace(low, high, count))[kind]
    dispersion = float(rng.choice([1.0, 2.0, rng.uniform(0.7, 2.0)], p=(0.4, 0.45, 0.15)))
    read = 0.0 if rng.random() < 0.4 else float(np.exp(rng.uniform(np.log(1e-3), np.log(0.03))))
    shot = 0.0 if rng.random() < 0.7 else float(10 ** rng.uniform(-4.3, -3))
    seed = int(rng.integers(2**30))
    return SpectralCamera(bands.tolist(), size, **code, dispersion=dispersion, seed=seed), Noise(read, shot)


def benchmark_camera(mask: Tensor) -> tuple[SpectralCamera, Noise]:
    """The camera of the usual benchmark: 28 bands, 2 px a band, one mask, no noise."""
    size = (mask.shape[0], mask.shape[1])
    return SpectralCamera(TSA.tolist(), size, 1, dispersion=2.0, aperture=mask[None], shutter="open"), Noise(0.0)


@torch.no_grad()
def example(
    camera: SpectralCamera,
    noise: Noise,
    cubes: Sequence[Tensor],
    prior: SubspacePrior,
    rng: np.random.Generator,
    count: int,
    device: torch.device,
) -> Example:
    """``count`` scenes drawn from cubes (31, H, W), seen by a camera; the cubes themselves where it is 0."""
    drawn = [drawn_scene(cubes, rng) for _ in range(count)] or cubes
    between = interpolation(camera.wavelengths, torch.from_numpy(KNOTS)).float()
    part = (slice(None), *(slice(side) for side in camera.size))
    scenes = torch.stack([torch.einsum("lk,khw->lhw", between, scene[part]) for scene in drawn]).to(device)
    taps = replace(camera.taps(), code=camera.taps().code.detach().to(device))
    operator = TapOperator(taps)
    exact = operator.A(scenes)
    white = torch.randn(exact.shape, generator=torch.Generator().manual_seed(int(rng.integers(2**30))))
    snapshots = exact + noise.variance(exact).sqrt() * white.to(device)
    starts = first_estimate("lmmse", snapshots, operator, noise, find_prior(camera, prior))
    return Example(taps, noise, camera.wavelengths, scenes.half(), snapshots, starts.half())


def gains(network: SubspaceNetwork, one: Example) -> list[tuple[float, float]]:
    """PSNR of first estimates, and by how much the network is above it."""
    rows = []
    for index in range(len(one.scenes)):
        truth, snapshot, operator, start = one.part(slice(None), torch.tensor([index], device=one.scenes.device))
        estimate = network.at(one.wavelengths)(snapshot, operator, one.noise, start)
        before, after = (psnr(part.clamp(0, 1).cpu(), truth.cpu()) for part in (start, estimate))
        rows.append((before, after - before))
    return rows
