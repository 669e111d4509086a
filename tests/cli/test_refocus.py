"""Light fields focused after the exposure, and scenes with depth as points, from the command line."""

import json

import numpy as np
import pytest
import tifffile
import xarray as xr
from PIL import Image

import tmca
from tests.cli.refusals import refused
from tests.data.test_point_cloud import read_back
from tests.metrics.test_refocusing import two_surfaces
from tmca.cli import main
from tmca.data import find_disparity, label_light_field, write_dataset
from tmca.data.in_memory import SceneWarning
from tmca.metrics import refocus


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A light field in a file, and an estimate of one."""
    place = tmp_path_factory.mktemp("refocus")
    field, _, _ = two_surfaces()
    views = np.clip(field[1:4, 1:4, 10:50, 15:60], 0, 1).astype(np.float32)
    write_dataset(label_light_field(views), place / "views.nc")
    camera = tmca.LightFieldCamera(slots=2, shutter="one-hot", period=4)
    snapshot = tmca.simulate(label_light_field(views), camera)
    tmca.reconstruct(snapshot, "dagger").save(place / "estimate.nc")
    return place


@pytest.fixture(autouse=True)
def there(folder, monkeypatch):
    monkeypatch.chdir(folder)


def test_photographs_are_those_of_the_views(folder):
    values = xr.load_dataarray("views.nc").values
    main(["refocus", "views.nc", "--disparity", "-1,0,1", "--out", "three.nc"])
    stack = xr.load_dataset("three.nc")["refocused"]
    assert stack["disparity"].values.tolist() == [-1, 0, 1]
    np.testing.assert_allclose(stack.values[2], refocus(values, 1.0), atol=1e-6)
    np.testing.assert_allclose(tmca.refocus("views.nc", 1.0).values, stack.values[2], atol=1e-6)
    main(["refocus", "views.nc", "--disparity", "-1,0,1", "--out", "three.tif"])
    np.testing.assert_allclose(tifffile.imread("three.tif"), stack.values, atol=1e-6)


def test_one_is_a_picture_and_several_are_a_strip_or_move(folder, capsys):
    main(["refocus", "views.nc", "--disparity=-1", "--out", "one.png"])
    assert Image.open("one.png").size == (45, 40)
    main(["refocus", "views.nc", "--sweep", "3", "--json"])
    steps = json.loads(capsys.readouterr().out.partition("\n")[2])["disparity"]
    assert steps == pytest.approx([-1, 0, 1], abs=0.1)
    assert Image.open("views_refocus.png").size[0] > 500
    main(["refocus", "views.nc", "--sweep", "3", "--out", "moving.gif"])
    assert Image.open("moving.gif").n_frames == 4


def test_an_estimate_carries_what_its_views_show(folder, capsys):
    stored = xr.load_dataset("estimate.nc")
    assert {"disparity", "confidence", "all_in_focus"} <= set(stored)
    assert stored["disparity"].attrs["units"] == "px per view step"
    main(["refocus", "estimate.nc", "--all-in-focus", "--out", "sharp.nc"])
    xr.testing.assert_allclose(xr.load_dataset("sharp.nc"), stored[["disparity", "confidence", "all_in_focus"]])
    assert find_disparity("estimate.nc") is None  # it is no truth
    capsys.readouterr()
    main(["inspect", "views.nc", "--json"])
    assert json.loads(capsys.readouterr().out)["light_field"]["disparity_seen"] == pytest.approx([-1, 1], abs=0.1)
    seen = []
    for words in (["inspect", "estimate.nc"], ["refocus", "estimate.nc", "--all-in-focus", "--overwrite"]):
        main([*words, "--json"])
        told = json.loads(capsys.readouterr().out)
        seen.append(told["light_field"]["disparity_seen"] if "light_field" in told else told["disparity"])
    assert seen[0] == pytest.approx(seen[1], abs=1e-3)
    main(["inspect", "estimate.nc"])
    said = capsys.readouterr().out
    assert "px per view step (5 to 95 %)" in said
    assert "true disparity: none" in said


def test_what_cannot_be_focused_is_refused(folder, capsys):
    write_dataset(label_light_field(np.full((1, 1, 8, 8), 0.5)), folder / "single.nc", overwrite=True)
    assert "--sweep: found --disparity beside it" in refused(
        capsys, "refocus", "views.nc", "--sweep", 3, "--disparity", 1
    )
    assert "--disparity: found 'a'" in refused(capsys, "refocus", "views.nc", "--disparity", "a")
    assert "--sweep: found 1" in refused(capsys, "refocus", "views.nc", "--sweep", 1)
    assert ".gif: found one photograph" in refused(capsys, "refocus", "views.nc", "--all-in-focus", "--out", "a.gif")
    assert "the suffix '.jpg'" in refused(capsys, "refocus", "views.nc", "--out", "a.jpg")
    assert "1 × 1 views" in refused(capsys, "refocus", "single.nc", "--all-in-focus")
    assert "which is the input" in refused(capsys, "refocus", "views.nc", "--out", "views.nc", "--overwrite")


def test_a_snapshot_is_no_light_field_yet(folder, capsys):
    views = tmca.read(folder / "views.nc", "light-field", views=3)
    tmca.simulate(views, tmca.LightFieldCamera(slots=1, shutter="open")).save(folder / "taken.nc", overwrite=True)
    assert "found a snapshot" in (line := refused(capsys, "refocus", "taken.nc"))
    assert "run tmca reconstruct taken.nc first" in line


def test_a_disparity_that_no_scene_has_is_warned_of(folder):
    with pytest.warns(SceneWarning, match="disparity 50: outer views move by 50 of 40 pixels"):
        tmca.refocus(folder / "views.nc", [0.0, 50.0])


@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
def test_a_scene_with_depth_becomes_points(folder, capsys):
    depth, waves = np.add.outer(np.linspace(1, 2, 6), np.zeros(8)).astype(np.float32), np.linspace(45e-8, 65e-8, 4)
    parts = {"radiance": (("wavelength", "y", "x"), np.full((4, 6, 8), 0.5, np.float32)), "depth": (("y", "x"), depth)}
    sure = {"confidence": (("y", "x"), depth / 2)}
    write_dataset(xr.Dataset(parts | sure, {"wavelength": waves}, {"focal_px": 16.0}), folder / "d.nc", overwrite=True)
    main(["point-cloud", "d.nc", "--overwrite"])
    points, _ = read_back(folder / "d.ply")
    np.testing.assert_allclose(points[0], [-3.5 / 16, 2.5 / 16, -1], rtol=1e-5)
    capsys.readouterr()
    main(["point-cloud", "d.nc", "--confidence", "0.75", "--out", "e.ply", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told.pop("distance") == pytest.approx([1.6, 2.0])
    assert told.pop("left_out") == {"without depth": 0, "below the confidence": 24}
    assert told == {"file": "e.ply", "points": 24, "focal_px": 16.0, "focal_known": True}
    assert "--focal: found -1 px" in refused(capsys, "point-cloud", "d.nc", "--focal=-1", "--out", "f.ply")
    asked = refused(capsys, "point-cloud", "views.nc", "--focal", "20", "--out", "f.ply")
    assert "--baseline: found no baseline, focus" in asked
    geometry = ("--focal", "20", "--baseline", "0.05", "--focus", "1")
    main(["point-cloud", "views.nc", *geometry, "--out", "f.ply"])
    assert "m away, focal length 20 px" in capsys.readouterr().out


def test_the_middle_of_the_views_is_refocused(folder, capsys):
    main(["refocus", "views.nc", "--disparity", "0", "--crop", "12x10", "--out", "part.nc"])
    main(["refocus", "coffee:1", "--views", "3", "--disparity", "0", "--crop", "18x20", "--out", "drawn.nc"])
    sizes = [xr.load_dataset(name)["refocused"].shape[-2:] for name in ("part.nc", "drawn.nc")]
    assert sizes == [(12, 10), (18, 20)]
    assert "--crop: found 999×10" in refused(capsys, "refocus", "views.nc", "--crop", "999x10", "--out", "x.png")
