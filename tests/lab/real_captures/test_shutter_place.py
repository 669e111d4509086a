"""A pixel shutter's place and the beginning of its exposure, from captures of something that moves."""

import numpy as np
import pytest

from tmca.data import read_array
from tmca.errors import DataError, SettingError
from tmca.lab.prototype import load_prototype
from tmca.lab.registering import overlapping, shutter_place


def poured(size, slots, shift, first, seed=0, moves=True):
    """A bar that grows downwards, seen through a random shutter that lies elsewhere and begins with another slot."""
    rng = np.random.default_rng(seed)
    shutter = rng.integers(slots, size=size)
    place = np.roll(shutter, shift, axis=(0, 1))  # what the sensor really has
    time = (place - first) % slots / slots if moves else np.full(size, 0.5)
    rows, columns = np.indices(size)
    dark = (rows / size[0] < time) & (abs(columns - size[1] / 2) < size[1] / 6)
    values = 100.0 - 60 * dark + rng.standard_normal(size)
    return values, (shutter[..., None] == np.arange(slots)).astype(np.uint8)


@pytest.mark.parametrize(("size", "slots"), [((64, 80), 16), ((71, 65), 33)])
@pytest.mark.parametrize(("shift", "first"), [((0, 0), 0), ((-3, -2), 7), ((2, -4), 15)])
def test_place_and_beginning_are_found(size, slots, shift, first):
    values, shutter = poured(size, slots, shift, first)
    found = shutter_place(values, shutter)
    assert found[0] == shift
    assert abs((found[1] - first + slots // 2) % slots - slots // 2) <= 1
    assert shutter_place(values, shutter, fixed=shift) == found


def test_a_still_scene_tells_no_place():
    with pytest.raises(DataError, match="something that moves"):
        shutter_place(*poured((64, 80), 16, (1, 1), 0, moves=False))
    with pytest.raises(SettingError, match="one slot"):
        shutter_place(np.ones((8, 9)), np.ones((8, 9, 4)))


@pytest.mark.parametrize("shift", [(0, 0), (2, 0), (-1, 3)])
def test_displaced_patterns_lie_on_the_pixels_they_are_displaced_to(shift):
    patterns = np.arange(5 * 6).reshape(5, 6)
    values, own = overlapping(np.roll(patterns, shift, axis=(0, 1)), patterns, shift)
    np.testing.assert_array_equal(values, own)
    assert own.shape == (5 - abs(shift[0]), 6 - abs(shift[1]))


@pytest.mark.slow
def test_the_real_shutters_lie_and_begin_where_their_prototype_says(real_data):
    file = real_data / "cassi" / "pixel_shutter_wine" / "wine.mat"
    for name, stated in load_prototype("pixel-shutter-wine").captures.items():
        known = None if name == "rnd" else stated.shutter_shift  # the other shutter is a lattice
        found = shutter_place(read_array(file, stated.capture_key), read_array(file, stated.shutter_key), fixed=known)
        assert found == (stated.shutter_shift, stated.first_slot)
