"""What an estimate leaves of its snapshot, and whether that is doubted."""

import pytest
import torch

from tests.small_scenes import smooth_scene
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.decoders import Estimate, decode, misfit_of
from tmca.sensor import Sensor


def camera(**more):
    settings = {"slots": 4, "buckets": 2, "shutter": "balanced", "period": 8, "sensor": Sensor(read_noise=0.01)}
    return SpectralCamera(4, (16, 20), **{**settings, **more})


SCENE = smooth_scene(16, 20, 4, seed=3)[None]


def test_the_scene_itself_leaves_the_noise():
    own = camera()
    found = misfit_of(Estimate(SCENE, own, "truth"), own(SCENE, generator=1))
    assert found.left == pytest.approx(found.noise, rel=0.1)
    assert not found.doubtful
    assert misfit_of(Estimate(SCENE, own, "truth"), torch.zeros(1, *own.snapshot_shape)).left == 0


@pytest.mark.parametrize("decoder", ["admm-tv", "tikhonov"])
def test_exchanged_buckets_and_other_codes_are_doubted(decoder):
    own, other = camera(), camera(seed=5)
    values = own(SCENE, generator=1)
    right, *wrong = (
        misfit_of(decode(Snapshot(seen, shown), decoder, progress=False), seen)
        for seen, shown in ((values, own), (values.flip(1), own), (values, other))
    )
    assert not right.doubtful
    assert all(each.doubtful for each in wrong)


def test_saturated_pixels_count_for_nothing():
    own = camera(sensor=Sensor(saturates=0.2))
    values = own(SCENE)
    assert (own.A(SCENE) - values).max() > 0.05
    assert misfit_of(Estimate(SCENE, own, "truth"), values).left < 1e-5


def test_frames_are_imaged_in_their_time():
    own = camera(sensor=Sensor())
    movie = torch.stack([SCENE.roll(step, 3) for step in range(4)], 1)
    values = own.exact(movie)
    assert misfit_of(Estimate(movie, own, "truth"), values).left < 1e-5
    assert misfit_of(Estimate(movie.mean(1), own, "truth"), values).left > 0.01


def test_frames_of_a_light_field_are_imaged_in_their_time():
    own = LightFieldCamera(3, (16, 20), 4, shutter="balanced", buckets=2)
    movie = smooth_scene(16, 20, 36, seed=4).unflatten(0, (1, 4, 3, 3))
    values = own.exact(movie)
    assert misfit_of(Estimate(movie, own, "truth"), values).left < 1e-5
    assert misfit_of(Estimate(movie.mean(1), own, "truth"), values).left > 0.01
