"""Priors of light fields: what parallax couples has a direction."""

from itertools import product

import pytest
import torch

from tests.small_scenes import patches, textbook
from tmca.cameras import LightFieldCamera
from tmca.errors import ShapeError
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.priors.statistics import random_blocks

VIEWS = (3, 3)


def parallax(disparity, size=(14, 17), seed=0, views=VIEWS):
    """(V·U, H, W) a textured plane: what the centre view shows at (y, x), view (v, u) shows at (y - v·d, x - u·d)."""
    reach = abs(disparity) * max(views)
    wide = torch.rand(size[0] + 2 * reach, size[1] + 2 * reach, generator=torch.Generator().manual_seed(seed))
    rows, columns = (range(-(n // 2), n // 2 + 1) for n in views)
    shown = [
        wide[reach + v * disparity : reach + v * disparity + size[0], reach + u * disparity :][:, : size[1]]
        for v in rows
        for u in columns
    ]
    return torch.stack(shown).double()


def mirrored(field, views=VIEWS):
    grid = field.unflatten(0, views)
    return [grid, grid.flip(0, 2), grid.flip(1, 3), grid.flip(0, 1, 2, 3)]


@pytest.mark.parametrize("block", [(3, 3), (2, 4)])
def test_covariances_are_those_of_loops_over_mirror_images(block):
    fields = [parallax(1), parallax(-1, (11, 12), seed=1)]
    prior = GaussianPrior.learn(fields, block, views=VIEWS, floor=0.0)
    images = [image.reshape(9, *image.shape[2:]) for field in fields for image in mirrored(field)]
    if block[0] == block[1]:
        images += [image.unflatten(0, VIEWS).permute(1, 0, 3, 2).flatten(0, 1) for image in images]
    pixels = sum(image[0].numel() for image in images)
    mean = sum(image.sum((1, 2)) for image in images) / pixels
    h, w = block
    for c, o, dy, dx in product((0, 4, 5), (1, 4, 8), range(1 - h, h), range(1 - w, w)):
        total = 0.0
        for image in images:
            one, other = image[c] - mean[c], image[o] - mean[o]
            height, width = one.shape
            rows, columns = slice(max(0, -dy), height - max(0, dy)), slice(max(0, -dx), width - max(0, dx))
            beside = other[max(0, dy) : height + min(0, dy), max(0, dx) : width + min(0, dx)]
            total += float((one[rows, columns] * beside).sum())
        assert float(prior.moments[c, o, h - 1 + dy, w - 1 + dx]) == pytest.approx(total / pixels, abs=1e-10)
    torch.testing.assert_close(prior.mean[:, 0, 0], mean)


def test_blocks_are_mirrored_together_with_their_views():
    """A plane of one disparity stays one: what the centre shows, every view shows displaced, in any mirror image."""
    blocks = random_blocks([parallax(1)], (5, 6), 40, 0, mirrored=True, views=VIEWS).unflatten(1, VIEWS)
    for v, u in product((-1, 0, 1), repeat=2):
        centre = blocks[:, 1, 1, max(v, 0) : 5 + min(v, 0), max(u, 0) : 6 + min(u, 0)]
        view = blocks[:, 1 + v, 1 + u, max(-v, 0) : 5 - max(v, 0), max(-u, 0) : 6 - max(u, 0)]
        torch.testing.assert_close(view, centre)
    assert len({tuple(block.flatten().tolist()) for block in blocks}) == 40
    apart = random_blocks([parallax(1)], (5, 6), 40, 0, mirrored=True).unflatten(1, VIEWS)
    assert (apart[:, 1, 2, :, :-1] - apart[:, 1, 1, :, 1:]).abs().max() > 0.1


def test_a_mixture_of_one_kind_and_gain_is_the_gaussian_of_its_subspace():
    fields = [parallax(1, (30, 34)), parallax(0, (30, 34), seed=2)]
    found = GaussianMixturePrior.learn(fields, (3, 3), kinds=1, rank=6, gains=1, samples=600, steps=1, views=VIEWS)
    assert not found.base.mirrored
    camera = LightFieldCamera(3, (12, 14), 2, period=4)
    snapshot = camera(fields[0].float().unflatten(0, VIEWS)[None, :, :, :12, :14])
    taps = camera.operator().taps
    one = patches(found)(snapshot, taps).estimate
    other = patches(found.component(0))(snapshot, taps).estimate
    torch.testing.assert_close(one, other, atol=2e-3, rtol=1e-3)


def test_a_blocks_covariance_is_symmetric_and_positive():
    prior = GaussianPrior.learn([parallax(2), parallax(0, seed=3)], (4, 5), views=VIEWS)
    covariance = prior.covariance
    torch.testing.assert_close(covariance, covariance.mT)
    assert torch.linalg.eigvalsh(covariance).min() > 0
    torch.testing.assert_close(covariance.diagonal(), prior.variance)
    pixels = torch.tensor([[0, 7], [33, 120]])
    torch.testing.assert_close(prior.rows(pixels, torch.float64), covariance[pixels])


def test_the_estimate_is_that_of_dense_matrices():
    prior = GaussianPrior.learn([parallax(1), parallax(0, seed=5)], (5, 6), views=VIEWS)
    camera = LightFieldCamera(3, (5, 6), 2, seed=3)
    snapshot = camera.A(parallax(1, (5, 6), seed=9).unflatten(0, VIEWS)[None].float()).double()
    found = patches(prior, dtype=torch.float64)(snapshot, camera.taps(), 0.05).estimate
    matrix = torch.zeros(30, 9 * 30, dtype=torch.float64)
    for view, place in product(range(9), range(30)):
        matrix[place, view * 30 + place] = camera.taps().code[view].flatten()[place]
    expected, _ = textbook(prior, matrix, snapshot.flatten(1), 0.05)
    torch.testing.assert_close(found.flatten(1), expected, atol=1e-6, rtol=0)


def test_another_number_of_views_is_refused():
    with pytest.raises(ShapeError, match="views"):
        GaussianPrior.learn([parallax(0)], (3, 3), views=(3, 5))
