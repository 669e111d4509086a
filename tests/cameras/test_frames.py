"""A camera of a scene that changes: its taps frame by frame image what its slots see."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera
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


def movie(camera, frames):
    values = torch.rand(2, frames, *camera.scene_shape, generator=torch.Generator().manual_seed(1))
    return values.double()


@pytest.mark.parametrize("frames", [1, 2, 4, 8])
@pytest.mark.parametrize("name", CAMERAS)
def test_frames_are_imaged_as_the_slots_that_see_them(name, frames):
    camera = CAMERAS[name]().double()
    seen = movie(camera, frames)
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
