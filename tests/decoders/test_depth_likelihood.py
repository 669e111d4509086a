"""Patch likelihood: against scipy's Gaussian and the explicit LMMSE, and on scenes of known depth; depth from the
probability of planes, against sums over a fine grid of depths."""

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from tests.operators.test_window_moments import BENCH, camera, matrix, parts, prior_of
from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.decoders import PatchLikelihood, decode, make_decoder
from tmca.decoders.likelihood import DepthPosterior
from tmca.errors import SettingError
from tmca.operators.window_moments import needed_block
from tmca.optics import DepthPlanes, PhaseMaskBench
from tmca.priors import GaussianPrior
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
    found = PatchLikelihood(prior, made, 4, gains=[1.0], temperature=1.0, contamination=0.0)(
        snapshot.reshape(1, 3, 4, 4)
    )
    covariances = [A @ second @ A.T + (0.02**2 + 1e-9) * torch.eye(len(A)) for A in rows]
    own = torch.tensor([multivariate_normal.logpdf(snapshot, cov=c) for c in covariances])
    level = found.planes[0, :, 0, 0]
    torch.testing.assert_close(level - level[0], own - own[0], rtol=1e-5, atol=1e-5)
    every = [second @ A.T @ torch.linalg.solve(c, snapshot) for A, c in zip(rows, covariances, strict=True)]
    shares = likely(own.softmax(0))
    assert (shares > 0).sum() > 1
    estimate = sum(share * one for share, one in zip(shares, every, strict=True)).reshape(wide_shape(4))
    inside = estimate[:, 2:6, 3:7].clamp_min(0)
    torch.testing.assert_close(found.values[0], inside, atol=1e-6, rtol=1e-5)


def likely(shares):
    """Without the planes that have less than a twentieth of the likeliest one's probability."""
    kept = shares * (shares >= shares.amax(-1, keepdim=True) / 20)
    return kept / kept.sum(-1, keepdim=True)


def wide_shape(window):
    return (2, *needed_block(window, BENCH.window))


@pytest.mark.parametrize("size", [(30, 37), (32, 36)])
def test_a_textured_wall_is_found_at_its_depth_brighter_or_darker(size):
    bench = PhaseMaskBench(window=(13, 13), mask_pixels=32)
    made = SpectralDepthCamera((500e-9, 600e-9), size, 4, planes=4, bench=bench, shutter="one-hot", rms=0.15e-6,
                               sensor=Sensor(read_noise=1e-4))  # fmt: skip
    source = torch.Generator().manual_seed(0)
    cubes = [torch.rand(2, 60, 60, generator=source) for _ in range(3)]
    prior = GaussianPrior.learn(cubes, needed_block(8, (13, 13)))
    decoder = PatchLikelihood(
        prior, made, 8, temperature=1.0, reach=0, contamination=0.0
    )  # scenes are what the prior says
    for plane, brightness in ((0, 1.0), (3, 0.2)):
        depth = torch.full((1, 1, *size), float(made.planes.metres[plane]))
        scene = brightness * torch.rand(1, 2, *size, generator=source)
        found = decoder(made(scene, depth, generator=0))
        inside = (slice(None), slice(None), slice(8, -8), slice(8, -8))
        right = (found.planes.argmax(1, keepdim=True)[inside] == plane).double().mean()
        assert float(right) > 0.8  # one plane in four by chance
        assert float((1 / found.depth[inside] - 1 / depth[inside]).abs().mean()) < made.planes.step / 2
        assert float(found.confidence.min()) >= 0
        assert float((found.values - scene)[inside].square().mean()) < float(scene[inside].var())


