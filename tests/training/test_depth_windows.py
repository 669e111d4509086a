"""The patch likelihood as a loss: against the explicit normal density, the decoder, and finite differences."""

import pytest
import torch
from scipy.stats import multivariate_normal

from tests.operators.test_window_moments import BENCH, camera, prior_of
from tmca.decoders import PatchLikelihood
from tmca.design.spectral_depth import window_covariance
from tmca.operators.window_moments import needed_block
from tmca.sensor import Sensor
from tmca.training.depth_windows import DepthWindows

SENSOR = Sensor(read_noise=0.05)


def seen(size, seed=0, **how):
    """A camera with snapshots of scenes at drawn places."""
    own = camera(4, size=(size, size), sensor=SENSOR, **how)
    source = torch.Generator().manual_seed(seed)
    scene = torch.rand(2, own.bands, size, size, generator=source)
    place = torch.rand(2, 1, 1, 1, generator=source).expand(2, 1, size, size).contiguous()
    return own, own.exact(scene, own.planes.depth_of(place)), place


@pytest.mark.parametrize(("window", "size"), [(4, 12), (6, 13)])
def test_windows_have_the_density_of_the_prior(window, size):
    own, snapshot, place = seen(size)
    prior = prior_of(needed_block(window, BENCH.window))
    found, middle = DepthWindows(prior, window, gains=[1.0], temperature=1.0, reach=0)(own, snapshot, place)
    covariance = window_covariance(own, prior, window).detach().numpy()
    count, scale = size // window, (window / 12) ** 2
    assert found.logits.shape == (2, own.planes.count, count, count)
    for row, column in [(0, 0), (count - 1, count - 1)]:
        top, left = row * window, column * window
        cut = snapshot[1, :, top : top + window, left : left + window].detach().double().flatten().numpy()
        each = torch.tensor([multivariate_normal(cov=c).logpdf(cut) for c in covariance]) / scale
        own_logits = found.logits[1, :, row, column].double()
        torch.testing.assert_close(own_logits.log_softmax(0), each.log_softmax(0), rtol=2e-3, atol=2e-3)
        assert float(middle[1, 0, row, column]) == float(place[1, 0, top + window // 2, left + window // 2])


@pytest.mark.parametrize("buckets", [1, 2])
def test_of_one_window_it_says_what_the_decoder_says(buckets):
    own, snapshot, place = seen(12, buckets=buckets)
    prior = prior_of(needed_block(12, BENCH.window))
    found, _ = DepthWindows(prior, 12, gains=[0.25, 1.0, 4.0])(own, snapshot, place)
    decoded = PatchLikelihood(prior, own, 12, gains=[0.25, 1.0, 4.0])(snapshot)
    expected = decoded.planes[..., 6, 6].log_softmax(1)
    torch.testing.assert_close(found.logits[..., 0, 0].log_softmax(1), expected.float(), rtol=1e-3, atol=1e-3)


def test_neighbours_have_a_say_in_the_depth():
    own, snapshot, place = seen(16)
    prior = prior_of(needed_block(4, BENCH.window))
    alone, _ = DepthWindows(prior, 4, reach=0)(own, snapshot, place)
    together, _ = DepthWindows(prior, 4, reach=4)(own, snapshot, place)
    torch.testing.assert_close(together.logits[..., 1, 2], alone.logits[..., :3, 1:4].mean((-2, -1)))
    torch.testing.assert_close(together.logits[..., 0, 0], alone.logits[..., :2, :2].mean((-2, -1)))


def test_its_slope_is_that_of_finite_differences():
    own = camera(4, size=(8, 8), sensor=SENSOR, learnable=["mask"]).double()
    prior = prior_of(needed_block(4, BENCH.window))
    scene = torch.rand(1, own.bands, 8, 8, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    place = torch.full((1, 1, 8, 8), 0.3, dtype=torch.float64)
    (values,) = own.point_spread.parameters()

    def loss():
        found, middle = DepthWindows(prior, 4)(own, own.exact(scene, own.planes.depth_of(place)), place)
        return found.expected_error(middle).mean()

    (slope,) = torch.autograd.grad(loss(), values)
    place_of, step = int(slope.abs().argmax()), 1e-3  # point spread functions are of single precision
    ends = []
    for sign in (1, -1):
        with torch.no_grad():
            values.view(-1)[place_of] += sign * step
            ends.append(float(loss()))
            values.view(-1)[place_of] -= sign * step
    assert float(slope.abs().max()) > 1e-6
    assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(float(slope.view(-1)[place_of]), rel=1e-2)
