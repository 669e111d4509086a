"""The mixture decoder: every component's textbook estimate by its probability."""

from dataclasses import replace
from itertools import product

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, patches, smooth_scene, snapshot, textbook
from tmca.errors import SettingError
from tmca.priors import BlockModel, GaussianMixturePrior, GaussianPrior, mixture_posterior
from tmca.priors.gaussian_posterior import NOISE_FLOOR
from tmca.priors.mixture_posterior import MixtureSolver
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


def test_where_rounding_is_above_the_noise_all_components_have_what_it_may_hide(prior, monkeypatch):
    model = BlockModel.of(taps := camera("single disperser", 4, 12), BLOCK)
    solver = MixtureSolver(prior, model, Noise(1e-6), torch.float64)
    posterior = solver.posterior(taps.code[None])
    values, vectors = torch.linalg.eigh(posterior.signal[0])
    lowest, level = torch.outer(vectors[:, 0], vectors[:, 0]), float(values.mean())

    def components(below):
        signal = posterior.signal - (values[0] + below * level) * lowest
        return replace(posterior, signal=signal, inside=0 * posterior.inside).components(0, solver.every)

    with pytest.raises(SettingError, match="positive definite"):
        components(1.0)
    together = components(1e-5)
    assert together.log_scale.isfinite().all()
    monkeypatch.setattr(mixture_posterior, "_AT_ONCE", 1)
    torch.testing.assert_close(components(1e-5).log_scale, together.log_scale)
