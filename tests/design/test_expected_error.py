"""The expected error by its quadratic forms, against the whole posterior, slow loops and finite differences."""

import pytest
import torch

from tests.design.small_designs import BANDS, PRIOR, block_error, designed, tile_error
from tests.small_scenes import CAMERAS, camera
from tmca.cameras import SpectralCamera
from tmca.design import BlockMse
from tmca.design.flips import BlockState
from tmca.errors import SettingError
from tmca.priors import BlockModel, GaussianPrior
from tmca.priors.gaussian_posterior import GaussianSolver
from tmca.sensor import Noise


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("noise", [(0.0, 0.0), (0.05, 0.0), (0.02, 0.01)])
@pytest.mark.parametrize("block", [(3, 9), (4, 10), (1, 12)])
def test_the_error_is_that_of_the_whole_posterior(name, noise, block):
    cubes = [torch.rand(3, 14, 15, generator=torch.Generator().manual_seed(s), dtype=torch.float64) for s in (1, 2)]
    prior = GaussianPrior.learn(cubes, block)
    taps = camera(name, *block, seed=3)
    model = BlockModel.of(taps, prior.block)
    seen = torch.stack([taps.code, taps.code.flip(1)])
    expected = GaussianSolver(prior, model, Noise(*noise), torch.float64).posterior(seen).error_variance()
    found = BlockMse.of(prior, model).under(*noise)(seen)
    torch.testing.assert_close(found, model.in_valid(expected).mean(1), rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("noise", [(0.05, 0.0), (0.02, 0.01)])
def test_its_derivative_is_that_of_finite_differences(noise):
    code = camera("two taps per band", 3, 9, seed=5).code[None].requires_grad_()
    model = BlockModel.of(camera("two taps per band", 3, 9), PRIOR.block)
    error = BlockMse.of(PRIOR, model, *noise)
    assert torch.autograd.gradcheck(error, (0.1 + code,), eps=1e-6, atol=1e-6)


def repeated(small, period):
    """The camera of a frame that its tile fills."""
    codes = {name: getattr(small.codes, name).tile().detach() for name in ("aperture", "shutter")}
    return SpectralCamera(bands=BANDS, size=(12, 30), slots=2, period=period, **codes)


def test_the_tile_error_is_the_mean_over_its_phases():
    small, error = designed(period=(3, 5)), tile_error()
    code = small.operator().taps.code.detach()
    every = torch.stack([error(code, (y, x)) for y in range(3) for x in range(5)]).mean()
    cut, model = repeated(small, (3, 5)).operator().taps.code.double(), error.error.model
    solver = GaussianSolver(PRIOR, model, Noise(0.05), torch.float64)
    seen = torch.stack([cut[:, y : y + 3, x : x + 9] for y in range(3) for x in range(5)])
    truth = model.in_valid(solver.posterior(seen).error_variance()).mean()
    torch.testing.assert_close(every, truth, rtol=1e-6, atol=0)


@pytest.mark.parametrize("noise", [(0.05, 0.0), (0.02, 0.01)])
@pytest.mark.parametrize("name", ["single disperser", "dual disperser", "two taps per band"])
def test_changes_of_a_few_weights_are_judged_as_if_anew(name, noise):
    taps = camera(name, 3, 9, seed=1)
    model = BlockModel.of(taps, PRIOR.block)
    error = BlockMse.of(PRIOR, model, *noise)
    weights = model.complete(taps.code[None]).flatten(2).mT[0]
    generator, changes = torch.Generator().manual_seed(0), torch.zeros(6, *weights.shape, dtype=torch.float64)
    for count, change in enumerate(changes):
        rows = torch.randint(len(weights), (count,), generator=generator)
        change[rows] = 0.5 - torch.rand(count, weights.shape[1], generator=generator, dtype=torch.float64)
        change[rows] = change[rows].clamp_min(-weights[rows])
    found = BlockState.of(error, weights).after(changes)
    anew = torch.tensor([BlockState.of(error, weights + change).value for change in changes], dtype=torch.float64)
    torch.testing.assert_close(found, anew, rtol=1e-9, atol=1e-13)
    assert found[0] == pytest.approx(BlockState.of(error, weights).value)


def test_negative_noise_is_refused():
    with pytest.raises(SettingError):
        block_error(-1.0)
    with pytest.raises(SettingError):
        block_error().under(0.0, -0.1)
