"""Covariances by displacement are those of all pairs of pixels, which dense matrices say."""

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, smooth_scene
from tmca.operators.blocks import BlockModel
from tmca.operators.displacement import MeasurementCovariance, Smoothing
from tmca.priors import GaussianPrior

SIDES = [(2, 9), (3, 8), (1, 7), (4, 5)]


def one_sided(channels, h, w):
    """A covariance that is not the same in mirror image: of scenes that a lopsided kernel drew."""
    generator = torch.Generator().manual_seed(h + w)
    kernel = torch.rand(channels, channels, 2, 3, generator=generator, dtype=torch.float64)
    big = torch.zeros(channels, channels, 2 * h + 4, 2 * w + 4, dtype=torch.float64)
    big[..., :2, :3] = kernel
    waves = torch.fft.fft2(big)
    power = torch.einsum("abyx,cbyx->acyx", waves, waves.conj())
    both = torch.fft.ifft2(power).real
    lags = both.roll((h - 1, w - 1), (2, 3))[..., : 2 * h - 1, : 2 * w - 1]
    return GaussianPrior(torch.zeros(channels, h, w, dtype=torch.float64), lags.flip(2, 3).contiguous())


def priors(h, w):
    return GaussianPrior.learn([smooth_scene(30, 40, seed=1)], (h, w)), one_sided(3, h, w)


def dense(model, weights, block):
    """(m, n) A of one block, from its definition: the light that taps bring to every measurement."""
    matrix = torch.zeros(model.measurements, *model.block, dtype=weights.dtype)
    h, columns = model.block[1], model.columns
    for bucket in range(model.buckets):
        for row in range(h):
            for column in range(columns):
                for tap, (channel, offset) in enumerate(zip(model.channels, model.offsets, strict=True)):
                    weight = weights[block, tap, bucket * h + row, column]
                    matrix[(bucket * h + row) * columns + column, channel, row, model.span + column - offset] += weight
    return matrix.flatten(1)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("buckets", [1, 2])
def test_covariances_of_measurements_are_those_of_the_matrices(name, sides, buckets):
    model = BlockModel.of(camera(name, 5, 17), (3, *sides)).for_buckets(buckets)
    shape = (2, len(model.offsets), buckets * sides[0], model.columns)
    weights = torch.rand(shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    for prior in priors(*sides):
        found = MeasurementCovariance(prior.displaced, model)(weights)
        for block in range(2):
            whole = dense(model, weights, block)
            expected = whole @ prior.covariance @ whole.T
            torch.testing.assert_close(found[block], expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("buckets", [1, 2])
def test_measurements_are_spread_by_the_transpose(name, buckets):
    model = BlockModel.of(camera(name, 5, 17), (3, 3, 8)).for_buckets(buckets)
    generator = torch.Generator().manual_seed(3)
    weights = torch.rand(1, len(model.offsets), buckets * 3, model.columns, generator=generator, dtype=torch.float64)
    measured = torch.rand(4, model.measurements, generator=generator, dtype=torch.float64)
    expected = measured @ dense(model, weights, 0)
    torch.testing.assert_close(model.spread(weights.expand(4, -1, -1, -1), measured), expected)


@pytest.mark.parametrize("sides", SIDES)
def test_products_are_those_of_the_dense_covariance(sides):
    blocks = torch.rand(5, 3 * sides[0] * sides[1], generator=torch.Generator().manual_seed(4), dtype=torch.float64)
    for prior in priors(*sides):
        torch.testing.assert_close(
            Smoothing(prior.displaced)(blocks), blocks @ prior.covariance, rtol=1e-10, atol=1e-13
        )
