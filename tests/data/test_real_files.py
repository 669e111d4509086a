"""Every real cube and capture is read with its axes, scale and wavelengths right."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.io

from tmca.data import describe, read, read_array, read_split
from tmca.errors import DataError

CUBES = {
    **{f"hsi/cave_uint8_512/{scene}.mat": ("orig", 31, 255, (400, 700))
       for scene in ("feathers", "paints", "toys", "sushi")},
    **{f"hsi/cave_uint16_256/{scene}_256.mat": ("NRD", 31, 65535, (400, 700))
       for scene in ("chart_and_stuffed_toy", "real_and_fake_apples")},
    **{f"hsi/cave_crops/{crop}.mat": ("Omsi", 31, 1, (400, 700))
       for crop in (*(f"kbrdn_testMSI_{number}" for number in (1, 2, 3)), "balloons_101_101_31")},
    "hsi/hdsp_ccassi/fullFlor.mat": ("Ori", 11, 14607, (429.5, 687)),
    "hsi/samson/Samson.mat": ("T", 156, 1, (401, 889)),
}  # fmt: skip
CUBES |= {
    f"hsi/cave_256/{scene}.mat": ("cube", 31, 65535, (400, 700))
    for scene in (
        "balloons", "beads", "cd", "chart_and_stuffed_toy", "clay", "fake_and_real_beers", "fake_and_real_food",
        "fake_and_real_lemon_slices", "fake_and_real_lemons", "fake_and_real_peppers", "fake_and_real_strawberries",
        "fake_and_real_sushi", "fake_and_real_tomatoes", "feathers", "flowers", "glass_tiles", "hairs", "paints",
        "pompoms", "real_and_fake_apples", "stuffed_toys", "thread_spools", "watercolors",
    )
}  # fmt: skip
CAPTURES = {
    "cassi/deepcassi_real_mask512.mat": ("mask", (512, 512)),
    "cassi/tsa/mask_256_sim.mat": ("mask", (256, 256)),
    "cassi/tsa/mask_660_real.mat": ("mask", (660, 660)),
    "cassi/tsa/real_scene1.mat": ("meas_real", (660, 714)),
    "cassi/tsa/real_scene2.mat": ("meas_real", (660, 714)),
    "cassi/tsa/real_scene3.mat": ("meas_real", (660, 714)),
}


@pytest.mark.parametrize("name", CUBES)
def test_a_real_cube_has_its_axes_scale_and_wavelengths(real_data, name):
    variable, count, scale, ends = CUBES[name]
    stored = scipy.io.loadmat(real_data / name)[variable]
    cube = read(real_data / name)
    assert cube.dims == ("wavelength", "y", "x")
    assert cube.dtype == np.float32
    assert (cube.attrs["variable"], cube.attrs["scale"]) == (variable, scale)
    assert cube.sizes["wavelength"] == count
    assert (cube.wavelength_nm.values[0], cube.wavelength_nm.values[-1]) == ends
    assert np.abs(cube.values - np.moveaxis(stored, -1, 0) / np.float32(scale)).max() <= 1e-7


@pytest.mark.parametrize("name", CAPTURES)
def test_a_real_capture_is_an_array_and_no_cube(real_data, name):
    variable, shape = CAPTURES[name]
    np.testing.assert_array_equal(read_array(real_data / name), scipy.io.loadmat(real_data / name)[variable])
    with pytest.raises(DataError, match=r"no array of three axes"):
        read(real_data / name)
    about = describe(real_data / name)
    assert (about["kind"], about["variable"], about["shape"]) == ("array", variable, list(shape))
    json.dumps(about, allow_nan=False)


def test_the_pixel_shutter_file_asks_which_variable(real_data):
    path = real_data / "cassi/pixel_shutter_wine/wine.mat"
    with pytest.raises(DataError, match=r"measO_roi.*measR_roi.*opt_mask.*rnd_mask"):
        read_array(path)
    with pytest.raises(DataError, match=r"opt_mask, rnd_mask"):
        read(path)
    shutter = read_array(path, "opt_mask")
    assert shutter.shape == (256, 256, 256)
    np.testing.assert_array_equal(shutter.sum(axis=2), 1)
    about = describe(path)
    assert set(about["variables"]) == {"measO_roi", "measR_roi", "opt_mask", "rnd_mask"}
    assert about["variables"]["opt_mask"]["mean"] == 1 / 256


@pytest.mark.parametrize("kind", ["spectral_train", "spectral_val", "spectral_test", "spectral_depth_train"])
def test_splits_hold(real_data, kind):
    scenes = read_split(real_data / "splits" / f"{kind}.txt")
    assert scenes
    assert all(scene.is_relative_to(real_data.resolve()) for scene in scenes)
