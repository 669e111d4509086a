"""The Gaussian prior: its moments are those of the scenes."""

import pytest
import torch

from tests.small_scenes import smooth_scene
from tmca.errors import DataError, ShapeError
from tmca.priors import GaussianPrior

CUBES = [smooth_scene(24, 31, seed=1), smooth_scene(20, 26, seed=2)]


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn(CUBES, (3, 7))


def test_autocovariance_is_the_mean_over_all_pairs_of_the_mirrored_torus():
    cube = smooth_scene(6, 5, seed=3)
    learned = GaussianPrior.learn([cube], (3, 4), floor=0.0)
    torus = torch.cat([cube, cube.flip(-1)], -1)
    torus = torch.cat([torus, torus.flip(-2)], -2) - cube.mean((1, 2))[:, None, None]
    for dy, dx in ((0, 0), (2, 0), (0, 3), (2, 3)):
        moved = torus.roll((-dy, -dx), (1, 2))
        expected = torch.einsum("ayx,byx->ab", torus, moved) / torus[0].numel()
        torch.testing.assert_close(learned.moments[:, :, dy, dx], (expected + expected.mT) / 2)


def test_covariance_depends_on_distance_and_is_positive(prior):
    full = prior.covariance.reshape(*prior.block, *prior.block)
    torch.testing.assert_close(full[0, 0, 1, 2, 2, 5], full[0, 2, 5, 2, 0, 1])
    torch.testing.assert_close(full[1, 2, 6, 0, 0, 0], prior.moments[1, 0, 2, 6])
    assert torch.linalg.eigvalsh(prior.covariance).min() > 0


def test_samples_have_the_moments_of_the_prior(prior):
    blocks = prior.sample(40000, seed=0)
    scale = prior.covariance.diagonal().mean()
    assert (torch.cov(blocks.flatten(1).mT) - prior.covariance).abs().max() < 0.05 * scale
    assert (blocks.mean(0) - prior.mean).abs().max() < 0.05 * scale.sqrt()


@pytest.mark.parametrize(
    ("cubes", "block", "error", "where"),
    [
        (CUBES, (22, 7), ShapeError, "cube 1"),
        ([], (2, 2), ShapeError, "cubes"),
        ([CUBES[0], CUBES[1][:2]], (2, 2), ShapeError, "cube 1"),
        ([torch.full((3, 9, 9), torch.nan)], (2, 2), DataError, "cube 0"),
    ],
)
def test_impossible_cubes_are_refused(cubes, block, error, where):
    with pytest.raises(error) as caught:
        GaussianPrior.learn(cubes, block)
    assert caught.value.where == where


@pytest.mark.parametrize("sides", [(), (3,), (2, 3, 1, 4)])
def test_a_mean_that_is_of_no_block_is_refused(sides):
    mean = torch.ones(sides).double()
    with pytest.raises(ShapeError, match=r"prior: found shape \(.*\), expected \(L, h, w\)"):
        GaussianPrior(mean, torch.eye(mean.numel()).double())
