"""Cubes in the colours that an eye would see."""

import numpy as np

from tmca.plots import linear_srgb, srgb_picture


def test_an_even_spectrum_is_white_and_a_long_one_red():
    cube = np.zeros((28, 2, 2))
    nm = np.linspace(450, 650, 28)
    cube[:, 0, 0], cube[nm > 600, 0, 1], cube[(nm > 510) & (nm < 560), 1, 0], cube[nm < 480, 1, 1] = 1, 1, 1, 1
    linear = linear_srgb(cube, nm * 1e-9)
    np.testing.assert_allclose(linear[:, 0, 0], 1, atol=1e-9)
    assert [int(linear[:, y, x].argmax()) for y, x in ((0, 1), (1, 0), (1, 1))] == [0, 1, 2]
    lamp = np.linspace(0.2, 1, 28)
    np.testing.assert_allclose(linear_srgb(lamp[:, None, None], nm * 1e-9, lamp)[:, 0, 0], 1)
    picture = srgb_picture(cube, nm * 1e-9)
    assert picture.shape == (2, 2, 3)
    assert picture.min() >= 0
    assert picture.max() <= 1
