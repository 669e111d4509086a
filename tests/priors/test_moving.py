"""The prior of moving scenes is the covariance of scenes that were moved, displacement by displacement."""

import pytest
import torch

from tmca.cameras.motion import moving_scene
from tmca.errors import DataError
from tmca.priors import GaussianPrior
from tmca.priors.moving import moving_block, moving_prior, reach_of, smoother_prior

FRAMES, MOTION = 2, 1.5


@pytest.fixture(scope="module")
def still():
    generator = torch.Generator().manual_seed(3)
    smooth = torch.nn.functional.avg_pool2d(torch.rand(2, 24, 26, generator=generator), 3, 1)
    return GaussianPrior.learn([smooth.double()], (7, 8))


def frames_of(channel, place, size):
    """(n, G·L·rows·columns) what one lit pixel of a still scene gives to the middle of every frame, each motion."""
    scene = torch.zeros(2, *size, dtype=torch.float64)
    scene[channel, place[0], place[1]] = 1
    steps, margin = torch.linspace(-MOTION, MOTION, 5).tolist(), reach_of(MOTION) // 2
    inside = (..., slice(margin, -margin), slice(margin, -margin))
    return torch.stack([moving_scene(scene, (y, x), FRAMES)[inside].flatten() for y in steps for x in steps])


def test_it_is_the_covariance_of_moved_scenes(still):
    _, h, w = still.block
    places = [(c, (y, x)) for c in range(2) for y in range(h) for x in range(w)]
    moves = torch.stack([frames_of(c, place, (h, w)) for c, place in places], -1)
    expected = torch.stack([move @ still.covariance @ move.mT for move in moves]).mean(0)
    moved = moving_prior(still, FRAMES, MOTION)
    assert moved.block == (2 * FRAMES, h - reach_of(MOTION), w - reach_of(MOTION))
    torch.testing.assert_close(moved.covariance, expected)
    torch.testing.assert_close(moved.mean[:, 0, 0], still.mean[:, 0, 0].repeat(FRAMES))


def test_without_motion_every_frame_is_the_same(still):
    moved = moving_prior(still, 3, 0.0)
    one = moved.covariance.unflatten(0, (3, -1)).unflatten(2, (3, -1))
    for a in range(3):
        for b in range(3):
            torch.testing.assert_close(one[a, :, b], still.covariance)


def test_blocks_are_cut_to_what_is_asked_for(still):
    cut, whole = moving_prior(still, FRAMES, MOTION, (3, 2)), moving_prior(still, FRAMES, MOTION)
    assert cut.block == (4, 3, 2)
    same = whole.covariance.reshape(*whole.block, *whole.block)[:, :3, :2, :, :3, :2]
    torch.testing.assert_close(cut.covariance, same.reshape(cut.covariance.shape))


def test_priors_that_leave_no_room_are_refused(still):
    with pytest.raises(DataError, match="7×8 pixels"):
        moving_prior(still, 2, 7.0)


def test_blocks_of_more_frames_are_smaller():
    from tmca.cameras import LightFieldCamera, SpectralCamera

    spectral, views = SpectralCamera(12, (64, 64)), LightFieldCamera(5, (64, 64))
    assert [moving_block(spectral, frames) for frames in (1, 4, 8)] == [(12, 28), (6, 28), (3, 28)]
    assert [moving_block(views, frames) for frames in (1, 4)] == [(9, 9), (5, 5)]


def test_displacements_that_are_given_are_the_only_ones(still):
    chosen = [(1.5, -0.75), (0.0, 1.5)]
    _, h, w = still.block
    margin = reach_of(MOTION) // 2
    inside = (..., slice(margin, -margin), slice(margin, -margin))
    expected = []
    for displacement in chosen:
        units = torch.eye(2 * h * w, dtype=torch.float64).unflatten(1, (2, h, w))
        moves = torch.stack([moving_scene(one, displacement, FRAMES)[inside].flatten() for one in units], -1)
        expected.append(moves @ still.covariance @ moves.mT)
    moved = moving_prior(still, FRAMES, MOTION, displacements=chosen)
    torch.testing.assert_close(moved.covariance, torch.stack(expected).mean(0))


def test_a_smoother_prior_is_that_of_blurred_scenes_and_a_tenth_of_the_sharp_ones(still):
    _, h, w = still.block
    kernel = torch.tensor([1.0, 2.0, 1.0], dtype=torch.float64) / 4
    units = torch.eye(2 * h * w, dtype=torch.float64).unflatten(1, (2, h, w))
    blur = torch.nn.functional.conv2d(units.flatten(0, 1)[:, None], (kernel[:, None] * kernel)[None, None])
    blur = blur[:, 0].unflatten(0, (-1, 2)).flatten(1).mT  # valid part: (2·(h-2)·(w-2), n)
    sharp = units[..., 1:-1, 1:-1].flatten(1).mT
    expected = 0.9 * blur @ still.covariance @ blur.mT + 0.1 * sharp @ still.covariance @ sharp.mT
    smooth = smoother_prior(still, 2)
    assert smooth.block == (2, h - 2, w - 2)
    torch.testing.assert_close(smooth.covariance, expected)
