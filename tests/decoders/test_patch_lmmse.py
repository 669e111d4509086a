"""The patch LMMSE decoder is the textbook estimate, for every camera, size and noise."""

from dataclasses import replace

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, matrix, noisy, patches, smooth_scene, snapshot, textbook
from tmca.priors import BlockModel, GaussianPrior

WIDE = GaussianPrior.learn([smooth_scene(60, 80, seed=1)], (4, 46))


def narrower(h, w):
    """The same stationary prior of smaller blocks."""
    return GaussianPrior(WIDE.mean[:, :h, :w], WIDE.moments[:, :, :h, :w])


def dense(taps, snapshots, read_noise, shot=0.0):
    """Estimate and variance of whole images, from the marginal of a prior at least as large as they are."""
    height, width = taps.code.shape[1:]
    marginal = GaussianPrior(WIDE.mean[:, :height, :width], WIDE.moments[:, :, :height, :width])
    estimate, error = textbook(marginal, matrix(taps), snapshots.flatten(1), read_noise, shot)
    return estimate.reshape(-1, *taps.scene_shape), error.diagonal().reshape(taps.scene_shape)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("read_noise", "shot"), [(0.0, 0.0), (0.05, 0.0), (0.02, 0.01)])
@pytest.mark.parametrize("smaller", [0, 1])
def test_one_block_image_is_the_dense_estimate_with_all_its_borders(name, read_noise, shot, smaller):
    model = BlockModel.of(camera(name, 4, 12), (3, 4, 12))
    first, last = model.valid
    size = (4 - smaller, last - first - smaller * (last - first > 1))
    taps = camera(name, *size)
    y = noisy(snapshot(taps, smooth_scene(*size, seed=4)[None]), read_noise, shot)
    found = patches(narrower(4, 12), dtype=torch.float64)(y, taps, read_noise, shot, uncertainty=True)
    estimate, variance = dense(taps, y, read_noise, shot)
    torch.testing.assert_close(found.estimate, estimate, atol=2e-6, rtol=1e-7)
    torch.testing.assert_close(found.deviation[0].square(), variance, atol=1e-8, rtol=1e-7)


@pytest.mark.parametrize("name", CAMERAS)
def test_light_of_neighbours_is_never_taken_for_the_blocks_own(name):
    taps = camera(name, 4, 46, seed=2)
    scenes = WIDE.sample(300, seed=3)
    y = noisy(snapshot(taps, scenes), 0.05, 0.0)
    found = patches(narrower(4, 14))(y, taps, 0.05, uncertainty=True)
    error = (found.estimate - scenes).square().mean((0, 1, 2))
    claimed = found.deviation.square().mean((0, 1, 2))
    # every column, at block borders too, errs no more than it says; light taken for dark would err many times more
    assert (error < 1.25 * claimed).all()
    assert error.mean() > 0.6 * claimed.mean()
    assert error.mean() < 1.2 * (dense(taps, y, 0.05)[0] - scenes).square().mean()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("size", [(7, 23), (8, 30), (3, 5), (1, 1)])
def test_any_size_and_precision(size, dtype):
    taps = camera("single disperser", *size, dtype=dtype)
    scene = smooth_scene(*size, seed=5)[None].to(dtype) if min(size) > 1 else torch.full((1, 3, 1, 1), 0.5, dtype=dtype)
    found = patches(narrower(4, 12))(noisy(snapshot(taps, scene), 0.01, 0.0), taps, 0.01, uncertainty=True)
    assert found.estimate.shape == found.deviation.shape == scene.shape
    assert torch.isfinite(found.estimate).all()
    assert (found.estimate - scene).square().mean() < WIDE.covariance.diagonal().mean()


def test_tiled_codes_give_what_every_block_alone_gives(monkeypatch):
    taps = camera("single disperser", 9, 40, period=(3, 4))
    y = noisy(snapshot(taps, torch.stack([smooth_scene(9, 40, seed=s) for s in (5, 6)])), 0.02, 0.0)
    decoder = patches(narrower(4, 12), stride=(3, 4), dtype=torch.float64)
    shared = decoder(y, taps, 0.02, uncertainty=True)
    monkeypatch.setattr(
        "tmca.operators.block_layout.equal_windows",
        lambda grid, code, places=None: [[p] for p in grid.positions],
    )
    alone = decoder(y, taps, 0.02, uncertainty=True)
    torch.testing.assert_close(shared.estimate, alone.estimate, atol=1e-9, rtol=0)
    torch.testing.assert_close(shared.deviation, alone.deviation, atol=1e-9, rtol=0)


@pytest.mark.parametrize(("period", "stride"), [(None, (3, 8)), ((3, 4), (3, 8)), ((2, 6), (2, 6)), ((1, 1), (3, 8))])
def test_blocks_step_by_what_fits_the_tile_of_the_code(period, stride):
    taps = camera("single disperser", 12, 33, period=period)
    y = noisy(snapshot(taps, smooth_scene(12, 33, seed=7)[None]), 0.02, 0.0)
    prior = narrower(4, 12)
    found, expected = patches(prior)(y, taps, 0.02), patches(prior, stride=stride)(y, taps, 0.02)
    torch.testing.assert_close(found.estimate, expected.estimate, atol=0, rtol=0)


def test_uncertainty_is_calibrated_on_scenes_of_the_prior():
    taps = camera("single disperser", 4, 12)
    prior = narrower(4, 16)
    first, last = BlockModel.of(taps, prior.block).valid
    assert last - first == 12
    scenes = prior.sample(500, seed=1)[..., first:last]
    found = patches(prior)(noisy(snapshot(taps, scenes), 0.05, 0.002), taps, 0.05, 0.002, uncertainty=True)
    z = (found.estimate - scenes) / found.deviation
    assert float(z.square().mean()) == pytest.approx(1, abs=0.03)
    assert float(z.mean()) == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("shot", [0.0, 0.01])
def test_its_derivative_by_code_and_snapshot_is_exact_on_one_block(name, shot):
    model = BlockModel.of(camera(name, 4, 12), (3, 4, 12))
    taps = camera(name, 4, model.valid[1] - model.valid[0])
    code = (0.1 + 0.8 * taps.code.double()).requires_grad_()
    y = snapshot(taps, smooth_scene(*taps.scene_shape[1:], seed=4)[None]).double().requires_grad_()
    decoder = patches(narrower(4, 12), dtype=torch.float64)

    def estimate(code, y):
        return decoder(y, replace(taps, code=code), 0.05, shot, differentiable=True).estimate

    assert torch.autograd.gradcheck(estimate, (code, y), fast_mode=True, rtol=1e-4, atol=1e-6)
