"""The Gaussian prior: its moments are those of the scenes."""

import math

import pytest
import torch
from torch.testing import assert_close

from tests.small_scenes import smooth_scene
from tmca.cameras import SpectralCamera
from tmca.errors import DataError, ShapeError
from tmca.operators.block_layout import BlockLayout
from tmca.operators.blocks import BlockModel
from tmca.priors import GaussianPrior
from tmca.priors.gaussian_posterior import GaussianSolver
from tmca.sensor import Noise

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


def test_smaller_blocks_are_parts_of_those_of_the_prior(prior):
    both = GaussianPrior(prior.mean, prior.displaced)
    dense = GaussianPrior(prior.mean, prior.covariance)
    kept = torch.zeros(prior.block, dtype=torch.bool)
    kept[:, :2, :4] = True
    expected = prior.covariance[kept.flatten()][:, kept.flatten()]
    for one in (prior, both, dense):
        smaller = one.cut(2, 4)
        assert smaller.block == (3, 2, 4)
        torch.testing.assert_close(smaller.covariance, expected)


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


def test_some_columns_of_rows_are_those_of_all(prior):
    pixels, columns = torch.tensor([[0, 7], [13, 20]]), slice(1, 3)
    rows = prior.rows(pixels, torch.float64)
    expected = rows.unflatten(-1, prior.block)[..., columns].flatten(-3)
    torch.testing.assert_close(prior.rows(pixels, torch.float64, columns), expected)
    dense = GaussianPrior(prior.mean, prior.covariance)
    torch.testing.assert_close(dense.rows(pixels, torch.float64, columns), expected)


def test_the_evidence_of_a_block_is_the_density_of_its_measurements(prior):
    camera = SpectralCamera(prior.block[0], (12, 14), 2, buckets=2, shutter="balanced", dispersion=1)
    noise, taps = Noise(0.05, 0.01), camera.taps()
    model = BlockModel.of(taps, prior.block)
    layout = BlockLayout.of(model, taps, (3, 3))
    posterior = GaussianSolver(prior, model, noise, torch.float64).posterior(
        layout.grid.code_windows(layout.code.double(), [(3, 3)]), 0
    )
    measured = torch.rand(4, model.measurements, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    density = torch.distributions.MultivariateNormal(posterior.expected[0], scale_tril=posterior.factor[0])
    assert_close(posterior.factor[0] @ posterior.factor[0].mT, dense_covariance(posterior, prior, noise))
    constant = model.measurements / 2 * math.log(2 * math.pi)
    assert_close(posterior.log_evidence(0, measured), density.log_prob(measured) + constant)


@pytest.mark.parametrize(("buckets", "size"), [(1, (12, 14)), (2, (11, 15))])
def test_covariances_with_pixels_need_no_rows(prior, monkeypatch, buckets, size):
    camera = SpectralCamera(prior.block[0], size, 2, buckets=buckets, shutter="balanced", dispersion=1)
    model = BlockModel.of(camera.taps(), prior.block)
    layout = BlockLayout.of(model, camera.taps(), (3, 3))
    windows = layout.grid.code_windows(layout.code.double(), layout.grid.positions[:3])
    noise = Noise(0.05, 0.01)
    by_rows, without = (GaussianSolver(prior, model, noise, torch.float64) for _ in range(2))
    expected = by_rows.posterior(windows)
    monkeypatch.setattr("tmca.priors.gaussian_posterior._MOST_ROW_BYTES", 0)
    monkeypatch.setattr("tmca.priors.gaussian_posterior._AT_ONCE", 5)
    found = without.posterior(windows)
    assert "rows" in vars(by_rows)
    assert "rows" not in vars(without)
    for name in ("cross", "factor", "cross_valid"):
        assert_close(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-12)


def test_estimates_of_many_snapshots_need_no_rows_where_these_take_too_much(prior, monkeypatch):
    camera = SpectralCamera(prior.block[0], (12, 14), 2, dispersion=1)
    solver = GaussianSolver(prior, BlockModel.of(camera.taps(), prior.block), Noise(0.05))
    code, many = camera.taps().code.detach(), 1e9
    assert not any(solver.by_displacement(code, many, variance) for variance in (False, True))
    monkeypatch.setattr("tmca.priors.gaussian_posterior._MOST_ROW_BYTES", 0)
    assert all(solver.by_displacement(code, many, variance) for variance in (False, True))


def dense_covariance(posterior, prior, noise):
    """A S Aᵀ and the noise of the first block, from the dense covariance."""
    n = prior.covariance.shape[0]
    matrix = posterior.solver.model.measure(posterior.weights, torch.eye(n, dtype=torch.float64)[:, None])[:, 0].mT
    variance = noise.read**2 + noise.shot * posterior.expected[0].clamp(min=0)
    return matrix @ prior.covariance @ matrix.mT + torch.diag(variance)
