"""The expected error of a code is the error that is then measured."""

import numpy as np
import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, smooth_scene, snapshot
from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors import BlockGrid, BlockModel, GaussianPrior, expected_mse, expected_psnr
from tmca.priors.gaussian_posterior import GaussianSolver
from tmca.sensor import Noise

BLOCK = (3, 2, 9)


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn([smooth_scene(60, 80, seed=1)], BLOCK[1:])


def measured_mse(prior, taps, blocks, noise):
    """Mean squared error of the estimates of blocks (N, L, h, w), each seen through the same code."""
    model = BlockModel.of(taps, prior.block)
    grid = BlockGrid(model, prior.block[1:], (0,), (0,))
    y = noisy(snapshot(taps, blocks), noise.read, noise.shot)[:, 0]
    posterior = GaussianSolver(prior, model, noise, torch.float64).posterior(taps.code[None])
    error = posterior.estimate(0, grid.snapshot_windows(y, [(0, 0)])[0]).reshape(blocks.shape) - blocks
    first, last = model.valid
    return float(error[..., first:last].square().mean())


def expected_mse_of(prior, taps, noise):
    """What the prior expects of the one block that the code is as large as."""
    model = BlockModel.of(taps, prior.block)
    first, last = model.valid
    variance = GaussianSolver(prior, model, noise).posterior(taps.code[None]).error_variance()
    return float(variance.reshape(prior.block)[..., first:last].mean())


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("noise", [Noise(), Noise(0.05), Noise(0.01, 0.01)])
def test_on_scenes_of_the_prior_the_measured_error_is_the_expected_one(prior, name, noise):
    taps = camera(name, 2, 40, period=(2, 2))
    window = Taps(taps.code[:, :, :9], taps.channels, taps.offsets, 3, 9 + max(taps.offsets))
    measured = measured_mse(prior, window, prior.sample(4000, seed=2), noise)
    assert measured == pytest.approx(expected_mse_of(prior, window, noise), rel=0.03)


def test_random_places_agree_with_all_phases_of_a_tiled_code(prior):
    taps = camera("single disperser", 8, 200, period=(2, 3))
    parts = (taps.code[:, y : y + 2, x : x + 9] for y in range(2) for x in range(20, 23))
    phases = [Taps(part, taps.channels, taps.offsets, 3, 9 + max(taps.offsets)) for part in parts]
    expected = np.mean([expected_mse_of(prior, phase, Noise(0.02)) for phase in phases])
    assert float(expected_mse(prior, taps, Noise(0.02), blocks=600)) == pytest.approx(expected, rel=0.05)
    assert expected_psnr(prior, taps, Noise(0.02)) == pytest.approx(-10 * np.log10(expected), abs=0.3)


def test_more_light_is_less_noise(prior):
    taps = camera("single disperser", 4, 30)
    dim = expected_mse(prior.scaled(0.25), taps, Noise(0.01))
    torch.testing.assert_close(dim, expected_mse(prior, taps, Noise(0.04)) / 16, rtol=1e-4, atol=0)
    with pytest.raises(SettingError, match="gain"):
        prior.scaled(0.0)


def test_expected_error_has_the_right_gradient(prior):
    taps = camera("single disperser", 2, 9)

    def error(code):
        other = Taps(code, taps.channels, taps.offsets, 3, 11)
        return expected_mse(prior, other, Noise(0.05, 0.01), blocks=3) * 1e3

    assert torch.autograd.gradcheck(error, (taps.code.clone().requires_grad_(),), atol=1e-5)


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
    pairs = []
    for slots, one_hot in ((1, False), (8, False), (4, True)):
        taps = _multiplexed(slots, one_hot, *block)
        expected = expected_mse_of(prior, taps, Noise())
        assert abs(10 * np.log10(measured_mse(prior, taps, seen, Noise()) / expected)) < 0.2
        pairs.append((expected, measured_mse(prior, taps, unseen, Noise())))
    assert sorted(pairs, key=lambda pair: pair[0]) == sorted(pairs, key=lambda pair: pair[1])


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
