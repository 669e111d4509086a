"""Time and memory of a spectral-depth camera's whole frame: ``python benchmarks/full_frame.py --size 2816x4096``.

The thesis' camera (25 bands, K = 4, 8 planes, RGB) takes a made-up scene, and depth and spectrum are decoded by patch
likelihood, or by a two-headed network of the usual size that starts from it (``--decoder network``, untrained). One
thread, CPU time; the peak is that of the process's memory so far. Bound: 8 GB. With ``--only decode`` the snapshot is
one of 256×256 pixels, repeated.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from typing import TypeVar

import torch
from timing import Clock, peak_memory
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders import PatchLikelihood
from tmca.decoders.nets.build import build_depth_network
from tmca.decoders.nets.tiles import TwoHeadedNetwork
from tmca.operators.window_moments import WINDOW, needed_block
from tmca.optics import DepthPlanes
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

Result = TypeVar("Result")


def scene_of(bands: int, size: tuple[int, int], planes: DepthPlanes) -> tuple[Tensor, Tensor]:
    """Random texture over slabs of depth: cube (1, L, H, W) and depth (1, 1, H, W) in metres."""
    torch.manual_seed(0)
    cube = torch.empty(1, bands, *size)
    for band in cube[0]:
        coarse = torch.rand(1, 1, size[0] // 3 + 1, size[1] // 3 + 1)
        band[:] = torch.nn.functional.interpolate(coarse, size, mode="bilinear")[0, 0]
    slabs = torch.randint(planes.count, (1, 1, size[0] // 150 + 1, size[1] // 150 + 1))
    chosen = torch.nn.functional.interpolate(slabs.float(), size, mode="nearest").long()
    return cube, planes.metres.float()[chosen]


def prior_of(camera: SpectralDepthCamera) -> GaussianPrior:
    """Of scenes of the same kind."""
    needed = needed_block(WINDOW, camera.bench.window)
    cubes = [scene_of(camera.bands, (128, 128), camera.planes)[0][0] for _ in range(2)]
    return GaussianPrior.learn(cubes, needed, wavelengths=camera.wavelengths)


class Steps:
    """What every step took."""

    def __init__(self, pixels: int) -> None:
        self.found: dict[str, dict[str, float]] = {}
        self.pixels = pixels

    def run(self, name: str, step: Callable[[], Result]) -> Result:
        """Do a step."""
        made: list[Result] = []
        seconds, peak = Clock().seconds(lambda: made.append(step())), peak_memory()
        each = seconds / self.pixels * 1e6
        self.found[name] = {"seconds": seconds, "microseconds a pixel": each, "peak GB": peak}
        print(f"{name:12s} {seconds:8.1f} s {each:8.2f} µs a pixel, peak {peak:.2f} GB", flush=True)
        return made.pop()


def snapshot_of(camera: SpectralDepthCamera, steps: Steps) -> Tensor:
    """A snapshot; the scene is forgotten, as it is by those who reconstruct it."""
    cube, depth = steps.run("scene", lambda: scene_of(camera.bands, camera.size, camera.planes))
    with torch.no_grad():
        return steps.run("simulate", lambda: camera(cube, depth, generator=0))


def repeated(camera: SpectralDepthCamera, steps: Steps) -> Tensor:
    """The snapshot of a small scene over and over."""
    rows, columns = (-(-side // 256) for side in camera.size)
    small = camera_of((256, 256))
    return snapshot_of(small, steps).repeat(1, 1, rows, columns)[..., : camera.size[0], : camera.size[1]].contiguous()


def camera_of(size: tuple[int, int]) -> SpectralDepthCamera:
    """The thesis'."""
    return SpectralDepthCamera.from_preset("thesis", size=size, sensor=Sensor(read_noise=0.002))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="704x1024")
    parser.add_argument("--only", choices=("simulate", "decode"))
    parser.add_argument("--decoder", choices=("likelihood", "network"), default="likelihood")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    height, width = (int(side) for side in arguments.size.split("x"))
    camera, steps = camera_of((height, width)), Steps(height * width)
    snapshot = (repeated if arguments.only == "decode" else snapshot_of)(camera, steps)
    if arguments.only != "simulate":
        prior = steps.run("prior", lambda: prior_of(camera))
        if arguments.decoder == "network":
            network = TwoHeadedNetwork(build_depth_network({}, camera), camera, prior)
            steps.run("decode", lambda: network(snapshot))
        else:
            decoder = PatchLikelihood(prior, camera)
            steps.run("matrices", lambda: decoder._basis((0, 0)))
            steps.run("decode", lambda: decoder(snapshot, planes=False))
    if arguments.json:
        print(json.dumps(steps.found, indent=1))


if __name__ == "__main__":
    main()
