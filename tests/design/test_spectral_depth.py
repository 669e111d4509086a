"""Distances between depths against sampling and special cases, information about depth against distances and a fine
grid of depths, slopes against finite differences; masks that are searched."""

import pytest
import torch
from scipy.stats import multivariate_normal

from tests.operators.test_window_moments import BENCH, camera, matrix, parts, prior_of
from tmca.design.spectral_depth import (
    bhattacharyya,
    confusion,
    depth_information,
    design_masks,
    fisher_information,
    kullback_leibler,
    predict_windows,
    window_covariance,
)
from tmca.errors import SettingError
from tmca.operators.window_moments import needed_block
from tmca.sensor import Sensor

NOISE = Sensor(read_noise=0.02)
DEPTH = (0.5, 2.0)


def made(**changes):
    return camera(4, sensor=NOISE, **{"depth": DEPTH, "seed": 3, **changes})


PRIOR = prior_of(needed_block(4, BENCH.window))


def gaussians(count=3, n=4, seed=0):
    source = torch.Generator().manual_seed(seed)
    parts = torch.randn(count, n, n + 2, generator=source, dtype=torch.float64)
    return parts @ parts.mT / n + 0.1 * torch.eye(n, dtype=torch.float64)


def test_distances_are_the_expectations_they_stand_for():
    covariance = gaussians()
    samples = [multivariate_normal(cov=c.numpy(), seed=7) for c in covariance]
    found, distance = kullback_leibler(covariance), bhattacharyya(covariance)
    for d, own in enumerate(samples):
        drawn = own.rvs(200_000)
        for e, other in enumerate(samples):
            ratio = torch.from_numpy(other.logpdf(drawn) - own.logpdf(drawn))
            assert float(found[d, e]) == pytest.approx(-float(ratio.mean()), rel=0.02, abs=0.01)
            assert float(distance[d, e]) == pytest.approx(-float((ratio / 2).exp().mean().log()), abs=0.02)


def test_confusion_bounds_the_error_of_the_most_likely_plane():
    covariance = torch.stack([(1 + d) * gaussians(1)[0] for d in range(3)])
    samples = [multivariate_normal(cov=c.numpy(), seed=3) for c in covariance]
    errors = []
    for d, own in enumerate(samples):
        drawn = own.rvs(20_000)
        likelihood = torch.stack([torch.from_numpy(other.logpdf(drawn)) for other in samples])
        errors.append((likelihood.argmax(0) - d).abs().double().mean())
    assert float(sum(errors) / 3) <= float(confusion(covariance))
    same = gaussians(1).expand(3, -1, -1)
    assert float(confusion(same)) == pytest.approx(0.5 * (3 + 2 + 3) / 3)


def test_noise_of_the_sensor_is_in_the_covariance():
    clean, noisy, shot = (
        window_covariance(camera(4, sensor=sensor), PRIOR, 4)
        for sensor in (Sensor(), Sensor(read_noise=0.1), Sensor(full_well=1000))
    )
    added = (noisy - clean).diagonal(dim1=-2, dim2=-1)
    torch.testing.assert_close(added, torch.full_like(added, 0.01))
    assert float((shot - clean).diagonal(dim1=-2, dim2=-1).min()) > 0


@pytest.mark.parametrize("window", [3, 4])
def test_the_predicted_spectral_error_is_that_of_the_explicit_lmmse(window):
    sensor, prior = Sensor(read_noise=0.05), prior_of(needed_block(window, BENCH.window))
    wide = camera(window, sensor=sensor)
    _, _, _, colour, shutter = parts(wide, 2)
    mean = prior.mean.flatten()
    second = prior.covariance + torch.outer(mean, mean)
    found = predict_windows(wide, prior, window, contamination=0)
    torch.testing.assert_close(found.covariance, window_covariance(wide, prior, window, contamination=0))
    middle = torch.zeros(2, *prior.block[1:], dtype=torch.bool)
    top, left = ((side - 1) // 2 for side in BENCH.window)
    middle[:, top : top + window, left : left + window] = True
    for plane, error in enumerate(found.spectral_error):
        A = matrix(wide, window, plane, colour, shutter)
        seen = A @ second @ A.T + (0.05**2 + 1e-9) * torch.eye(len(A))
        left_over = second - second @ A.T @ torch.linalg.solve(seen, A @ second)
        assert float(error) == pytest.approx(float(left_over.diagonal()[middle.flatten()].mean()), rel=1e-6)


def test_searched_masks_confuse_depths_less_and_the_best_is_kept():
    masks = camera(4, learnable="mask", sensor=Sensor(read_noise=0.01))
    found = design_masks(masks, PRIOR, window=4, steps=20, rate=0.02)
    left = float(confusion(window_covariance(masks, PRIOR, 4)).detach())
    assert left == pytest.approx(min(found.confusion), rel=1e-5)
    assert left < found.confusion[0] * 0.99


def test_what_cannot_be_searched_is_refused():
    with pytest.raises(SettingError, match="learnable"):
        design_masks(camera(4), PRIOR, window=4)


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
    found = depth_information(wide, PRIOR, 4, contamination=0)
    assert found.shape == (planes,)
    for plane, inverse in enumerate(wide.planes.inverse.tolist()):
        near = wide.planes.step / 50
        close = made(planes=3, depth=(1 / (inverse + near), 1 / (inverse - near)))
        distance = kullback_leibler(window_covariance(close, PRIOR, 4, contamination=0))[1]
        expected = (distance[0] + distance[2]) / near**2
        assert float(found[plane]) == pytest.approx(float(expected), rel=5e-3)


def test_what_is_expected_of_other_planes_does_not_move():
    wide = made(planes=4)
    own = window_covariance(wide, PRIOR, 4, contamination=0)
    mixed = window_covariance(wide, PRIOR, 4, contamination=0.3)
    assert not torch.allclose(own, mixed)
    clean, blurred = (depth_information(wide, PRIOR, 4, contamination=share) for share in (0.0, 0.3))
    assert bool((blurred < clean).all())


@pytest.mark.parametrize("figure", ["confusion", "information"])
def test_gradients_reach_the_heights_of_the_mask(figure):
    own = made(planes=3, learnable="mask")
    heights = own.point_spread.heights
    values = next(p for p in heights.parameters() if p.requires_grad)

    def value():
        if figure == "confusion":
            return confusion(window_covariance(own, PRIOR, 4))
        return depth_information(own, PRIOR, 4).log().mean()

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
