"""How far to trust the patch likelihood: ``python benchmarks/depth_likelihood.py TRAINING_SCENES … --prior FILE``.

For temperatures and reaches of `PatchLikelihood`: mean absolute error of depth (m), share of pixels within a bin and a
half, mean confidence, which should equal it, and minus the log-probability of the true plane, over training scenes
behind a static and a time-multiplexed random mask.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import torch

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.depth_likelihood import PatchLikelihood
from tmca.decoders.depth_posterior import DepthPosterior
from tmca.experiments.depth_scenes import depth_tensor, load_any_depth_scene, middle_of
from tmca.experiments.spectral_depth import take_spectral_depth_snapshot
from tmca.priors import load_prior
from tmca.sensor import Sensor
from tmca.training.scenes import named_scenes

SIZE = (96, 128)
TEMPERATURES = (1.0, 4.0, 8.0, 12.0, 16.0, 24.0)
REACHES = (0, 8, 16, 24, 32)


def judged(
    planes: torch.Tensor, depth: torch.Tensor, camera: SpectralDepthCamera, temperature: float
) -> tuple[float, ...]:
    """Error, hits, confidence and log score of the log-likelihood of planes."""
    known, log_probability = camera.planes.known(depth), (planes / temperature).log_softmax(1)
    found = DepthPosterior.of(log_probability, camera.planes)
    bins = (1 / found.metres - 1 / depth).abs() / camera.planes.step
    score = -log_probability.gather(1, camera.planes.nearest(depth))
    return tuple(
        float(value[known].double().mean())
        for value in ((found.metres - depth).abs(), bins <= 1.5, found.confidence, score)
    )


def taken(camera: SpectralDepthCamera, scenes: tuple[str, ...]) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
    """Snapshots and depths of the middles of scenes."""
    for name in scenes:
        scene = load_any_depth_scene(name, camera, side=256, placed="random", from_rgb=True)
        scene = middle_of(scene, SIZE, name)
        yield take_spectral_depth_snapshot(scene, camera).values, depth_tensor(scene)


def main() -> None:
    """Print a line for every reach and temperature."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("scenes", nargs="+")
    asked.add_argument("--prior", required=True, help="of the quick preset's bands, learned from the same scenes")
    given = asked.parse_args()
    prior, scenes = load_prior(given.prior), named_scenes(given.scenes)
    for slots, shutter in ((1, "open"), (4, "one-hot")):
        codes = {"slots": slots, "shutter": shutter, "filters": "clear", "sensor": Sensor(read_noise=0.002)}
        camera = SpectralDepthCamera.from_preset("quick", size=SIZE, **codes)
        known = list(taken(camera, scenes))
        for reach in REACHES:
            decoder = PatchLikelihood(prior, camera, temperature=1.0, reach=reach)
            found = [(decoder(snapshot).planes, depth) for snapshot, depth in known]
            for temperature in TEMPERATURES:
                every = torch.tensor([judged(planes, depth, camera, temperature) for planes, depth in found])
                error, hits, confidence, score = every.mean(0).tolist()
                print(f"K = {slots}, reach {reach:2d}, temperature {temperature:4.0f}: MAE {error:.3f} m, within 1.5 "
                      f"bins {hits:.2f}, confidence {confidence:.2f}, log score {score:.2f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
