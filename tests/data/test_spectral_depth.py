"""Spectral scenes with depth: files and folders, spectra made up from RGB, cubes at drawn depths."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tests.data import rgbd_scenes as scenes
from tests.data.test_depth_maps import write as write_depth
from tests.data.test_read_formats import STATED, save_envi
from tmca.data import (
    describe,
    label_depth,
    label_spectral_depth,
    place_cube,
    read_rgbd,
    read_spectral_depth,
    rendered_scene,
    spectral_from_rgb,
    write_dataset,
)
from tmca.data.rendering import measured
from tmca.errors import DataError, SettingError, ShapeError, TmcaError

FIVE_NM = np.arange(400, 701, 5) * 1e-9


@pytest.fixture
def depth(cube):
    values = np.random.default_rng(5).uniform(0.4, 2.0, cube.shape[1:])
    values[2, 3] = 0
    return label_depth(values, "drawn")


# Files


@pytest.mark.parametrize("suffix", [".nc", ".h5", ".zarr"])
def test_a_written_scene_comes_back(tmp_path, cube, depth, suffix):
    path = write_dataset(label_spectral_depth(cube, depth, {"metric": True}), tmp_path / f"scene{suffix}")
    scene = read_spectral_depth(path)
    np.testing.assert_array_equal(scene["radiance"], cube)
    np.testing.assert_array_equal(scene["depth"], depth)
    assert scene["radiance"].dims == ("wavelength", "y", "x")
    assert scene["depth"].dtype == np.float32
    assert scene["depth"].attrs["unknown_pixels"] == 1
    assert scene.attrs["name"] == "scene"


def test_of_a_rendered_file_the_radiance_is_taken(tmp_path):
    rendered = rendered_scene("coffee", size=(20, 31))
    path = write_dataset(rendered, tmp_path / "coffee.nc")
    scene = read_spectral_depth(path)
    np.testing.assert_array_equal(scene["radiance"], rendered["radiance"])
    np.testing.assert_array_equal(
        read_spectral_depth(path, variable="reflectance")["radiance"], rendered["reflectance"]
    )
    np.testing.assert_array_equal(scene["depth"], rendered["depth"])


def write_cube(folder, kind, values, nm):
    """``(L, H, W)`` under one of the two names of the convention."""
    if kind == "cube.hdr":
        save_envi(folder, values, nm, "bil", "Nanometers").rename(folder / kind)
        (folder / "scene.raw").rename(folder / "cube.raw")
    elif kind == "spectral.npy":
        np.save(folder / kind, values)
        (folder / "spectral.wavelengths.txt").write_text("\n".join(map(str, nm)))
    else:
        STATED["five.mat" if kind == "cube.mat" else "nm.nc"](folder / kind, values, nm)


@pytest.mark.parametrize(
    ("cube_name", "depth_name"),
    [("cube.mat", "depth.mat"), ("spectral.npy", "depth.png"), ("cube.hdr", "depth.pfm"), ("spectral.nc", "depth.mat")],
)
def test_a_folder_with_cube_and_depth_map_is_a_scene(tmp_path, pixels, nm, cube_name, depth_name):
    metres = np.random.default_rng(6).uniform(0.4, 2.0, pixels.shape[1:])
    write_cube(tmp_path, cube_name, pixels, nm)
    write_depth(tmp_path / depth_name, metres)
    scene = read_spectral_depth(tmp_path)
    np.testing.assert_allclose(scene["radiance"], pixels, atol=1e-6)
    np.testing.assert_allclose(scene["wavelength"], nm * 1e-9)
    np.testing.assert_allclose(scene["depth"], metres, atol=6e-4)
    about = describe(tmp_path)
    assert about["kind"] == "spectral-depth scene"
    assert about["wavelengths"]["count"] == 7
    assert about["depth"]["unknown_pixels"] == 0
    assert set(about["variables"]) > {"depth"}


def test_parts_that_are_missing_doubled_or_of_another_size_are_named(tmp_path, pixels, nm):
    write_cube(tmp_path, "cube.mat", pixels, nm)
    for reader in (read_spectral_depth, describe):
        with pytest.raises(DataError, match=r"found no depth\.\* beside cube.mat"):
            reader(tmp_path)
    write_depth(tmp_path / "depth.mat", np.ones((10, 12)))
    for reader in (read_spectral_depth, describe):
        with pytest.raises(DataError, match=r"10×12 pixels, expected 10×13"):
            reader(tmp_path)
    write_depth(tmp_path / "depth.png", np.ones((10, 13)))
    with pytest.raises(DataError, match=r"depth.mat, depth.png"):
        read_spectral_depth(tmp_path)
    (tmp_path / "cube.mat").unlink()
    with pytest.raises(DataError, match=r"expected cube\.\* or spectral\.\*, and depth\.\*"):
        read_spectral_depth(tmp_path)


def test_a_cube_without_depth_is_no_scene(tmp_path, cube):
    path = write_dataset(cube, tmp_path / "cube_alone.nc")
    with pytest.raises(DataError, match=r"cube_alone.nc: found no depth in it \(cube\).*place_cube"):
        read_spectral_depth(path)
    assert describe(path)["depth"] is None


def test_rgb_is_only_converted_where_that_is_asked_for(tmp_path):
    stem = scenes.open3d(tmp_path)
    with pytest.raises(DataError, match=r"an RGB picture with depth, expected a spectral scene; .*from_rgb=True"):
        read_spectral_depth(stem)
    scene = read_spectral_depth(stem, from_rgb=True, wavelengths=FIVE_NM[::4], seed=3, illuminant="A")
    assert scene["radiance"].shape == (16, 40, 60)
    assert scene["depth"].attrs["unknown_pixels"] == 5
    assert scene.attrs["spectra_seed"] == 3
    assert scene.attrs["format"] == "Open3D"
    direct = spectral_from_rgb(read_rgbd(stem)["rgb"], FIVE_NM[::4], 3, illuminant="A")
    np.testing.assert_array_equal(scene["radiance"], direct["radiance"])


def test_a_reduced_scene_averages_light_and_samples_depth(tmp_path, cube, depth):
    path = write_dataset(label_spectral_depth(cube, depth), tmp_path / "scene.nc")
    small = read_spectral_depth(path, reduce=3)
    means = cube.values[:, :9, :12].reshape(7, 3, 3, 4, 3).mean(axis=(2, 4))
    np.testing.assert_allclose(small["radiance"], means, atol=1e-6)
    np.testing.assert_array_equal(small["depth"], depth.values[1:9:3, 1:12:3])
    stem = scenes.open3d(tmp_path)
    made = read_spectral_depth(stem, from_rgb=True, reduce=2)
    np.testing.assert_array_equal(made["depth"], read_rgbd(stem, scale=2)["depth"])
    with pytest.raises(SettingError, match="a whole number, 1 to 10"):
        read_spectral_depth(path, reduce=0)


# Spectra made up from RGB


def patches(size=(40, 60)):
    """``(3, H, W)``: four quadrants, of which two diagonal ones have one colour."""
    rgb = np.empty((3, *size), np.float32)
    rgb[:] = np.array([0.2, 0.35, 0.5])[:, None, None]
    height, width = size[0] // 2, size[1] // 2
    rgb[:, :height, width:] = np.array([0.6, 0.1, 0.1])[:, None, None]
    rgb[:, height:, :width] = np.array([0.05, 0.4, 0.1])[:, None, None]
    return rgb


@pytest.mark.parametrize("size", [(40, 60), (37, 51)])
@pytest.mark.parametrize("materials", ["train", "test"])
def test_the_colours_are_kept_under_daylight(size, materials):
    rgb = np.random.default_rng(7).uniform(0, 1, (3, *size)).astype(np.float32)
    rgb[:, :20] = patches(size)[:, :20]
    scene = spectral_from_rgb(rgb, FIVE_NM, 1, materials=materials)
    seen = np.einsum("cl,lyx->cyx", measured.rgb_observer(), scene["reflectance"].values)
    np.testing.assert_allclose(seen, 0.9 * rgb, atol=3e-3)
    assert 0 <= float(scene["radiance"].min()) <= float(scene["radiance"].max()) <= 1
    np.testing.assert_allclose(scene["radiance"], scene["reflectance"] * scene["illuminant"], atol=2.5e-3)


def test_one_colour_has_other_spectra_in_another_region_and_under_another_seed():
    first, other = (spectral_from_rgb(patches(), seed=seed)["reflectance"].values for seed in (0, 1))
    here, there = first[:, 5, 5], first[:, 35, 55]
    assert np.abs(here - there).max() > 0.02
    assert np.abs(here - other[:, 5, 5]).max() > 0.02
    again = spectral_from_rgb(patches(), seed=0)["reflectance"].values
    np.testing.assert_array_equal(first, again)


# Cubes at drawn depths


@pytest.fixture(scope="module")
def textured():
    return rendered_scene("coffee", size=(81, 100))["radiance"].assign_attrs(name="coffee")


@pytest.mark.parametrize("kind", ["plane", "slanted", "staged", "smooth", "pieces", "random"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_cube_is_placed_within_the_range(textured, kind, seed):
    scene = place_cube(textured, 0.4, 2.0, seed, kind)
    np.testing.assert_array_equal(scene["radiance"], textured)
    depth = scene["depth"].values
    assert depth.shape == (81, 100)
    assert depth.dtype == np.float32
    assert 0.4 * (1 - 1e-6) <= depth.min() <= depth.max() <= 2.0 * (1 + 1e-6)
    if kind == "plane":
        assert np.ptp(depth) == 0
    else:
        np.testing.assert_allclose([depth.min(), depth.max()], [0.4, 2.0], rtol=1e-5)
    assert scene.attrs["placed"] == kind
    assert scene.identical(place_cube(textured, 0.4, 2.0, seed, kind))
    assert not np.array_equal(depth, place_cube(textured, 0.4, 2.0, seed + 10, kind)["depth"])
    assert not np.array_equal(depth, place_cube(textured.assign_attrs(name="tea"), 0.4, 2.0, seed, kind)["depth"])


def test_a_slanted_plane_is_linear_in_inverse_depth(textured):
    inverse = 1 / place_cube(textured, 0.5, 1.5, 4, "slanted")["depth"].values.astype(np.float64)
    y, x = np.mgrid[:81, :100]
    terms = np.column_stack([y.ravel(), x.ravel(), np.ones(y.size)])
    fit, *_ = np.linalg.lstsq(terms, inverse.ravel(), rcond=None)
    np.testing.assert_allclose(terms @ fit, inverse.ravel(), rtol=1e-6)


def test_depths_are_drawn_evenly_in_inverse_depth(textured):
    near, far = 0.4, 2.0

    def shares(values):
        share = (1 / np.asarray(values, dtype=np.float64) - 1 / far) / (1 / near - 1 / far)
        return np.sort(share.ravel())

    smooth = shares(place_cube(textured, near, far, 1, "smooth")["depth"].values)
    np.testing.assert_allclose(smooth, np.linspace(0, 1, smooth.size), atol=1e-4)
    planes = shares([place_cube(textured, near, far, seed, "plane")["depth"].values[0, 0] for seed in range(60)])
    # Kolmogorov's bound at 0.1 %.
    assert np.abs(planes - (np.arange(60) + 0.5) / 60).max() < 1.95 / np.sqrt(60)
    pieces = shares([place_cube(textured, near, far, seed, "pieces")["depth"].values for seed in range(12)])
    assert abs(pieces.mean() - 0.5) < 0.12


def test_staged_depth_follows_the_cubes_own_edges(textured):
    depth = place_cube(textured, 0.4, 2.0, 0, "staged")["depth"].values
    grey = textured.values.mean(axis=0)
    step = np.abs(np.diff(1 / depth, axis=1)) > 0.1
    edge = np.abs(np.diff(grey, axis=1))
    assert edge[step].mean() > 1.5 * edge[~step].mean()


@pytest.mark.parametrize(
    ("settings", "error", "where"),
    [
        ({"rgb": np.zeros((4, 5, 6), np.float32)}, ShapeError, "rgb"), ({"rgb": 2 * patches()}, DataError, "rgb"),
        ({"rgb": np.full((3, 4, 5), np.nan)}, DataError, "rgb"),
        ({"wavelengths": [300e-9]}, SettingError, "wavelengths"), ({"seed": -1}, SettingError, "seed"),
        ({"illuminant": "sun"}, SettingError, "illuminant"), ({"materials": "all"}, SettingError, "materials"),
    ],
)  # fmt: skip
def test_impossible_pictures_and_settings_are_refused(settings, error, where):
    with pytest.raises(error) as caught:
        spectral_from_rgb(**{"rgb": patches(), **settings})
    assert caught.value.where == where


@pytest.mark.parametrize(
    ("settings", "where"),
    [
        *((ends, "near, far") for ends in ({"near": 0}, {"far": 0.3}, {"far": np.inf})),
        ({"seed": 1.5}, "seed"), ({"kind": "wavy"}, "kind"), ({"cube": xr.DataArray(np.ones((3, 4)))}, "cube"),
    ],
)  # fmt: skip
def test_impossible_placings_are_refused(cube, settings, where):
    with pytest.raises(TmcaError) as caught:
        place_cube(**{"cube": cube, "near": 0.4, "far": 2.0, "seed": 0, "kind": "plane", **settings})
    assert caught.value.where == where


def test_the_two_halves_of_the_materials_differ():
    train, test = (spectral_from_rgb(patches(), materials=part)["reflectance"] for part in ("train", "test"))
    assert float(np.abs(train - test).max()) > 0.02
