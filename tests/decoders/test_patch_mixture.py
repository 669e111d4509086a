"""The mixture decoder: every component's textbook estimate by its probability."""

from itertools import product

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, patches, smooth_scene, snapshot, textbook
from tmca.errors import SettingError
from tmca.priors import BlockModel, GaussianMixturePrior, GaussianPrior
from tmca.priors.gaussian_posterior import NOISE_FLOOR
from tmca.priors.mixture_posterior import _factors
from tmca.sensor import Noise

BLOCK = (3, 4, 12)


@pytest.fixture(scope="module")
def prior():
    bright = smooth_scene(40, 60, seed=1)
    dark = 0.05 * torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return GaussianMixturePrior.learn([bright, dark], BLOCK[1:], kinds=3, rank=6, gains=2, samples=1500)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("read_noise", "shot"), [(0.0, 0.0), (0.02, 0.01)])
def test_one_component_is_the_linear_estimate(name, read_noise, shot):
    plain = GaussianPrior.learn([smooth_scene(40, 60, seed=1)], BLOCK[1:])
    taps = camera(name, 7, 30)
    y = noisy(snapshot(taps, smooth_scene(7, 30, seed=3)[None]), read_noise, shot)
    linear = patches(plain, dtype=torch.float64)(y, taps, read_noise, shot, uncertainty=True)
    one = GaussianMixturePrior.of(plain, rank=4)
    mixed = patches(one, dtype=torch.float64)(y, taps, read_noise, shot, uncertainty=True)
    torch.testing.assert_close(mixed.estimate, linear.estimate, atol=1e-5, rtol=0)
    torch.testing.assert_close(mixed.deviation.square(), linear.deviation.square(), atol=1e-7, rtol=0)


def test_block_estimate_and_variance_are_the_textbook_mixture(prior):
    from tmca.priors.mixture_posterior import MixtureSolver

    taps = camera("single disperser", 4, 12)
    model, read, shot = BlockModel.of(taps, BLOCK), 0.05, 0.01
    scene = prior.sample(6, seed=4)
    y = noisy(snapshot(taps, scene), read, shot)[:, 0, :, 2:12].flatten(1)
    posterior = MixtureSolver(prior, model, Noise(read, shot), torch.float64).posterior(taps.code[None])
    ((estimate, variance),) = posterior.moments([0], [y], True)
    basis = torch.eye(144, dtype=torch.float64).reshape(-1, *BLOCK)
    A = snapshot(taps, basis)[:, 0, :, 2:12].flatten(1).mT
    logs, means, variances = [], [], []
    for k, g in product(range(3), range(2)):
        part = prior.component(k, g)
        expected = A @ part.mean.flatten()
        noise = torch.diag(read**2 + NOISE_FLOOR + shot * expected.clamp_min(0))
        seen = torch.distributions.MultivariateNormal(expected, A @ part.covariance @ A.mT + noise)
        logs.append(prior.weights[k, g].log() + seen.log_prob(y))
        mean, error = textbook(part, A, y, read, shot)
        means.append(mean)
        variances.append(error.diagonal())
    share, means = torch.stack(logs).softmax(0)[..., None], torch.stack(means)
    mean = (share * means).sum(0)
    torch.testing.assert_close(estimate, mean, atol=1e-4, rtol=1e-7)
    spread = (share * (torch.stack(variances)[:, None] + (means - mean).square())).sum(0)
    judged = spread.reshape(-1, *BLOCK)[..., slice(*model.valid)].flatten(1)
    torch.testing.assert_close(variance, judged, rtol=0.05, atol=1e-6)


def test_on_scenes_of_the_mixture_it_beats_the_best_linear_estimate_and_knows_its_error(prior):
    taps = camera("single disperser", 4, 8)
    first, last = BlockModel.of(taps, BLOCK).valid
    scenes = prior.sample(300, seed=5)[..., first:last]
    y = noisy(snapshot(taps, scenes), 0.02, 0.0)
    mixed = patches(prior)(y, taps, 0.02, uncertainty=True)
    linear = patches(prior.gaussian())(y, taps, 0.02).estimate
    assert (mixed.estimate - scenes).square().mean() < 0.97 * (linear - scenes).square().mean()
    z = (mixed.estimate - scenes) / mixed.deviation
    assert float(z.square().mean()) == pytest.approx(1, abs=0.1)


def test_covariances_that_single_precision_leaves_indefinite_are_solved_with_what_it_may_hide():
    taps = torch.rand(2, 40, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    rounded = (taps @ taps.mT).float().double() + 1e-12 * torch.eye(40)
    assert torch.linalg.eigvalsh(rounded).min() < 0
    factors = _factors(rounded)
    torch.testing.assert_close(factors @ factors.mT, rounded, atol=1e-5, rtol=0)
    worse = rounded - 1e-5 * torch.eye(40)  # as of codes that repeat every four pixels, before twelve bands
    torch.testing.assert_close(_factors(worse) @ _factors(worse).mT, worse, atol=1e-3, rtol=0)
    with pytest.raises(SettingError, match="positive definite"):
        _factors(rounded - torch.eye(40))
