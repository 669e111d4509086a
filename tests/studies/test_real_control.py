"""Known scenes behind a real mask."""

import numpy as np
import pytest
import torch

from studies.real.control import image_behind, known_scene
from tmca.cameras import Snapshot, SpectralCamera
from tmca.errors import DataError
from tmca.sensor import Sensor

NM = np.linspace(450, 650, 5)


def capture(size=(31, 40), noise=0.0):
    sensor = Sensor(read_noise=noise)
    bands = (NM * 1e-9).tolist()
    camera = SpectralCamera(bands=bands, size=size, slots=1, shutter="open", dispersion=2.0, sensor=sensor)
    return Snapshot(torch.zeros(1, 1, size[0], size[1] + 8), camera)


def test_a_known_scene_is_seen_by_the_middle_of_the_mask():
    taken = capture()
    scene = torch.rand(1, 5, 20, 17, generator=torch.Generator().manual_seed(0))
    found = image_behind(taken, scene)
    frame = torch.zeros(1, 5, 31, 40)
    frame[:, :, 5:25, 11:28] = scene
    whole = taken.camera.A(frame)
    torch.testing.assert_close(found.values, whole[..., 5:25, 11 : 28 + 8])
    assert not whole[..., :11].any()
    assert found.camera.sensor is taken.camera.sensor


def test_the_middle_of_a_scene_at_the_bands_of_the_camera():
    camera = capture((31, 300)).camera
    scene = known_scene("coffee", camera)
    assert scene.shape == (1, 5, 31, 256)
    from tmca.data import rendered_scene

    cube = rendered_scene("coffee")["radiance"]
    known = cube.wavelength.values * 1e9
    wanted = np.apply_along_axis(lambda spectrum: np.interp(NM, known, spectrum), 0, cube.values)
    top, left = (cube.sizes["y"] - 31) // 2, (cube.sizes["x"] - 256) // 2
    np.testing.assert_allclose(scene[0], wanted[:, top : top + 31, left : left + 256], rtol=1e-4, atol=1e-6)


def test_scenes_of_other_bands_are_refused():
    camera = SpectralCamera(bands=[350e-9, 650e-9], size=(8, 9), slots=1, shutter="open")
    with pytest.raises(DataError, match="expected all of 350 to 650 nm"):
        known_scene("coffee", camera)
