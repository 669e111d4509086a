"""Gradients of posteriors in the codes, against those that PyTorch records of the same products."""

import pytest
import torch
from torch.autograd import gradcheck

from tests.small_scenes import CAMERAS, camera
from tmca.cameras import SpectralCamera
from tmca.operators.blocks import BlockModel
from tmca.priors.derivatives import BlockProducts, Signal

TAPS = {name: lambda name=name: camera(name, 9, 20) for name in CAMERAS} | {
    "two buckets": lambda: SpectralCamera(3, (7, 22), slots=3, shutter="balanced", buckets=2).taps(),
}


def drawn(*shape):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(len(shape)), dtype=torch.float64)


def given(taps, block=(3, 8), blocks=2):
    """A model of blocks, weights that want gradients, and the covariance of as many pixels as a block has."""
    model = BlockModel.of(taps, (taps.scene_channels, *block))
    pixels = taps.scene_channels * block[0] * block[1]
    root = drawn(pixels, pixels)
    weights = drawn(blocks, len(model.offsets), model.buckets * block[0], model.columns)
    return model, weights.requires_grad_(), root @ root.mT / len(root)


@pytest.mark.parametrize("block", [(3, 8), (2, 9)])
@pytest.mark.parametrize("name", TAPS)
def test_the_signal_has_the_derivative_of_both_of_its_sides(name, block):
    model, weights, covariance = given(TAPS[name](), block)
    rows, slope = covariance[model.pixels()], drawn(2, model.measurements, model.measurements)
    found = []
    for signal in (
        lambda cross: model.measure(weights, cross).transpose(0, 1),
        lambda cross: Signal.apply(weights, cross.detach(), model),
    ):
        value = signal(model.cross_covariance(weights, rows))
        found.append((value.detach(), *torch.autograd.grad((value * slope).sum(), weights)))
    torch.testing.assert_close(found[1], found[0], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("blocks", "counts"), [([0, 1, 2], [2, 1, 3]), ([2, 0], [1, 2])])
def test_products_have_their_derivatives(blocks, counts):
    matrices, vectors = drawn(4, 3, 5).requires_grad_(), drawn(sum(counts), 4).requires_grad_()
    assert gradcheck(lambda *both: BlockProducts.apply(*both, blocks, counts), (matrices, vectors))
    parts = vectors.split(counts)
    expected = torch.cat([part @ matrices[:, block] for block, part in zip(blocks, parts, strict=True)])
    torch.testing.assert_close(BlockProducts.apply(matrices, vectors, blocks, counts), expected)


@pytest.mark.parametrize("made", ["signal", "products"])
def test_second_derivatives_are_refused(made):
    model, weights, covariance = given(TAPS["two buckets"]())
    cross = model.cross_covariance(weights.detach(), covariance[model.pixels()])
    if made == "signal":
        wanted, value = weights, Signal.apply(weights, cross, model).square().sum()
    else:
        wanted = cross.requires_grad_()
        value = BlockProducts.apply(wanted, drawn(2, len(cross)), [0, 1], [1, 1]).square().sum()
    torch.autograd.grad(value, wanted, retain_graph=True)
    with pytest.raises(NotImplementedError, match="second derivatives"):
        torch.autograd.grad(value, wanted, create_graph=True)


def test_gradients_of_fixed_matrices_are_not_computed():
    matrices, vectors = drawn(4, 2, 5), drawn(3, 4).requires_grad_()
    BlockProducts.apply(matrices, vectors, [1, 0], [1, 2]).sum().backward()
    expected = [matrices[:, block].sum(1) for block in (1, 0, 0)]
    torch.testing.assert_close(vectors.grad, torch.stack(expected))
