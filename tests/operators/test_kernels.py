"""All taps at once, as devices compute them, against tap by tap."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.operators import kernels

EVEN = {
    "one bucket": {"bands": 5, "slots": 2},
    "two buckets, three pixels": {"bands": 4, "slots": 2, "dispersion": 3.0, "buckets": 2, "shutter": "balanced"},
    "nothing displaced": {"bands": 3, "slots": 1, "dispersion": 0.0},
    "one band": {"bands": 1, "slots": 2},
    "wider than the frame": {"bands": 13, "slots": 2, "dispersion": 2.0},
    "dual disperser": {"bands": 3, "slots": 2, "disperser": "dual"},
}
UNEVEN = {"fractional": 0.5, "uneven": (0.0, 1.0, 3.0, 4.0), "backwards": (3.0, 2.0, 1.0, 0.0)}


def layout_of(taps):
    return taps.channels, taps.offsets, taps.scene_channels, taps.snapshot_width, taps.buckets


def inputs(taps):
    scene, snapshot = (torch.rand(2, *shape).double() for shape in (taps.scene_shape, taps.snapshot_shape))
    return scene, snapshot, taps.code.double()


def check_all_at_once(taps):
    layout, (scene, snapshot, code) = layout_of(taps), inputs(taps)
    assert kernels._even_step(layout) is not None
    for together, one_by_one, given in (
        (kernels.sheared_snapshot, kernels._snapshot_of_taps, (scene, code)),
        (kernels.sheared_scene, kernels._scene_of_taps, (code, snapshot)),
        (kernels.sheared_taps, kernels._code_of_taps, (snapshot, scene)),
    ):
        torch.testing.assert_close(together(*given, layout), one_by_one(*given, layout))
    assert kernels.sheared_scene(code, snapshot, layout).is_contiguous()


@pytest.mark.parametrize("settings", EVEN.values(), ids=EVEN)
@pytest.mark.parametrize("size", [(7, 11), (6, 8)])
def test_all_taps_at_once_are_one_after_the_other(settings, size):
    check_all_at_once(SpectralCamera(size=size, **settings).taps())


def test_a_part_of_a_camera_and_a_light_field_are_computed_at_once_too():
    check_all_at_once(SpectralCamera(4, (9, 12), slots=2).taps().window(2, 3, 5, 6))
    check_all_at_once(LightFieldCamera(3, (7, 9), 2).taps())


@pytest.mark.parametrize("dispersion", UNEVEN.values(), ids=UNEVEN)
def test_taps_in_uneven_steps_are_computed_one_by_one(dispersion):
    assert kernels._even_step(layout_of(SpectralCamera(4, (6, 8), slots=2, dispersion=dispersion).taps())) is None
