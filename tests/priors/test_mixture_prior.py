"""The Gaussian-mixture prior finds the kinds it was shown."""

import pytest
import torch

from tests.small_scenes import smooth_scene
from tmca.errors import SettingError
from tmca.priors import GaussianMixturePrior, GaussianPrior

BLOCK = (3, 2, 6)


def dark_and_bright():
    """A smooth bright scene beside a rough dark one."""
    bright = smooth_scene(40, 60, seed=1)
    dark = 0.05 * torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    return [bright, dark]


@pytest.fixture(scope="module")
def prior():
    settings = {"kinds": 4, "rank": 5, "gains": 3, "samples": 1500}
    return GaussianMixturePrior.learn(dark_and_bright(), BLOCK[1:], **settings)


def test_weights_are_probabilities_and_components_are_positive(prior):
    assert float(prior.weights.sum()) == pytest.approx(1)
    for kind in range(4):
        for gain in range(3):
            assert torch.linalg.eigvalsh(prior.component(kind, gain).covariance).min() > 0


def test_samples_have_the_moments_of_the_whole_mixture(prior):
    blocks, whole = prior.sample(20000, seed=0).flatten(1), prior.gaussian()
    scale = whole.covariance.diagonal().mean()
    assert (torch.cov(blocks.mT) - whole.covariance).abs().max() < 0.08 * scale
    assert (blocks.mean(0) - whole.mean.flatten()).abs().max() < 0.05 * scale.sqrt()


def test_the_whole_mixture_keeps_the_moments_of_the_examples(prior):
    plain = GaussianPrior.learn(dark_and_bright(), BLOCK[1:])
    whole = prior.gaussian()
    assert float(whole.mean.mean()) == pytest.approx(float(plain.mean.mean()), rel=0.1)
    assert float(whole.covariance.trace()) == pytest.approx(float(plain.covariance.trace()), rel=0.3)


def test_kinds_tell_dark_from_bright_far_better_than_one_gaussian(prior):
    dark = dark_and_bright()[1][:, :2, :6].flatten()

    def log_density(gaussian):
        return torch.distributions.MultivariateNormal(gaussian.mean.flatten(), gaussian.covariance).log_prob(dark)

    parts = [log_density(prior.component(k, g)) + prior.weights[k, g].log() for k in range(4) for g in range(3)]
    assert torch.stack(parts).logsumexp(0) > log_density(prior.gaussian()) + 5


def test_a_gaussian_is_a_mixture_of_one():
    plain = GaussianPrior.learn(dark_and_bright(), BLOCK[1:])
    one = GaussianMixturePrior.of(plain, rank=4)
    torch.testing.assert_close(one.component(0).covariance, plain.covariance)
    torch.testing.assert_close(one.gaussian().covariance, plain.covariance)


def test_impossible_settings_are_refused():
    for wrong in ({"kinds": 0}, {"samples": 20}):
        with pytest.raises(SettingError, match=next(iter(wrong))):
            GaussianMixturePrior.learn(dark_and_bright(), BLOCK[1:], **wrong)
