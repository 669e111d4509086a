"""Scenes that move within the exposure, recovered frame by frame."""

import pytest
import torch
from torch.nn.functional import avg_pool2d

from tests.small_scenes import smooth_scene
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, moving_scene, moving_scenes
from tmca.decoders import decode
from tmca.errors import SettingError
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

MOVED = (3.0, -2.0)


def smoother_scene(height, width, channels=3, seed=0):
    """Without the finest details, which a moving scene cannot keep."""
    return avg_pool2d(smooth_scene(height + 4, width + 4, channels, seed), 5, 1)


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn([smoother_scene(48, 52, seed=seed) for seed in range(4)], (12, 12))


def taken(shutter, buckets, moved=MOVED, **sensor):
    scene = smoother_scene(30, 34, seed=9).float()
    camera = SpectralCamera(3, (30, 34), 4, shutter=shutter, buckets=buckets, sensor=Sensor(**sensor))
    seen = moving_scenes(scene[None], moved, 4) if any(moved) else scene[None]
    return Snapshot(camera(seen, generator=0), camera), moving_scene(scene, moved, 4)


def error_db(estimate, truth):
    return float(10 * torch.log10((estimate - truth).square().mean()))


def test_frames_that_no_slots_make_are_refused_before_a_prior_is_looked_for(monkeypatch):
    monkeypatch.setattr("tmca.decoders.moving.find_prior", lambda *given, **more: pytest.fail("looked for a prior"))
    with pytest.raises(SettingError, match="frames: found 3, expected a divisor or a multiple of the 4 slots"):
        decode(taken("balanced", 2)[0], "space-time-mixture", frames=3)


@pytest.mark.parametrize(("shutter", "buckets"), [("one-hot", 1), ("balanced", 2), ("burst", 4)])
def test_a_scene_that_moves_is_recovered_better_than_by_a_still_decoder(prior, shutter, buckets):
    snapshot, truth = taken(shutter, buckets, read_noise=0.001)
    still = decode(snapshot, "lmmse", prior=prior).values[0]
    frames = decode(snapshot, "space-time-lmmse", prior=prior).values[0]
    assert frames.shape == truth.shape
    assert error_db(frames, truth) < error_db(still, truth) - 3


def test_a_scene_at_rest_loses_little_where_noise_counts(prior):
    snapshot, truth = taken("balanced", 2, (0.0, 0.0), read_noise=0.03)
    still = decode(snapshot, "lmmse", prior=prior).values[0]
    frames = decode(snapshot, "space-time-lmmse", prior=prior, motion=2.0).values[0]
    assert error_db(frames, truth) < error_db(still, truth) + 2


def test_one_frame_without_motion_is_the_still_estimate(prior):
    snapshot, _ = taken("balanced", 2, (0.0, 0.0), read_noise=0.01)
    one = decode(snapshot, "space-time-lmmse", prior=prior, frames=1, motion=0.0).values[:, 0]
    torch.testing.assert_close(one, decode(snapshot, "lmmse", prior=prior).values)


def test_the_predicted_deviation_is_that_of_the_errors(prior):
    snapshot, truth = taken("balanced", 2, read_noise=0.01)
    estimate = decode(snapshot, "space-time-lmmse", prior=prior, uncertainty=True)
    assert estimate.deviation.shape == estimate.values.shape
    ratio = (estimate.values[0] - truth).square().mean() / estimate.deviation[0].square().mean()
    assert 0.5 < float(ratio.sqrt()) < 1.2


def light_field_that_moves():
    """A snapshot, its frames, and a prior."""
    scenes = [smoother_scene(40, 40, 9, seed).unflatten(0, (3, 3)).float() for seed in range(3)]
    prior = GaussianPrior.learn([one.flatten(0, 1) for one in scenes], (9, 9), views=(3, 3))
    camera = LightFieldCamera(3, (40, 40), 2, shutter="burst", buckets=2, sensor=Sensor(read_noise=0.001))
    moved = moving_scenes(scenes[0][None], MOVED, 2)
    return Snapshot(camera(moved, generator=0), camera), moved, prior


def test_a_light_field_that_moves():
    snapshot, moved, prior = light_field_that_moves()
    frames = decode(snapshot, "space-time-lmmse", prior=prior).values
    assert frames.shape == moved.shape
    assert error_db(frames, moved) < error_db(decode(snapshot, "lmmse", prior=prior).values[:, None], moved) - 1