def textured(size, sensor, dtype=torch.float32, reach=4):
    """A decoder of small windows, and noisy snapshots of two scenes whose depth changes from pixel to pixel."""
    bench = PhaseMaskBench(window=(7, 9), mask_pixels=24, diameter=1e-3)
    made = SpectralDepthCamera((500e-9, 600e-9), size, 3, planes=3, bench=bench, shutter="one-hot", rms=0.15e-6,
                               channels="rgb", filters="gaussian", period=3, sensor=sensor)  # fmt: skip
    source = torch.Generator().manual_seed(3)
    cubes = [torch.rand(2, 40, 40, generator=source).cumsum(-1) / 20 for _ in range(2)]
    depth = 1 / (0.5 + 2 * torch.rand(2, 1, *size, generator=source))
    taken = made(torch.rand(2, 2, *size, generator=source), depth, generator=0).to(dtype)
    prior = GaussianPrior.learn(cubes, needed_block(5, (7, 9)))
    return PatchLikelihood(prior, made, 5, temperature=3.0, reach=reach), taken


def laid_over_each_other(decoder, size, values, reach=0):
    """Slow: every window by itself, weights over its pixels and those it reaches, divided by their sum."""
    m, step = decoder.window, decoder.camera.tile_size
    ramp = torch.sin(torch.pi * (torch.arange(m + 2 * reach).double() + 0.5) / (m + 2 * reach)) ** 4
    total, weight = 0, torch.zeros(size, dtype=torch.float64)
    for top in sorted({*range(0, size[0] - m + 1, step), size[0] - m}):
        for left in sorted({*range(0, size[1] - m + 1, step), size[1] - m}):
            own = values((top % step, left % step), top, left)
            wide = torch.zeros(size[0] + 2 * reach, size[1] + 2 * reach, dtype=torch.float64)
            wide[top : top + m + 2 * reach, left : left + m + 2 * reach] = torch.outer(ramp, ramp)
            share = wide[reach : reach + size[0], reach : reach + size[1]]
            laid = torch.zeros(*own.shape[:-2], *size, dtype=torch.float64) + (own if own.shape[-1] == 1 else 0)
            if own.shape[-1] > 1:
                laid[..., top : top + m, left : left + m] = own
            total, weight = total + laid * share, weight + share
    return total / weight


