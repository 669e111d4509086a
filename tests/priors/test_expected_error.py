"""The expected error of a code is the error that is then measured."""

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, smooth_scene, snapshot
from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors import BlockGrid, BlockModel, GaussianPrior, expected_mse, expected_psnr
from tmca.priors.posterior import GaussianSolver

BLOCK = (3, 2, 9)


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn([smooth_scene(60, 80, seed=1)], BLOCK[1:])


def measured_mse(prior, taps, blocks, read_noise, shot):
    """Mean squared error of the estimates of blocks (N, L, h, w), each seen through the same code."""
    model = BlockModel.of(taps, BLOCK)
    grid = BlockGrid(model, BLOCK[1:], (0,), (0,))
    y = noisy(snapshot(taps, blocks), read_noise, shot)[:, 0]
    posterior = GaussianSolver(prior, model, read_noise, shot, torch.float64).posterior(taps.code[None])
    error = posterior.estimate(0, grid.snapshot_windows(y, [(0, 0)])[0]).reshape(blocks.shape) - blocks
    first, last = model.judged
    return float(error[..., first:last].square().mean())


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("read_noise", "shot"), [(0.0, 0.0), (0.05, 0.0), (0.01, 0.01)])
def test_on_scenes_of_the_prior_the_measured_error_is_the_expected_one(prior, name, read_noise, shot):
    taps = camera(name, 2, 40, period=(2, 2))
    window = Taps(taps.code[:, :, :9], taps.channels, taps.offsets, 3, 9 + max(taps.offsets))
    measured = measured_mse(prior, window, prior.sample(4000, seed=2), read_noise, shot)
    model = BlockModel.of(taps, BLOCK)
    variance = GaussianSolver(prior, model, read_noise, shot).posterior(window.code[None]).error_variance()
    first, last = model.judged
    expected = float(variance.reshape(BLOCK)[..., first:last].mean())
    assert measured == pytest.approx(expected, rel=0.03)


def test_a_period_means_all_its_phases_and_random_places_agree_with_it(prior):
    taps = camera("single disperser", 8, 200, period=(2, 3))
    phases = expected_mse(prior, taps, 0.02, period=(2, 3))
    places = expected_mse(prior, taps, 0.02, blocks=600)
    assert float(places) == pytest.approx(float(phases), rel=0.05)
    assert expected_psnr(prior, taps, 0.02, period=(2, 3)) == pytest.approx(float(-10 * torch.log10(phases)))


def test_more_noise_makes_more_error(prior):
    taps = camera("single disperser", 4, 30)
    errors = [float(expected_mse(prior, taps, sigma)) for sigma in (0.0, 0.01, 0.1, 10.0)]
    assert errors == sorted(errors)
    assert errors[-1] == pytest.approx(float(prior.covariance.diagonal().mean()), rel=0.05)
    assert float(expected_mse(prior, taps, 0.01, 0.01)) > errors[1]


def test_more_light_is_less_noise(prior):
    taps = camera("single disperser", 4, 30)
    dim = expected_mse(prior.scaled(0.25), taps, 0.01, 0.0)
    torch.testing.assert_close(dim, expected_mse(prior, taps, 0.04, 0.0) / 16, rtol=1e-4, atol=0)
    with pytest.raises(SettingError, match="gain"):
        prior.scaled(0.0)


def test_expected_error_has_the_right_gradient(prior):
    taps = camera("single disperser", 2, 9)

    def error(code):
        return expected_mse(prior, Taps(code, taps.channels, taps.offsets, 3, 11), 0.05, 0.01, blocks=3) * 1e3

    assert torch.autograd.gradcheck(error, (taps.code.clone().requires_grad_(),), atol=1e-5)


def test_impossible_noise_or_no_blocks_are_refused(prior):
    taps = camera("single disperser", 4, 30)
    with pytest.raises(SettingError, match="read noise -1"):
        expected_mse(prior, taps, -1.0)
    with pytest.raises(SettingError, match="at least 1"):
        expected_mse(prior, taps, blocks=0)


def test_expected_error_agrees_on_real_training_patches_and_ranks_the_codes(real_data):
    from scipy.io import loadmat

    from tmca.data import read_split
    from tmca.priors.statistics import random_blocks

    bands = torch.linspace(0, 30, 4, dtype=torch.float64).round().long()

    def cube(path):
        found = loadmat(path)
        name = next(key for key in ("orig", "NRD") if key in found)
        full = 65535.0 if found[name].dtype == "uint16" else 255.0
        return torch.from_numpy(found[name].astype("float64") / full).permute(2, 0, 1)[bands, ::2, ::2]

    train = [cube(path) for path in read_split(real_data / "splits" / "spectral_train.txt")]
    block = (4, 4, 16)
    prior = GaussianPrior.learn(train, block[1:])
    seen = random_blocks(train, block[1:], 3000, 3, mirrored=False)
    unseen = random_blocks(
        [cube(path) for path in read_split(real_data / "splits" / "spectral_test.txt")], block[1:], 2000, 4, False
    )
    found = []
    for slots, one_hot in ((1, False), (8, False), (4, True)):
        taps = _multiplexed(slots, one_hot, *block)
        expected, errors = expected_mse_of_block(prior, taps, block), []
        for blocks in (seen, unseen):
            errors.append(block_error(prior, taps, blocks, block))
        assert abs(10 * torch.log10(torch.tensor(errors[0] / expected))) < 0.2
        found.append((expected, errors[1]))
    assert sorted(found, key=lambda pair: pair[0]) == sorted(found, key=lambda pair: pair[1])


def _multiplexed(slots, one_hot, bands, h, w):
    """One block's code under random apertures; the shutter is open (one slot), random or one-hot."""
    g = torch.Generator().manual_seed(0)
    aperture = torch.rand(slots, h, w, generator=g, dtype=torch.float64).round()
    shutter = torch.ones(1, h, w + bands, dtype=torch.float64)
    if one_hot:
        chosen = torch.randint(slots, (h, w + bands), generator=g)
        shutter = torch.nn.functional.one_hot(chosen, slots).permute(2, 0, 1).double()
    elif slots > 1:
        shutter = torch.rand(slots, h, w + bands, generator=g, dtype=torch.float64).round()
    code = torch.stack([(shutter[:, :, l : l + w] * aperture).mean(0) for l in range(bands)])
    return Taps(code, tuple(range(bands)), tuple(range(bands)), bands, w + bands - 1)


def expected_mse_of_block(prior, taps, block):
    model = BlockModel.of(taps, block)
    first, last = model.judged
    variance = GaussianSolver(prior, model, 0.0, 0.0).posterior(taps.code[None]).error_variance()
    return float(variance.reshape(block)[..., first:last].mean())


def block_error(prior, taps, blocks, block):
    model = BlockModel.of(taps, block)
    grid = BlockGrid(model, block[1:], (0,), (0,))
    posterior = GaussianSolver(prior, model, 0.0, 0.0).posterior(taps.code[None])
    y = snapshot(taps, blocks)[:, 0]
    error = posterior.estimate(0, grid.snapshot_windows(y, [(0, 0)])[0]).reshape(blocks.shape) - blocks
    first, last = model.judged
    return float(error[..., first:last].square().mean())
