"""Information about depth against distances of Gaussians, a fine grid of depths, and finite differences of masks."""

import pytest
import torch

from tests.design.test_spectral_depth import gaussians
from tests.priors.test_spectral_depth import BENCH, camera, prior_of
from tmca.design.spectral_depth import (
    confusion,
    depth_information,
    fisher_information,
    kullback_leibler,
    window_covariance,
)
from tmca.priors.spectral_depth import needed_block
from tmca.sensor import Sensor

NOISE = Sensor(read_noise=0.02)
DEPTH = (0.5, 2.0)


def made(**changes):
    return camera(4, sensor=NOISE, **{"depth": DEPTH, "seed": 3, **changes})


def prior():
    return prior_of(needed_block(4, BENCH.window))


@pytest.mark.parametrize("n", [3, 6])
def test_it_is_the_curvature_of_the_distance(n):
    base, turn = gaussians(1, n)[0], gaussians(1, n, seed=4)[0]
    step = 1e-3
    distance = kullback_leibler(torch.stack([base + step * k * turn for k in (-1, 0, 1)]))[1]
    expected = (distance[0] + distance[2]) / step**2
    assert float(fisher_information(base, turn)) == pytest.approx(float(expected), rel=1e-2)
    assert float(fisher_information(base, base)) == pytest.approx(n / 2, rel=1e-6)


@pytest.mark.parametrize("planes", [4, 5])
def test_it_is_what_neighbours_a_fiftieth_of_a_bin_away_tell(planes):
    wide = made(planes=planes)
    found = depth_information(wide, prior(), 4, contamination=0)
    assert found.shape == (planes,)
    for plane, inverse in enumerate(wide.planes.inverse.tolist()):
        near = wide.planes.step / 50
        close = made(planes=3, depth=(1 / (inverse + near), 1 / (inverse - near)))
        distance = kullback_leibler(window_covariance(close, prior(), 4, contamination=0))[1]
        expected = (distance[0] + distance[2]) / near**2
        assert float(found[plane]) == pytest.approx(float(expected), rel=5e-3)


def test_it_is_local_where_planes_are_few_and_far_is_infinite():
    far = made(planes=3, depth=(0.5, float("inf")))
    dense = made(planes=13, depth=(0.5, float("inf")))
    few, many = (depth_information(one, prior(), 4, contamination=0) for one in (far, dense))
    torch.testing.assert_close(few, many[::6], rtol=0.03, atol=0)


def test_what_is_expected_of_other_planes_does_not_move():
    wide = made(planes=4)
    own = window_covariance(wide, prior(), 4, contamination=0)
    mixed = window_covariance(wide, prior(), 4, contamination=0.3)
    assert not torch.allclose(own, mixed)
    clean, blurred = (depth_information(wide, prior(), 4, contamination=share) for share in (0.0, 0.3))
    assert bool((blurred < clean).all())


@pytest.mark.parametrize("figure", ["confusion", "information"])
def test_gradients_reach_the_heights_of_the_mask(figure):
    own, blocks = made(planes=3, learnable="mask"), prior()
    heights = own.spread.heights
    values = next(p for p in heights.parameters() if p.requires_grad)

    def value():
        if figure == "confusion":
            return confusion(window_covariance(own, blocks, 4))
        return depth_information(own, blocks, 4).log().mean()

    found = torch.autograd.grad(value(), values)[0].double()
    towards = found / found.norm()
    step = 0.001 * float(values.detach().norm())
    start = values.detach().clone()
    ends = []
    for sign in (-1, 1):
        with torch.no_grad():
            values.copy_(start + sign * step * towards.to(start.dtype))
            ends.append(float(value()))
    slope = (ends[1] - ends[0]) / (2 * step)
    assert slope == pytest.approx(float(found.norm()), rel=0.02)
