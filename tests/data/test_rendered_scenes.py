"""Rendered scenes: complete, repeatable, of the photograph's colours and of real spectra's diversity."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io
import skimage.data

from tmca.data import pixels as resample
from tmca.data import rendered_names, rendered_scene, split_rendered
from tmca.data.rendering import measured
from tmca.data.rendering import pictures as metamers
from tmca.data.rendering.photographs import PHOTOGRAPHS, linear_rgb, motorcycle_depth, photograph
from tmca.errors import SettingError

BANDS_12 = np.linspace(400e-9, 700e-9, 12)
FIVE_NM = np.arange(400, 701, 5) * 1e-9


@pytest.fixture(scope="module")
def scenes():
    return {name: rendered_scene(name, size=(128, 128)) for name in rendered_names()}


@pytest.mark.slow
def test_every_scene_is_complete(scenes):
    for name, scene in scenes.items():
        assert scene.radiance.dims == ("wavelength", "y", "x")
        assert scene.radiance.shape == scene.reflectance.shape == (31, 128, 128)
        np.testing.assert_allclose(scene.wavelength, np.arange(400, 701, 10) * 1e-9)
        for cube in (scene.radiance, scene.reflectance):
            assert cube.dtype == np.float32
            assert 0 <= float(cube.min()) < float(cube.max()) <= 1
        assert all({"units", "long_name"} <= set(variable.attrs) for variable in scene.variables.values())
        near, far = PHOTOGRAPHS[name].near, PHOTOGRAPHS[name].far
        assert near - 1e-3 <= float(scene.depth.min()) < float(scene.depth.max()) <= far + 1e-3
        assert scene.attrs["credit"]
        assert scene.attrs["split"] in ("train", "test")
        assert scene.attrs["seed"] == 0


def test_the_split_covers_all_scenes_and_keeps_the_motorcycle_for_tests():
    split = split_rendered()
    assert set(split["train"]) | set(split["test"]) == set(rendered_names())
    assert not set(split["train"]) & set(split["test"])
    assert "motorcycle" in split["test"]


@pytest.mark.parametrize("name", ["coffee", "motorcycle", pytest.param("rocket", marks=pytest.mark.slow)])
def test_colours_are_those_of_the_photograph(name):
    scene = rendered_scene(name, wavelengths=FIVE_NM)
    seen = np.moveaxis(np.tensordot(measured.rgb_observer(), scene.reflectance.values, 1), 0, -1)
    error = np.abs(seen - linear_rgb(photograph(name)))
    assert error.max() < 2.5e-3
    assert error.mean() < 3e-4


def test_radiance_is_reflectance_times_illuminant():
    scene = rendered_scene("chelsea", size=(60, 60), illuminant="A")
    assert scene.attrs["illuminant"] == "A"
    assert float(scene.illuminant.max()) == 1
    np.testing.assert_allclose(scene.radiance, scene.reflectance * scene.illuminant, atol=2e-3)


def test_a_lone_band_is_one_of_ten_nanometres():
    alone = rendered_scene("coffee", wavelengths=[550e-9], size=(12, 15))["reflectance"]
    among = rendered_scene("coffee", wavelengths=[540e-9, 550e-9, 560e-9], size=(12, 15))["reflectance"]
    np.testing.assert_allclose(alone.values[0], among.values[1], atol=1e-6)


@pytest.mark.usefixtures("rendered_anew")
def test_the_same_seed_gives_the_same_scene_and_another_seed_another():
    first, again, other = (rendered_scene("coffee", size=(64, 64), seed=seed) for seed in (3, 3, 4))
    assert first.identical(again)
    assert float(np.abs(first.reflectance - other.reflectance).max()) > 0.05
    assert float(np.abs(first.depth - other.depth).max()) > 0.01


def test_a_colour_does_not_tell_its_spectrum():
    """Pixels of one colour (to 1 %) differ in spectrum by more than such a difference of colour explains."""
    scene = rendered_scene("astronaut", size=(128, 128)).reflectance.values.reshape(31, -1).T
    rgb = scene @ (measured.rgb_observer() @ _interpolation(scene.shape[1])).T
    rng = np.random.default_rng(0)
    angles = []
    for pixel in rng.choice(np.flatnonzero(rgb.min(axis=1) > 0.1), 200):
        alike = np.flatnonzero(np.abs(rgb - rgb[pixel]).max(axis=1) < 0.01 * rgb[pixel].max())
        cosine = scene[alike] @ scene[pixel] / np.linalg.norm(scene[alike], axis=1) / np.linalg.norm(scene[pixel])
        angles.extend(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    assert np.percentile(angles, 90) > 3


def _interpolation(bands):
    """``(61, bands)``: a 5 nm spectrum from evenly spaced bands, by linear interpolation."""
    positions = np.linspace(0, bands - 1, 61)
    return np.maximum(1 - np.abs(positions[:, None] - np.arange(bands)), 0)


def _components(cube, share):
    spectra = cube.reshape(len(cube), -1).T.astype(np.float64)
    energy = np.linalg.eigvalsh(np.cov(spectra.T))[::-1]
    return int(np.searchsorted(np.cumsum(energy) / energy.sum(), share) + 1)


def _unexplained(cube):
    """Share of the energy that no linear function of RGB predicts."""
    spectra = cube.reshape(len(cube), -1).T.astype(np.float64)
    rgb = spectra @ (measured.rgb_observer() @ _interpolation(len(cube))).T
    predicted = rgb @ np.linalg.lstsq(rgb, spectra, rcond=None)[0]
    return np.sum((spectra - predicted) ** 2) / np.sum(spectra**2)


@pytest.mark.slow
def test_spectra_are_as_diverse_as_real_ones(scenes, real_data):
    folder = real_data / "hsi" / "cave_uint8_512"
    files = [scipy.io.loadmat(folder / f"{name}.mat")["orig"] for name in ("feathers", "paints", "toys")]
    cubes = [np.moveaxis(cube[::2, ::2] / 255.0, -1, 0) for cube in files]
    real = [_components(cube, 0.999) for cube in cubes]
    rendered = [_components(scene.radiance.values, 0.999) for scene in scenes.values()]
    assert min(real) <= min(rendered)
    assert max(rendered) <= max(real) + 1
    assert 0.3 * min(map(_unexplained, cubes)) < np.median([_unexplained(s.radiance.values) for s in scenes.values()])
    assert np.median([_unexplained(s.radiance.values) for s in scenes.values()]) < 1.5 * max(map(_unexplained, cubes))


def test_measured_depth_follows_the_calibration():
    depth, disparity = motorcycle_depth(), skimage.data.stereo_motorcycle()[2]
    known = np.isfinite(disparity)
    assert np.array_equal(np.isfinite(depth), known)
    # Similar triangles: (d + Δcx) / f = B / Z.
    np.testing.assert_allclose((disparity[known] + 31.086) * depth[known], 994.978 * 0.193001, rtol=1e-5)


def test_bands_are_means_over_their_width():
    weights = metamers.band_weights(np.array([450e-9, 500e-9, 600e-9]))
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    centres = weights @ measured.GRID_NM
    # 425–475, 475–550 and 550–650 nm.
    np.testing.assert_allclose(centres, [450, 512.5, 600], atol=0.1)
    assert (metamers.band_weights(np.array([550e-9])) @ measured.GRID_NM)[0] == pytest.approx(550)


@pytest.mark.parametrize(("old", "new"), [(8, 4), (9, 4), (7, 7), (512, 100)])
def test_area_averages_keep_the_mean(old, new):
    weights = resample.area_weights(old, new)
    np.testing.assert_allclose(weights.sum(axis=1), 1, rtol=1e-5)
    np.testing.assert_allclose(weights.sum(axis=0), new / old, rtol=1e-5)
    image = np.random.default_rng(0).random((2, old, old)).astype(np.float32)
    np.testing.assert_allclose(resample.area_average(image, (new, new)).mean(), image.mean(), rtol=1e-5)
    if old == 2 * new:
        blocks = image.reshape(2, new, 2, new, 2).mean(axis=(2, 4))
        np.testing.assert_allclose(resample.area_average(image, (new, new)), blocks, rtol=1e-5)


def test_uneven_bands_and_odd_sizes_are_rendered():
    bands = np.array([423e-9, 471e-9, 520e-9, 650e-9])
    scene = rendered_scene("chelsea", wavelengths=bands, size=(37, 90))
    assert scene.radiance.shape == (4, 37, 90)
    np.testing.assert_array_equal(scene.wavelength, bands)
    assert rendered_scene("chelsea", wavelengths=BANDS_12).radiance.shape == (12, 300, 451)


@pytest.mark.parametrize(
    ("settings", "where"),
    [
        ({"name": "eileen"}, "name"), ({"size": (1024, 10)}, "size"), ({"size": (0, 10)}, "size"),
        *(({"wavelengths": waves}, "wavelengths") for waves in ([450, 550], [550e-9, 450e-9], [])),
        ({"illuminant": "sun"}, "illuminant"), ({"seed": -1}, "seed"), ({"seed": 0.5}, "seed"),
    ],
)  # fmt: skip
def test_impossible_requests_are_refused_by_name(settings, where):
    with pytest.raises(SettingError) as caught:
        rendered_scene(**{"name": "astronaut", **settings})
    assert caught.value.where == where


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

    rgb = linear_rgb(photograph("astronaut"))
    assert rgb.max() == pytest.approx(0.9)
    # An independent sRGB decoder: linear sRGB to XYZ is a matrix, and white is (0.9505, 1, 1.089).
    xyz = rgb2xyz(skimage.data.astronaut()[::16, ::16])
    assert np.allclose(xyz2rgb(xyz), skimage.data.astronaut()[::16, ::16] / 255, atol=1e-3)
    luminance = rgb[::16, ::16] @ np.array([0.2126, 0.7152, 0.0722]) / 0.9
    np.testing.assert_allclose(luminance, xyz[..., 1], atol=1e-3)
