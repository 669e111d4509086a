"""Errors of depth on example scenes that stand at every plane."""

import pytest
import torch

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.depth_likelihood import PatchLikelihood
from tmca.experiments.design.flat_scenes import flat_error, judge_on
from tmca.optics import PhaseMaskBench
from tmca.priors import GaussianPrior
from tmca.priors.spectral_depth import needed_block
from tmca.sensor import Sensor

BENCH = PhaseMaskBench(window=(9, 9), mask_pixels=32)
WAVES = (500e-9, 600e-9)


def camera(size=(40, 44), **changes):
    own = {"slots": 4, "planes": 3, "shutter": "one-hot", "rms": 0.15e-6, "sensor": Sensor(read_noise=1e-3)}
    return SpectralDepthCamera(WAVES, size, bench=BENCH, **{**own, **changes})


def cubes(contrast=1.0, side=70):
    source = torch.Generator().manual_seed(0)
    return [0.5 + contrast * (torch.rand(2, side, side + 3, generator=source) - 0.5) for _ in range(2)]


PRIOR = GaussianPrior.learn(cubes(), needed_block(6, BENCH.window))


def test_it_is_the_error_of_the_likelihood_plane_by_plane():
    made, total = camera(), 0.0
    middles = torch.stack([cube[:, 15:55, 14:58] for cube in cubes()])
    for plane, metres in enumerate(made.planes.metres.tolist()):
        taken = made(middles, torch.full((2, 1, 40, 44), metres), plane)
        for one in taken:
            found = PatchLikelihood(PRIOR, made, 6)(one[None]).depth
            total += float((1 / found - 1 / metres).abs().mean()) / made.planes.step
    assert flat_error(made, PRIOR, cubes(), 6) == pytest.approx(total / 6, rel=1e-4)


def test_texture_tells_depth_and_uniform_scenes_do_not():
    rich, poor = (flat_error(camera(), PRIOR, cubes(contrast), 6) for contrast in (1.0, 1e-4))
    assert rich < 0.8 * poor


def test_small_scenes_judge_nothing():
    assert judge_on(cubes(side=50), PRIOR, 6) is None
    judge = judge_on([*cubes(side=50), *cubes()], PRIOR, 2)  # a window is a tile at least
    assert judge(camera()) == pytest.approx(flat_error(camera(), PRIOR, cubes(), 4))