@pytest.mark.parametrize("size", [(11, 14), (12, 17), (5, 5)])
@pytest.mark.parametrize("reach", [0, 1, 7])
@pytest.mark.parametrize("sensor", [Sensor(read_noise=1e-3), Sensor(full_well=2000)])
def test_a_frame_row_by_row_is_every_window_by_itself(size, sensor, reach):
    decoder, taken = textured(size, sensor, torch.float64, reach)
    found, m = decoder(taken), decoder.window

    def likelihood(phase, top, left):
        windows = taken[..., top : top + m, left : left + m].flatten(1)
        return decoder._log_likelihood(phase, windows)[0][..., None, None] / 3

    def spectrum(phase, top, left):
        windows = taken[..., top : top + m, left : left + m].flatten(1)
        shares = likely(found.planes[:, :, top + m // 2, left + m // 2].softmax(1))
        gains, total = decoder._log_likelihood(phase, windows)[1], 0
        for plane, share in enumerate(shares.T):
            sure = torch.zeros_like(shares)
            sure[:, plane] = 1
            total = total + share[:, None, None, None] * decoder._scene(phase, windows, sure, gains)
        return total

    torch.testing.assert_close(found.planes, laid_over_each_other(decoder, size, likelihood, reach))
    slow = laid_over_each_other(decoder, size, spectrum).clamp_min(0)
    torch.testing.assert_close(found.values, slow, atol=1e-9, rtol=1e-9)
    assert decoder(taken, planes=False).planes is None
    depth_alone = decoder(taken, spectrum=False)
    assert depth_alone.values.numel() == 0
    torch.testing.assert_close(depth_alone.depth, found.depth)


@pytest.mark.parametrize("sensor", [Sensor(read_noise=1e-3), Sensor(full_well=2000)])
def test_how_much_is_worked_on_together_changes_nothing(sensor, monkeypatch):
    decoder, taken = textured((26, 31), sensor)
    found = []
    for together in (1, 25, 2048):
        monkeypatch.setattr("tmca.operators.windows._BATCH", together)
        found.append(decoder(taken))
        alone = decoder(taken[1:])
        torch.testing.assert_close(alone.depth, found[-1].depth[1:], atol=1e-6, rtol=1e-6)
    for other in found[1:]:
        for name in ("values", "depth", "confidence", "planes"):
            torch.testing.assert_close(getattr(other, name), getattr(found[0], name), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("size", [(26, 31), (27, 30), (5, 5)])
@pytest.mark.parametrize("sensor", [Sensor(read_noise=3e-3), Sensor(full_well=2000)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_prepared_for_many_frames_it_finds_the_same_in_fewer_axes(size, sensor, dtype):
    decoder, taken = textured(size, sensor, dtype)
    exact, windows = decoder(taken), 3 * decoder.window**2
    found = decoder.precompute()(taken)
    assert all(basis.axes.shape[1] < windows for basis in decoder._bases.values())
    assert decoder.precompute() is decoder
    assert found.values.dtype == dtype
    torch.testing.assert_close(found.values, exact.values, atol=6e-3, rtol=0)  # a scene unlike the prior
    torch.testing.assert_close(1 / found.depth, 1 / exact.depth, atol=5e-3, rtol=0)
    torch.testing.assert_close(found.planes.softmax(1), exact.planes.softmax(1), atol=2e-3, rtol=0)
    alone = decoder(taken, spectrum=False, planes=False)
    assert torch.equal(alone.depth, found.depth)


def test_without_noise_a_prepared_frame_is_exact():
    decoder, taken = textured((11, 14), Sensor())
    exact, found = decoder(taken), decoder.precompute()(taken)
    assert torch.equal(exact.values, found.values)
    assert torch.equal(exact.depth, found.depth)


def test_a_prepared_decoder_has_computed_its_bases():
    decoder, taken = textured((11, 14), Sensor(read_noise=3e-3))
    maker = make_decoder("likelihood", "spectral-depth", {"window": 5})
    prepared = maker.prepare(decoder.camera, decoder.prior)
    assert prepared.state._spectra is not None
    (estimate,) = prepared.stream([taken[:1]])
    known = decode(Snapshot(taken[:1], decoder.camera), "likelihood", prior=decoder.prior, window=5)
    torch.testing.assert_close(estimate.values, known.values, atol=6e-3, rtol=0)
    with pytest.raises(SettingError, match="nothing to store"):
        maker.prepare(decoder.camera, decoder.prior, bank="bank")


@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_the_median_halves_the_probability_and_has_least_expected_error(count):
    planes = DepthPlanes(0.4, 2.0, count)
    log_probability = 2 * torch.randn(
        2, count, 3, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(count)
    )
    found, inverse = DepthPosterior.of(log_probability + 7, planes), planes.inverse.numpy()
    parts = 4000
    within = (np.arange(parts) + 0.5) / parts - 0.5
    for sample, row, column in np.ndindex(2, 3, 4):
        shares = log_probability[sample, :, row, column].softmax(0).numpy()
        fine = (inverse[:, None] + within * planes.step).clip(inverse[0], inverse[-1]).ravel()
        weights = np.repeat(shares / parts, parts)
        errors = [(weights * np.abs(fine - guess)).sum() for guess in fine[::50]]
        own = (weights * np.abs(fine - 1 / float(found.metres[sample, 0, row, column]))).sum()
        assert own <= min(errors) + 1e-4
        plane = int(found.plane[sample, 0, row, column])
        assert plane == np.searchsorted(shares.cumsum(), 0.5)
        near = shares[max(0, plane - 1) : plane + 2].sum()
        assert float(found.confidence[sample, 0, row, column]) == pytest.approx(near)


def test_a_sure_plane_is_its_depth_and_two_equal_ones_what_lies_between():
    planes = DepthPlanes(0.5, float("inf"), 5)
    sure = torch.full((1, 5, 1, 1), -60.0)
    sure[:, 3] = 0
    assert float(DepthPosterior.of(sure, planes).metres) == pytest.approx(1 / 1.5)
    sure[:, 2] = 0
    assert float(DepthPosterior.of(sure, planes).metres) == pytest.approx(1 / 1.25)
    assert float(DepthPosterior.of(torch.zeros(1, 5, 1, 1), planes).metres) == pytest.approx(1.0)
    far = torch.tensor([0.0, -9, -60, -60, -60])[None, :, None, None]
    assert float(DepthPosterior.of(far, planes).metres) > 100
