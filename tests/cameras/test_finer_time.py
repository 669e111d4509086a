"""The same codes in shorter slots, and the time in which a frame of a burst is read."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera, in_finer_time, moving_scenes
from tmca.errors import SettingError

CODES = [
    {"slots": 1, "shutter": "open"},
    {"slots": 4, "shutter": "one-hot", "period": (4, 6)},
    {"slots": 2, "shutter": "balanced", "buckets": 2},
    {"slots": 3, "shutter": "burst", "buckets": 3, "period": 5},
    {"slots": 2, "aperture": "complementary", "shutter": "random", "buckets": 2},
]


def cameras(codes):
    return (
        SpectralCamera(bands=3, size=(7, 8), dispersion=0.5, **codes).double(),
        LightFieldCamera(3, (6, 9), seed=2, **codes).double(),
    )


@pytest.mark.parametrize("codes", CODES)
def test_shorter_slots_without_dead_time_change_nothing(codes):
    for camera in cameras(codes):
        finer = in_finer_time(camera, 3)
        scenes = torch.rand(2, *camera.scene_shape, dtype=torch.float64)
        assert (finer.slots, finer.buckets) == (3 * camera.slots, camera.buckets)
        torch.testing.assert_close(finer.A(scenes), camera.A(scenes))
        moved = moving_scenes(scenes, (0.0, 1.5), finer.slots)
        means = moved.unflatten(1, (camera.slots, 3)).mean(2)
        torch.testing.assert_close(finer.exact(moved), camera.exact(means))


@pytest.mark.parametrize("codes", CODES)
def test_in_dead_time_no_light_is_collected(codes):
    for camera in cameras(codes):
        finer = in_finer_time(camera, 4, 1)
        scenes = torch.rand(2, *camera.scene_shape, dtype=torch.float64)
        torch.testing.assert_close(finer.A(scenes), 0.75 * camera.A(scenes))
        moved = moving_scenes(scenes, (0.0, 1.5), finer.slots)
        seen = moved.unflatten(1, (camera.slots, 4))[:, :, :3].mean(2)
        torch.testing.assert_close(finer.exact(moved), 0.75 * camera.exact(seen))


def test_what_no_time_can_be_is_refused():
    camera = SpectralCamera(bands=3, size=(4, 5), slots=2)
    for parts, dead, where in ((0, 0, "parts"), (3, 3, "dead"), (2, -1, "dead")):
        with pytest.raises(SettingError) as caught:
            in_finer_time(camera, parts, dead)
        assert caught.value.where == where
    with pytest.raises(SettingError, match="equal"):
        in_finer_time(SpectralCamera(bands=3, size=(4, 5), slots=2, exposure="per-slot"), 2)
