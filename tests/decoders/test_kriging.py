"""Kriging against the textbook's equations, scikit-learn's Gaussian processes, and fields of known covariance."""

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist

from tmca.decoders.kriging import Covariance, Samples, fitted_covariance, krige

SCENE = Covariance(length=2.5, lifetime=7.0, changing=0.4, noise=0.02)


def scattered(count=41, seed=0, span=30):
    generator = torch.Generator().manual_seed(seed)
    grid = torch.cartesian_prod(torch.arange(9.0), torch.arange(8.0)).double()
    places = grid[torch.randperm(len(grid), generator=generator)[:count]]
    times = span * torch.rand(count, 1, generator=generator, dtype=torch.float64)
    return Samples(torch.cat([places, times], 1), torch.rand(count, generator=generator, dtype=torch.float64))


def matern(one, other, scale):
    far = np.sqrt(3) * cdist(one / np.asarray(scale), other / np.asarray(scale))
    return (1 + far) * np.exp(-far)


def covariances(one, other, of=SCENE):
    still = matern(one[:, :2], other[:, :2], [of.length] * 2)
    return (1 - of.changing) * still + of.changing * matern(one, other, [of.length, of.length, of.lifetime])


def ordinary_kriging(points, values, wanted, of=SCENE):
    """Mean and variance by the system with a Lagrange multiplier for the unknown level."""
    count = len(values)
    system = np.ones((count + 1, count + 1))
    system[:count, :count] = covariances(points, points, of) + of.noise * np.eye(count)
    system[count, count] = 0
    right = np.append(covariances(points, wanted[None], of)[:, 0], 1.0)
    weights = np.linalg.solve(system, right)
    return weights[:count] @ values, 1 - weights @ right


@pytest.mark.parametrize("count", [6, 41])
def test_every_place_and_time_is_the_solution_of_the_kriging_system(count):
    samples = scattered(count)
    places = torch.tensor([[3.0, 4.0], [0.0, 7.0], [2.5, 9.25]], dtype=torch.float64)
    times = torch.tensor([0.0, 12.5], dtype=torch.float64)
    found = krige(samples, places, times, SCENE, neighbours=count)
    for t, time in enumerate(times):
        for p, place in enumerate(places):
            wanted = np.append(place.numpy(), float(time))
            mean, variance = ordinary_kriging(samples.points.numpy(), samples.values.numpy(), wanted)
            np.testing.assert_allclose([found.mean[t, p], found.variance[t, p]], [mean, variance], rtol=1e-9)


def test_what_is_left_out_is_what_the_others_say():
    samples = scattered(25)
    found = krige(samples, samples.points[:, :2], samples.points[:1, 2], SCENE, neighbours=25)
    for left in (0, 7, 24):
        others = np.delete(np.arange(25), left)
        points, values = samples.points.numpy(), samples.values.numpy()
        mean, variance = ordinary_kriging(points[others], values[others], points[left])
        np.testing.assert_allclose(found.residual[left], values[left] - mean, rtol=1e-8)
        np.testing.assert_allclose(found.predicted[left], variance + SCENE.noise, rtol=1e-8)


def test_a_place_without_a_sample_leaves_none_out():
    samples = scattered(20)
    found = krige(samples, torch.tensor([[0.5, 0.5]], dtype=torch.float64), samples.points[:1, 2], SCENE)
    assert bool(found.residual.isnan().all())
    assert bool(found.mean.isfinite().all())


def drawn(scene, size=(24, 25), slots=16, seed=0):
    """Samples of one field of this covariance, one at a random time of every pixel, with noise."""
    rng = np.random.default_rng(seed)
    points = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1]), indexing="ij"), -1).reshape(-1, 2)
    points = np.column_stack([points, rng.integers(slots, size=len(points))]).astype(float)
    later = points + np.array([0, 0, 5.0])
    both = np.concatenate([points, later])
    field = np.linalg.cholesky(covariances(both, both, scene) + 1e-9 * np.eye(len(both))) @ rng.standard_normal(
        len(both)
    )
    noisy = 3.0 + field[: len(points)] + np.sqrt(scene.noise) * rng.standard_normal(len(points))
    return Samples(torch.from_numpy(points), torch.from_numpy(noisy)), 3.0 + field[len(points) :]


def test_errors_are_as_large_as_predicted():
    scene = Covariance(3.0, 8.0, 0.5, 0.01)
    samples, later = drawn(scene)
    times = torch.arange(21, dtype=torch.float64)
    found = krige(samples, samples.points[:, :2], times, scene)
    which = (samples.points[:, 2] + 5).long()[None]
    error = found.mean.gather(0, which)[0] - torch.from_numpy(later)
    assert float((error**2 / found.variance.gather(0, which)[0]).mean()) == pytest.approx(1, abs=0.15)
    assert float((found.residual**2 / found.predicted).mean()) == pytest.approx(1, abs=0.15)


def test_the_covariance_that_is_found_predicts_as_well_as_the_true_one():
    scene = Covariance(3.0, 4.0, 0.3, 0.01)
    samples, _ = drawn(scene, seed=1)
    places = samples.points[:, :2]
    error = {
        name: float(krige(samples, places, samples.points[:1, 2], one).residual.square().mean())
        for name, one in (("found", fitted_covariance(samples, 16, shown=200)), ("true", scene))
    }
    assert error["found"] < 1.05 * error["true"]
    fixed = fitted_covariance(samples, 16, shown=30, changing=1.0, lifetime=2.0)
    assert (fixed.changing, fixed.lifetime) == (1.0, 2.0)
