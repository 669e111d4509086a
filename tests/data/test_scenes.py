"""Scenes of every camera are read by one function; and what tells that their files have changed."""

import json

import numpy as np
import pytest
from PIL import Image

from tests.data import rgbd_scenes
from tmca.data import (
    label_light_field,
    load_light_field,
    load_scene,
    load_spectral_depth,
    read_scene,
    write_dataset,
    write_light_field,
)
from tmca.data.depth_scenes import check_depth_scene
from tmca.data.scene_names import identity_of
from tmca.data.scenes import scene_kind
from tmca.errors import DataError, SettingError


def test_a_scene_named_by_its_stem_is_known_by_all_of_its_files(tmp_path):
    stem = rgbd_scenes.open3d(tmp_path)
    whole = identity_of(str(stem))
    assert whole is not None
    assert identity_of(str(tmp_path / "room_color_3.png")) == whole  # the depth beside it counts too
    rgbd_scenes.write_picture(tmp_path / "room_color_4.png", rgbd_scenes.picture(seed=1))
    assert identity_of(str(stem)) == whole
    (tmp_path / "camera_primesense.json").write_text(json.dumps({"width": 60}))
    calibrated = identity_of(str(stem))
    rgbd_scenes.write_picture(tmp_path / "room_depth_3.png", rgbd_scenes.millimetres()[:, ::-1].copy())
    assert len({whole, calibrated, identity_of(str(stem))}) == 3


@pytest.mark.parametrize("name", ["coffee", "coffee:1", "none/00050", "none.nc"])
def test_what_is_no_file_has_no_checksum(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    rgbd_scenes.hole_filled(tmp_path, scene="coffee")  # the rendered scene is the one that is meant
    assert identity_of(name) is None


def test_a_scene_is_read_as_what_its_file_holds(tmp_path):
    cube = load_scene("coffee", size=(16, 20))
    with_depth = load_spectral_depth("coffee", reduce=20)
    views = load_light_field("coffee", views=3, size=(16, 20))
    files = {
        "cube": cube.to_dataset(name="radiance"),
        "depth": with_depth,
        "views": views.to_dataset(name="light_field"),
    }
    for name, dataset in files.items():
        write_dataset(dataset, tmp_path / f"{name}.nc")
    assert [scene_kind(tmp_path / f"{name}.nc") for name in files] == ["spectral", "spectral-depth", "light-field"]
    np.testing.assert_allclose(read_scene(tmp_path / "cube.nc"), cube, atol=1e-6)
    np.testing.assert_allclose(read_scene(tmp_path / "depth.nc")["depth"], with_depth["depth"])
    np.testing.assert_allclose(read_scene(tmp_path / "views.nc", views=3), views, atol=1e-6)


@pytest.mark.parametrize(("size", "side"), [((24, 36), 24), ((41, 30), 30)])
def test_what_a_scene_is_and_its_shorter_side_are_told_without_reading_it(tmp_path, size, side):
    cube = load_scene("coffee", bands=3, size=size)
    write_dataset(cube, tmp_path / "cube.nc")
    (tmp_path / "both").mkdir()
    write_dataset(cube, tmp_path / "both" / "cube.nc")
    np.save(tmp_path / "both" / "depth.npy", np.ones(size))
    rgbd_scenes.write_picture(tmp_path / "a" / "view1.png", rgbd_scenes.picture(size))
    rgbd_scenes.write_picture(tmp_path / "a" / "disp1.png", np.full(size, 100, np.uint8))
    for name, camera, kind in (
        ("cube.nc", "spectral", "cube"),
        ("both", "spectral-depth", "spectral-depth scene"),
        ("a", "spectral-depth", "RGB-D scene"),
    ):
        assert scene_kind(tmp_path / name) == camera
        assert check_depth_scene(str(tmp_path / name), "plane", True) == (kind, side)


def test_a_rendered_scene_is_read_for_the_camera_that_is_named():
    assert read_scene("coffee", bands=5, size=(16, 20)).dims == ("wavelength", "y", "x")
    assert read_scene("coffee", "light-field", views=3, size=(16, 20)).dims == ("view_v", "view_u", "y", "x")
    scene = read_scene("coffee", "spectral-depth", reduce=20, near=0.5, far=2.0)
    assert 0.5 <= scene["depth"].min() < 0.6 < 1.5 < scene["depth"].max() <= 2.0


def test_a_cube_is_placed_only_in_a_range_of_depths(tmp_path):
    write_dataset(load_scene("coffee", size=(16, 20)).to_dataset(name="radiance"), tmp_path / "cube.nc")
    with pytest.raises(SettingError) as caught:
        load_spectral_depth(str(tmp_path / "cube.nc"), placed="plane")
    assert caught.value.where == "near"


def test_a_light_field_is_no_spectral_scene(tmp_path):
    views = np.random.default_rng(0).random((3, 3, 8, 9)).astype(np.float32)
    file = write_light_field(label_light_field(views), tmp_path / "views.nc")
    with pytest.raises(DataError, match=r"found a light field, expected a spectral.* tmca simulate light-field"):
        load_scene(str(file))


def test_one_picture_is_no_light_field(tmp_path):
    Image.fromarray(np.zeros((30, 43), np.uint8)).save(tmp_path / "view.png")
    with pytest.raises(DataError, match="give the folder of the views: one picture is no light field"):
        load_light_field(str(tmp_path / "view.png"))
