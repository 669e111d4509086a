"""A camera of a scene that changes: frame by frame, and the same codes in shorter slots."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera, in_finer_time, moving_scenes
from tmca.cameras.frames import frame_shares, frame_taps
from tmca.errors import SettingError
from tmca.operators import TapOperator

CAMERAS = {
    "one bucket": lambda: SpectralCamera(3, (6, 7), 4, shutter="one-hot"),
    "fractional": lambda: SpectralCamera(3, (7, 6), 4, dispersion=1.3, exposure="per-slot"),
    "two buckets": lambda: SpectralCamera(3, (6, 7), 4, shutter="balanced", buckets=2),
    "burst": lambda: SpectralCamera(3, (6, 7), 4, shutter="burst", buckets=2),
    "light field": lambda: LightFieldCamera(3, (6, 7), 4),
    "light field, two buckets": lambda: LightFieldCamera(3, (7, 6), 4, shutter="balanced", buckets=2),
}


@pytest.mark.parametrize("frames", [1, 2, 4, 8])
@pytest.mark.parametrize("name", CAMERAS)
def test_frames_are_imaged_as_the_slots_that_see_them(name, frames):
    camera = CAMERAS[name]().double()
    seen = torch.rand(2, frames, *camera.scene_shape).double()
    slots = seen.repeat_interleave(4 // frames, 1) if frames <= 4 else seen.unflatten(1, (4, -1)).mean(2)
    operator = TapOperator(frame_taps(camera, frames))
    torch.testing.assert_close(operator.A(seen.flatten(1, -3)), camera.exact(slots))


def test_the_shares_of_frames_are_those_of_their_times():
    assert frame_shares(2, 4).tolist() == [[1, 1, 0, 0], [0, 0, 1, 1]]
    torch.testing.assert_close(frame_shares(6, 3), torch.eye(3).repeat_interleave(2, 0) / 2)


@pytest.mark.parametrize("frames", [0, 3])
def test_frames_that_do_not_fit_the_slots_are_refused(frames):
    with pytest.raises(SettingError, match="frames"):
        frame_taps(CAMERAS["one bucket"](), frames)


def test_a_coloured_aperture_has_no_frames():
    with pytest.raises(SettingError, match="coloured"):
        frame_taps(SpectralCamera(3, (6, 7), coloured=torch.rand(3, 6, 7)), 2)


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
