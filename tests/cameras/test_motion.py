"""Scenes that move, against the exposure followed in many short moments."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera, moving_scene, moving_scenes
from tmca.errors import SettingError

SIZES = [(9, 11), (10, 12)]
_MOMENTS = 600


def slow(scene, motion, slots):
    """The mean of the scene over every slot, moment by moment, each pixel by bilinear interpolation."""
    height, width = scene.shape[1:]
    rows, columns = torch.arange(height, dtype=scene.dtype), torch.arange(width, dtype=scene.dtype)
    found = torch.zeros(slots, *scene.shape, dtype=scene.dtype)
    for moment in range(slots * _MOMENTS):
        time = (moment + 0.5) / (slots * _MOMENTS) - 0.5
        y, x = (rows - motion[0] * time).clamp(0, height - 1), (columns - motion[1] * time).clamp(0, width - 1)
        top, left = y.floor().long().clamp_max(height - 2), x.floor().long().clamp_max(width - 2)
        down, across = (y - top)[:, None], x - left
        for row, share in ((top, 1 - down), (top + 1, down)):
            seen = scene[:, row]
            found[moment // _MOMENTS] += share * ((1 - across) * seen[..., left] + across * seen[..., left + 1])
    return found / _MOMENTS


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    ("slots", "motion", "dtype"),
    [
        (1, (0.0, 5.0), torch.float64), (3, (0.3, 0.0), torch.float64), (4, (2.5, -1.3), torch.float32),
        (3, (-4.0, -4.0), torch.float64),
    ],
)  # fmt: skip
def test_every_slot_sees_the_mean_of_what_passes(size, slots, motion, dtype):
    scene = torch.rand(2, *size).to(dtype)
    found = moving_scene(scene, motion, slots)
    assert found.dtype == dtype
    torch.testing.assert_close(found, slow(scene, motion, slots), atol=1e-5, rtol=0)


def test_motion_by_a_pixel_a_slot_is_a_shift_from_slot_to_slot_and_the_middle_lies_about_the_scene():
    scene = torch.rand(2, 9, 11)
    moved = moving_scene(scene, (0.0, 3.0), 3)
    around = (scene[..., :-2] + 6 * scene[..., 1:-1] + scene[..., 2:]) / 8  # bilinear, over half a pixel each way
    torch.testing.assert_close(moved[1][..., 1:-1], around)
    torch.testing.assert_close(moved[2][..., 1:], moved[1][..., :-1])
    torch.testing.assert_close(moved[0][..., 1:-2], moved[1][..., 2:-1])


@pytest.mark.parametrize("motion", [(9.0, 0.0), (0.0, -11.0), (float("nan"), 0.0)])
def test_a_motion_out_of_the_scene_is_refused(motion):
    with pytest.raises(SettingError, match="less than the scene's 9×11"):
        moving_scene(torch.rand(1, 9, 11), motion, 2)
    with pytest.raises(SettingError, match="finite numbers, less" if motion[0] != motion[0] else "expected less"):
        moving_scene(torch.rand(1, 9, 11), motion, 2)


@pytest.mark.parametrize("build", [SpectralCamera, LightFieldCamera])
def test_open_slots_see_of_a_moving_scene_what_one_exposure_sees(build):
    """The same aperture in all slots, shutters open: K = 4 is K = 1."""
    own = {"bands": 3} if build is SpectralCamera else {"views": 3}
    static = build(size=(9, 12), slots=1, shutter="open", seed=3, **own)
    aperture = static.codes()[0]
    slots = build(size=(9, 12), slots=4, shutter="open", aperture=aperture.expand(4, -1, -1), **own)
    scene = torch.rand(1, *static.scene_shape)
    one, four = (camera(moving_scenes(scene, (1.0, 3.0), camera.slots)) for camera in (static, slots))
    torch.testing.assert_close(one, four, atol=1e-6, rtol=1e-5)
    assert float((one - static(scene)).abs().max()) > 0.05
