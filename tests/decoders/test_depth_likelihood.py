"""Patch likelihood: against scipy's Gaussian and the explicit LMMSE, and on scenes of known depth."""

from dataclasses import replace

import pytest
import torch
from scipy.stats import multivariate_normal

from tests.priors.test_spectral_depth import BENCH, camera, matrix, parts, prior_of
from tmca.cameras import SpectralDepthCamera
from tmca.decoders.depth_likelihood import PatchLikelihood
from tmca.errors import SettingError, ShapeError
from tmca.optics import PhaseMaskBench
from tmca.priors import GaussianPrior
from tmca.priors.spectral_depth import needed_block
from tmca.sensor import Sensor


def one_window(window=4):
    """A camera whose sensor is one window, its prior, and its matrix at every plane."""
    wide = camera(window, sensor=Sensor(read_noise=0.02))
    prior = prior_of(needed_block(window, BENCH.window))
    _, _, _, colour, shutter = parts(wide, 2)
    rows = [matrix(wide, window, plane, colour, shutter) for plane in range(3)]
    return camera(window, sensor=Sensor(read_noise=0.02), size=(window, window)), prior, rows


def test_one_window_is_scipys_gaussian_and_the_explicit_lmmse():
    made, prior, rows = one_window()
    mean = prior.mean.flatten()
    second = prior.covariance + torch.outer(mean, mean)
    source = torch.Generator().manual_seed(1)
    scene = mean + torch.linalg.cholesky(prior.covariance) @ torch.randn(len(mean), generator=source).double()
    snapshot = rows[2] @ scene + 0.02 * torch.randn(len(rows[2]), generator=source)
    found = PatchLikelihood(prior, made, 4, gains=[1.0])(snapshot.reshape(1, 3, 4, 4))
    covariances = [A @ second @ A.T + (0.02**2 + 1e-9) * torch.eye(len(A)) for A in rows]
    own = torch.tensor([multivariate_normal.logpdf(snapshot, cov=c) for c in covariances])
    level = found.planes[0, :, 0, 0]
    torch.testing.assert_close(level - level[0], own - own[0], rtol=1e-5, atol=1e-5)
    best = int(own.argmax())
    estimate = (second @ rows[best].T @ torch.linalg.solve(covariances[best], snapshot)).reshape(wide_shape(4))
    inside = estimate[:, 2:6, 3:7].clamp_min(0)
    torch.testing.assert_close(found.estimate[0], inside, atol=1e-6, rtol=1e-5)


def wide_shape(window):
    return (2, *needed_block(window, BENCH.window))


@pytest.mark.parametrize("size", [(30, 37), (32, 36)])
def test_a_textured_wall_is_found_at_its_depth_brighter_or_darker(size):
    bench = PhaseMaskBench(window=(13, 13), mask_pixels=32)
    made = SpectralDepthCamera((500e-9, 600e-9), size, 4, planes=4, bench=bench, shutter="one-hot", rms=0.15e-6,
                               sensor=Sensor(read_noise=1e-4))  # fmt: skip
    source = torch.Generator().manual_seed(0)
    cubes = [torch.rand(2, 60, 60, generator=source) for _ in range(3)]
    decoder = PatchLikelihood(GaussianPrior.learn(cubes, needed_block(8, (13, 13))), made, 8)
    for plane, brightness in ((0, 1.0), (3, 0.2)):
        depth = torch.full((1, 1, *size), float(made.planes.metres[plane]))
        scene = brightness * torch.rand(1, 2, *size, generator=source)
        found = decoder(made(scene, depth, 0))
        inside = (slice(None), slice(None), slice(8, -8), slice(8, -8))
        right = (found.planes.argmax(1, keepdim=True)[inside] == plane).double().mean()
        assert float(right) > 0.8  # one plane in four by chance
        assert float((1 / found.depth[inside] - 1 / depth[inside]).abs().mean()) < made.planes.step / 2
        assert float(found.confidence.min()) >= 0
        assert float((found.estimate - scene)[inside].square().mean()) < float(scene[inside].var())


def test_what_does_not_fit_is_refused():
    made, prior, _ = one_window()
    with pytest.raises(SettingError, match="window"):
        PatchLikelihood(prior, made, 5)
    with pytest.raises(SettingError, match="480 nm"):
        PatchLikelihood(replace(prior, wavelengths=(480e-9, 600e-9)), made, 4)
    with pytest.raises(ShapeError, match="snapshot"):
        PatchLikelihood(prior, made, 4)(torch.zeros(1, 1, 4, 4))
    with pytest.raises(ShapeError, match="larger blocks"):
        PatchLikelihood(prior_of((6, 6)), made, 4)(torch.zeros(1, *made.snapshot_shape))
