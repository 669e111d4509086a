"""Measured spectra and the metamers made of them: what the eye sees is kept, what it does not see varies."""

from __future__ import annotations

import numpy as np
import pytest

from tmca.data.rendering import measured
from tmca.data.rendering import pictures as metamers
from tmca.data.rendering.photographs import linear_rgb


@pytest.fixture(scope="module")
def model():
    return metamers.colour_model(measured.reflectances("train"))


def test_training_and_test_materials_are_different():
    train, test = measured.reflectances("train"), measured.reflectances("test")
    assert min(len(train), len(test)) > 100
    for part in (train, test):
        assert part.shape[1] == 61
        assert part.min() >= 0
        assert part.max() <= 1
    assert np.abs(train[:, None] - test[None]).max(axis=2).min() > 1e-3


def test_the_observer_agrees_with_colour_science():
    import colour

    sd = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]["orange"]
    with colour.utilities.suppress_warnings(colour_runtime_warnings=True):
        xyz = colour.sd_to_XYZ(sd, illuminant=colour.SDS_ILLUMINANTS["D65"]) / 100
    expected = np.linalg.inv(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ) @ xyz
    reflectance = np.interp(measured.GRID_NM, sd.wavelengths, sd.values)
    np.testing.assert_allclose(measured.rgb_observer() @ reflectance, expected, atol=2e-3)


def test_any_colour_gets_a_reflectance_of_that_colour(model):
    rng = np.random.default_rng(0)
    corners = np.stack(np.meshgrid(*[[0.0, 0.5, 0.9]] * 3), axis=-1).reshape(1, -1, 3)
    rgb = np.concatenate([corners, 0.9 * rng.random(corners.shape) ** 2], axis=1).astype(np.float32)
    labels = rng.permutation(rgb.shape[1]).reshape(1, -1) % 7
    materials = metamers.region_materials(model, rgb.astype(float), labels, rng)
    amplitudes = metamers.black_amplitudes(labels, rng)
    spectra = metamers.pixel_reflectances(model, rgb, labels, materials, amplitudes)
    assert spectra.min() >= 0
    assert spectra.max() <= 1
    np.testing.assert_allclose(spectra @ measured.rgb_observer().T, rgb, atol=2e-6)


def test_photographs_are_linearised():
    import skimage.data
    from skimage.color import rgb2xyz, xyz2rgb

    rgb = linear_rgb("astronaut")
    assert rgb.max() == pytest.approx(0.9)
    # An independent sRGB decoder: linear sRGB to XYZ is a matrix, and white is (0.9505, 1, 1.089).
    xyz = rgb2xyz(skimage.data.astronaut()[::16, ::16])
    assert np.allclose(xyz2rgb(xyz), skimage.data.astronaut()[::16, ::16] / 255, atol=1e-3)
    luminance = rgb[::16, ::16] @ np.array([0.2126, 0.7152, 0.0722]) / 0.9
    np.testing.assert_allclose(luminance, xyz[..., 1], atol=1e-3)
