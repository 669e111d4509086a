"""How far to trust the patch likelihood: ``python benchmarks/depth_likelihood.py TRAINING_SCENES … --prior FILE``.

For contaminations, reaches and temperatures of `PatchLikelihood`: mean absolute error of depth (m), share of pixels
within a bin and a half, mean confidence, which should equal it, minus the log-probability of the true plane, and PSNR
of the cube (dB), over training scenes behind a static and a time-multiplexed random mask, and those of ``--codes``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import product

import torch

from tmca.applications import simulate
from tmca.applications.spectral_depth import reading_range
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.data.depth_scenes import load_any_depth_scene, middle_of
from tmca.data.in_memory import as_tensors
from tmca.data.scene_names import named_scenes
from tmca.decoders import PatchLikelihood
from tmca.decoders.likelihood import DepthPosterior
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

SIZE = (96, 128)
TEMPERATURES = (1.0, 4.0, 8.0, 12.0, 16.0, 24.0)
CONTAMINATIONS = (0.0, 0.03, 0.1, 0.3)
REACHES = (0, 24)


def judged(
    planes: torch.Tensor, depth: torch.Tensor, camera: SpectralDepthCamera, temperature: float
) -> tuple[float, ...]:
    """Error, hits, confidence and log score of the log-likelihood of planes."""
    known, log_probability = camera.planes.within(depth), (planes / temperature).log_softmax(1)
    found = DepthPosterior.of(log_probability, camera.planes)
    bins = (1 / found.metres - 1 / depth).abs() / camera.planes.step
    score = -log_probability.gather(1, camera.planes.nearest(depth))
    return tuple(
        float(value[known].double().mean())
        for value in ((found.metres - depth).abs(), bins <= 1.5, found.confidence, score)
    )


def cameras(codes: list[str]) -> Iterator[tuple[str, SpectralDepthCamera]]:
    """Random codes and those of files."""
    sensor = Sensor(read_noise=0.002)
    for slots, shutter in ((1, "open"), (4, "one-hot")):
        given = {"slots": slots, "shutter": shutter, "filters": "clear"}
        yield f"random K = {slots}", SpectralDepthCamera.from_preset("quick", size=SIZE, sensor=sensor, **given)
    for file in codes:
        yield file, SpectralDepthCamera.from_preset("quick", size=SIZE, sensor=sensor, **read_phase_codes(file))


def taken(camera: SpectralDepthCamera, scenes: tuple[str, ...]) -> Iterator[tuple[torch.Tensor, ...]]:
    """Snapshots, depths and cubes of the middles of scenes."""
    for name in scenes:
        scene = load_any_depth_scene(name, **reading_range(camera), side=256, placed="random", from_rgb=True)
        scene = middle_of(scene, SIZE, name)
        cube, depth = as_tensors(scene)
        yield simulate(scene, camera).values, depth, cube


def main() -> None:
    """Print a line for every reach and temperature."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("scenes", nargs="+")
    asked.add_argument("--prior", required=True, help="of the quick preset's bands, learned from the same scenes")
    asked.add_argument("--codes", nargs="*", default=[], help="files of masks for the quick preset")
    given = asked.parse_args()
    prior, scenes = GaussianPrior.load(given.prior), named_scenes(given.scenes)
    for name, camera in cameras(given.codes):
        known = list(taken(camera, scenes))
        for contamination, reach in product(CONTAMINATIONS, REACHES):
            decoder = PatchLikelihood(prior, camera, temperature=1.0, reach=reach, contamination=contamination)
            found = [(decoder(snapshot), depth, cube) for snapshot, depth, cube in known]
            errors = torch.stack([(one.values - cube).square().mean() for one, _, cube in found])
            print(f"{name}, contamination {contamination:g}, reach {reach}: PSNR {-10 * errors.log10().mean():.2f} dB")
            for temperature in TEMPERATURES:
                every = torch.tensor([judged(one.planes, depth, camera, temperature) for one, depth, _ in found])
                error, hits, confidence, score = every.mean(0).tolist()
                print(f"  temperature {temperature:4.0f}: MAE {error:.3f} m, within 1.5 bins {hits:.2f}, confidence "
                      f"{confidence:.2f}, log score {score:.2f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
