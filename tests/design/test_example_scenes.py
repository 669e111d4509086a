"""Errors of depth on example scenes, at drawn depths and at every plane."""

import numpy as np
import pytest
import torch

from tmca.applications.example_scenes import flat_error, judge_on, placed_error
from tmca.cameras import SpectralDepthCamera
from tmca.data.spectral_depth import drawn_nearness
from tmca.decoders import PatchLikelihood
from tmca.operators.window_moments import needed_block
from tmca.optics import PhaseMaskBench
from tmca.priors import GaussianPrior
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
        taken = made(middles, torch.full((2, 1, 40, 44), metres), generator=plane)
        for one in taken:
            found = PatchLikelihood(PRIOR, made, 6)(one[None]).depth
            total += float((1 / found - 1 / metres).abs().mean()) / made.planes.step
    assert flat_error(made, PRIOR, cubes(), 6) == pytest.approx(total / 6, rel=1e-4)


def test_at_drawn_depths_it_is_that_of_placed_scenes():
    made, total = camera(), 0.0
    for draw in range(3):
        for number in range(2):
            nearness = drawn_nearness((160, 176), np.random.default_rng([draw, number]))[60:100, 66:110]
            depth = torch.from_numpy(1 / (0.5 + 2.0 * nearness)).float()[None, None]  # 0.4 to 2 m
            taken = made(
                torch.stack([c[:, 15:55, 14:58] for c in cubes()]), depth.expand(2, -1, -1, -1), generator=draw
            )[number]
            found = PatchLikelihood(PRIOR, made, 6)(taken[None]).depth
            total += float((1 / found - 1 / depth).abs().mean()) / made.planes.step
    assert placed_error(made, PRIOR, cubes(), 6) == pytest.approx(total / 6, rel=1e-3)


@pytest.mark.parametrize(("error", "share"), [(flat_error, 0.8), (placed_error, 0.9)])
def test_texture_tells_depth_and_uniform_scenes_do_not(error, share):
    rich, poor = (error(camera(), PRIOR, cubes(contrast), 6) for contrast in (1.0, 1e-4))
    assert rich < share * poor


def test_small_scenes_judge_nothing():
    assert judge_on(cubes(side=50), PRIOR, 6) is None
    judge = judge_on([*cubes(side=50), *cubes()], PRIOR, 2)  # a window is a tile at least
    assert judge(camera()) == pytest.approx(placed_error(camera(), PRIOR, cubes(), 4))
    flat = judge_on(cubes(), PRIOR, 6, flat_error)
    assert flat(camera()) == pytest.approx(flat_error(camera(), PRIOR, cubes(), 6))
