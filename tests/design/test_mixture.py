"""Expected error under a Gaussian mixture: one component is a Gaussian, many are their mean, slopes are right."""

import pytest
import torch

from tmca.design import BlockMse, Descent, Effort, MixtureMse, TileMse, descend, designable, search
from tmca.errors import SettingError, ShapeError
from tmca.operators.blocks import BlockModel
from tmca.priors import GaussianMixturePrior, GaussianPrior

BANDS, BLOCK = 3, (2, 9)


def cubes(count=3):
    generator = torch.Generator().manual_seed(3)
    for _ in range(count):
        rough = torch.rand(BANDS, 26, 41, generator=generator)
        yield torch.nn.functional.avg_pool2d(rough[None], 3, 1)[0] * torch.linspace(0.2, 1, 39)


@pytest.fixture(scope="module")
def model():
    return BlockModel.of(designable("static", 1, (4, 6), bands=BANDS).taps(), (BANDS, *BLOCK))


@pytest.fixture(scope="module")
def prior():
    return GaussianMixturePrior.learn(cubes(), BLOCK, kinds=2, rank=8, gains=2, samples=800, steps=2)


@pytest.mark.parametrize("noise", [(0.01, 0.0), (0.002, 1e-3)])
def test_one_component_is_the_gaussian(model, noise):
    gaussian = GaussianPrior.learn(cubes(), BLOCK)
    mixture = TileMse(MixtureMse.of(GaussianMixturePrior.of(gaussian), model, *noise))
    camera = designable("free", 3, (4, 6), bands=BANDS)
    assert mixture.whole(camera) == pytest.approx(TileMse(BlockMse.of(gaussian, model, *noise)).whole(camera), rel=1e-6)


@pytest.mark.parametrize("noise", [(0.01, 0.0), (0.002, 1e-3)])
def test_it_is_the_mean_over_components_each_written_out(model, prior, noise):
    camera = designable("one-hot", 2, (4, 6), bands=BANDS)
    expected = sum(
        float(prior.weights[kind, gain])
        * TileMse(BlockMse.of(prior.component(kind, gain), model, *noise)).whole(camera)
        for kind in range(2) for gain in range(2)
    )  # fmt: skip
    assert TileMse(MixtureMse.of(prior, model, *noise, least=0)).whole(camera) == pytest.approx(expected, rel=1e-5)


def test_slopes_of_relaxed_codes_are_those_of_differences(model, prior):
    error = TileMse(MixtureMse.of(prior, model, 0.01, 1e-3))
    generator = torch.Generator().manual_seed(1)
    code = torch.rand(3, 4, 6, generator=generator).double().mul(0.8).add(0.1).requires_grad_()
    error(code).backward()
    for place in ((0, 0, 0), (1, 3, 5), (2, 2, 1)):
        step = torch.zeros_like(code)
        step[place] = 1e-5
        slope = float((error(code.detach() + step) - error(code.detach() - step)) / 2e-5)
        assert float(code.grad[place]) == pytest.approx(slope, rel=1e-5)


def test_codes_descend_on_it(model, prior):
    error, camera = TileMse(MixtureMse.of(prior, model, 0.005, 0.0)), designable("free", 2, (4, 6), bands=BANDS)
    before = error.whole(camera)
    assert descend(camera, error, Descent(steps=30)) < before
    found = search("free", 2, (4, 6), error, effort=Effort(1, 20, 0), bands=BANDS)
    assert found.mse == pytest.approx(error.whole(found.camera))


def test_what_does_not_fit_is_refused(model, prior):
    other = GaussianMixturePrior.learn(cubes(), (2, 8), kinds=1, rank=4, gains=1, samples=400, steps=0)
    with pytest.raises(ShapeError, match="mixture prior"):
        MixtureMse.of(other, model, 0.01, 0.0)
    with pytest.raises(SettingError, match="least"):
        MixtureMse.of(prior, model, 0.01, 0.0, least=2)
    with pytest.raises(SettingError, match="flips"):
        search("free", 2, (4, 6), TileMse(MixtureMse.of(prior, model, 0.01, 0.0)), bands=BANDS)
