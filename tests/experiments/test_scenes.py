"""Scenes of experiments: what tells that their files have changed."""

import json

import pytest

from tests.data import rgbd_scenes
from tmca.experiments.scenes import identity_of


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
