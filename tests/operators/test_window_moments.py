"""Moments of spectral-depth snapshots against the explicit matrix of the camera."""

from dataclasses import replace

import pytest
import torch

from tmca.cameras import SpectralDepthCamera
from tmca.errors import SettingError, ShapeError
from tmca.operators.window_moments import needed_block, snapshot_moments
from tmca.optics import PhaseMaskBench
from tmca.priors import GaussianPrior

BENCH = PhaseMaskBench(window=(5, 7), mask_pixels=24, diameter=1e-3)


def camera(window, tile=2, **changes):
    """A camera of the scene that a window sees."""
    settings = {
        "size": needed_block(window, BENCH.window),
        "bands": (450e-9, 600e-9),
        "slots": 3,
        "planes": 3,
        "bench": BENCH,
        "filters": "gaussian",
        "shutter": "random",
        "channels": "rgb",
        "period": tile,
    }
    return SpectralDepthCamera(**{**settings, **changes})


def prior_of(block, bands=2):
    source = torch.Generator().manual_seed(0)
    cubes = [torch.rand(bands, 40, 44, generator=source).cumsum(-1) / 20 for _ in range(2)]
    return GaussianPrior.learn(cubes, block)


def parts(made, tile):
    """PSF, and filters and shutter of a tile."""
    psf, colour, shutter = made.psf().double(), made.colour().double(), made.shutter().double()[None]
    return psf, colour, shutter, colour[..., :tile, :tile], shutter[..., :tile, :tile]


def matrix(made, window, plane, colour, shutter):
    """(n, L·H·W) of a window that begins at the first pixel of a tile, from impulses."""
    psf, (h, w) = made.psf().double(), BENCH.window
    rows = torch.zeros(len(colour), window, window, *made.scene_shape, dtype=torch.float64)
    for y in range(window):
        for x in range(window):
            tile = (y % colour.shape[-2], x % colour.shape[-1])
            mixed = torch.einsum("k,klhw->lhw", shutter[0, :, tile[0], tile[1]], psf[:, plane]) / made.slots
            seen = colour[:, :, tile[0], tile[1], None, None] * mixed
            rows[:, y, x, :, y : y + h, x : x + w] = seen.flip((-2, -1))
    return rows.flatten(0, 2).flatten(1)


@pytest.mark.parametrize(("window", "tile"), [(4, 2), (5, 2), (6, 3)])
def test_moments_are_those_of_the_explicit_matrix(window, tile):
    made = camera(window, tile)
    prior = prior_of(needed_block(window, BENCH.window))
    psf, _, _, colour, shutter = parts(made, tile)
    found = snapshot_moments(prior, psf, colour, shutter, window, cross=True)
    mean = prior.mean.flatten()
    second = prior.covariance + torch.outer(mean, mean)
    behind = torch.zeros(made.scene_shape, dtype=torch.bool)
    behind[:, 2 : 2 + window, 3 : 3 + window] = True
    for plane in range(3):
        A = matrix(made, window, plane, colour, shutter)
        torch.testing.assert_close(found.covariance[plane], A @ second @ A.T, atol=1e-9, rtol=1e-7)
        torch.testing.assert_close(found.cross[plane], (second @ A.T)[behind.flatten()], atol=1e-9, rtol=1e-7)


def test_contamination_is_the_mean_over_scenes_of_which_a_share_is_at_any_plane():
    made = camera(4)
    psf, _, _, colour, shutter = parts(made, 2)
    prior = prior_of(needed_block(4, BENCH.window))
    own, mixed = (snapshot_moments(prior, psf, colour, shutter, 4, contamination=c, cross=True) for c in (0.0, 0.3))
    for name in ("covariance", "cross"):
        every = getattr(own, name)
        for plane in range(3):
            drawn = 0.7 * every[plane] + sum(0.1 * every[other] for other in range(3))
            torch.testing.assert_close(getattr(mixed, name)[plane], drawn)


def test_larger_blocks_of_the_prior_change_nothing():
    made = camera(4)
    psf, _, _, colour, shutter = parts(made, 2)
    small = needed_block(4, BENCH.window)
    moments = [
        snapshot_moments(prior_of(block), psf, colour, shutter, 4).covariance
        for block in (small, (small[0] + 3, small[1] + 8))
    ]
    torch.testing.assert_close(*moments)


def test_the_explicit_matrix_is_the_camera():
    made, plane = camera(4), 1
    _, _, _, colour, shutter = parts(made, 2)
    cube = torch.rand(1, *made.scene_shape)
    depth = torch.full((1, 1, *made.size), float(made.planes.metres[plane]))
    begun = (part.roll((-2, -3), (-2, -1)) for part in (colour, shutter))
    inside = made(cube, depth)[0, :, 2:6, 3:7].flatten().double()
    torch.testing.assert_close(matrix(made, 4, plane, *begun) @ cube.double().flatten(), inside, atol=1e-6, rtol=1e-5)


def test_moments_have_gradients_in_the_mask():
    window, tile = 4, 2
    prior = prior_of(needed_block(window, BENCH.window))
    psf, _, _, colour, shutter = parts(camera(window, tile), tile)
    psf = psf[:, :1].clone().requires_grad_()
    direction = torch.randn_like(psf)

    def value(p):
        return snapshot_moments(prior, p, colour, shutter, window).covariance.square().sum()

    (gradient,) = torch.autograd.grad(value(psf), psf)
    step = 1e-6
    slope = (value(psf + step * direction) - value(psf - step * direction)) / (2 * step)
    torch.testing.assert_close((gradient * direction).sum(), slope, rtol=1e-5, atol=0)


def test_priors_that_do_not_fit_are_refused():
    made = camera(4)
    psf, _, _, colour, shutter = parts(made, 2)
    with pytest.raises(ShapeError, match="prior"):
        snapshot_moments(prior_of((6, 6)), psf, colour, shutter, 4)
    prior = prior_of((8, 10))
    with pytest.raises(SettingError, match="prior"):
        snapshot_moments(replace(prior, moments=prior.covariance), psf, colour, shutter, 4)
