"""Scenes with depth on the command line: what inspect says and draws, and what it refuses in one line."""

import numpy as np
import pytest
from PIL import Image

from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tests.data import rgbd_scenes as scenes
from tmca.data import label_depth, label_spectral_depth, rendered_scene, write_dataset


def test_an_rgbd_scene_is_told_in_figures(capsys, tmp_path):
    text = said(capsys, "inspect", scenes.open3d(tmp_path))
    assert "RGB-D scene (Open3D)" in text
    assert "rgb: 3 × 40 × 60" in text
    assert "5 of 2400 pixels unknown (0.2%: 5 zero)" in text
    stem, _ = scenes.hole_filled(tmp_path / "art")
    assert "depth: known only up to an affine map of inverse depth; 1 of" in said(capsys, "inspect", stem)
    depth = answer(capsys, "inspect", stem)["depth"]
    assert not {"near", "far"} & set(depth)
    assert depth["unknown_pixels"] == 1


def test_a_spectral_scene_with_depth_is_told_in_figures(capsys):
    write_dataset(rendered_scene("coffee", size=(20, 30)), "coffee.nc")
    text = said(capsys, "inspect", "coffee.nc")
    assert "wavelengths: 31 bands, 400 to 700 nm" in text
    assert "0 of 600 pixels unknown" in text


@pytest.mark.parametrize("kind", ["rgbd", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("cube", "folder"))])
def test_the_picture_shows_scene_and_depth(capsys, tmp_path, kind):
    if kind == "rgbd":
        path = scenes.nyuv2(tmp_path)
    else:
        scene = rendered_scene("coffee", size=(20, 30))
        path = tmp_path / "coffee.nc"
        if kind == "cube":
            write_dataset(label_spectral_depth(scene["radiance"], label_depth(scene["depth"].values, "")), path)
        else:
            path = tmp_path / "scene"
            path.mkdir()
            write_dataset(scene["radiance"], path / "cube.nc")
            np.save(path / "depth.npy", scene["depth"].values)
    assert "figure: seen.png" in said(capsys, "inspect", path, "--figure", "seen.png")
    with Image.open("seen.png") as picture:
        assert picture.width > 1.5 * picture.height
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colours, axis=0)) > 500


def test_the_spectral_camera_refuses_rgb(capsys, tmp_path):
    stem = scenes.open3d(tmp_path)
    for path in (stem, tmp_path / "room_color_3.png"):
        assert "an RGB picture with depth, expected a spectral scene" in refused(capsys, "simulate", "spectral", path)
    assert "reflectances: --from-rgb" in refused(capsys, "simulate", "spectral-depth", stem)
    scenes.write_picture(tmp_path / "alone.png", scenes.picture())
    assert "colour channels, expected a spectral cube" in refused(capsys, "simulate", "spectral", "alone.png")
