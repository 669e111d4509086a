"""Scenes with depth: maps and colours as in their files; a surface that is turned, looked into, and saved."""

from contextlib import ExitStack

import numpy as np
import pytest
import xarray as xr

import tmca
from tests.data import rgbd_scenes
from tmca.data.fitting import fit_depth_scene
from tmca.viewer.opening import open_items

CUBE = np.random.default_rng(3).random((4, 20, 30)).astype(np.float32)
DEPTH = np.add.outer(np.linspace(1, 2, 20), np.linspace(0, 1, 30)).astype(np.float32)
DEPTH[2, 3] = np.nan
WAVES = np.linspace(450e-9, 650e-9, 4)


def scene():
    parts = {"radiance": (("wavelength", "y", "x"), CUBE), "depth": (("y", "x"), DEPTH)}
    return xr.Dataset({**parts, "confidence": (("y", "x"), DEPTH / 4)}, {"wavelength": WAVES})


def test_depth_and_confidence_lie_beside_the_bands(tmp_path):
    tmca.data.write_dataset(scene(), tmp_path / "s.nc")
    with ExitStack() as stack:
        for thing in (scene(), tmp_path / "s.nc"):
            [item] = open_items(thing, stack)
            assert [layer.name for layer in item.layers] == ["values", "colour", "depth", "confidence"]
            np.testing.assert_array_equal(item.layer("depth").plane(0), DEPTH)
            np.testing.assert_array_equal(item.layer("values").plane(1), CUBE[1])
            assert item.facts["depth known"] == "99.8% of the pixels"


@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
def test_a_mapped_depth_is_shown_in_the_metres_of_the_scene_as_points_have_them():
    mapped = fit_depth_scene(scene().drop_vars("confidence"), WAVES, (20, 30), 0.4, 0.8)
    with ExitStack() as stack:
        [item] = open_items(mapped, stack)
    shown = item.layer("depth").plane(0)
    np.testing.assert_allclose(shown, DEPTH, rtol=1e-5)
    np.testing.assert_allclose(shown[np.isfinite(shown)], -tmca.point_cloud(mapped).points[:, 2], rtol=1e-5)
    assert item.facts["depth"] == "1 to 3 m"
    assert item.facts["metres"].endswith("depths of 1 to 3 m mapped onto 0.4 to 0.8 m")


def test_a_picture_with_depth(tmp_path):
    stem = rgbd_scenes.open3d(tmp_path)
    with ExitStack() as stack:
        [item] = open_items(stem, stack)
        assert (item.kind, [layer.name for layer in item.layers]) == ("depth", ["depth", "colour"])
        np.testing.assert_array_equal(item.layers[0].plane(0), tmca.data.read_rgbd(stem)["depth"].values)


@pytest.fixture
def looked(look):
    opened = look(scene())
    opened.until("[...tmca.desk.panels.values()].every((panel) => panel.spec.paint.plane)")
    return opened


def surface(looked, across=0.5, down=0.5):
    """A place of the surface's panel on the screen."""
    return looked.ask(
        f"""(() => {{ const panel = tmca.desk.panels.get('0/surface'), own = panel.root.getBoundingClientRect();
        const {{ x, y, w, h }} = panel.inner; return [own.left + x + {across} * w, own.top + y + {down} * h] }})()"""
    )


def test_the_surface_is_turned_and_has_spectra(looked):
    before = looked.ask("tmca.desk.solid.turn")
    looked.page.mouse.move(*surface(looked))
    cursor = looked.until("tmca.desk.cursor")
    assert 4 < cursor[0] < 16
    assert 6 < cursor[1] < 24
    looked.page.mouse.down()
    looked.page.mouse.move(*surface(looked, 0.6), steps=4)
    looked.page.mouse.up()
    after = looked.ask("tmca.desk.solid.turn")
    assert after[1] > before[1]
    looked.page.mouse.click(*surface(looked))
    looked.until("tmca.desk.places.length === 1")
    y, x = looked.ask("tmca.desk.places[0]")
    looked.until(f"tmca.desk.lines?.[0]?.name.endsWith('row {y}, column {x}')")  # the middle's is drawn before
    np.testing.assert_allclose(looked.ask("Array.from(tmca.desk.lines[0].y)"), CUBE[:, y, x], rtol=1e-6)
    assert looked.errors == []


def test_a_surface_seen_from_the_front_has_its_pixels_where_they_are(looked):
    looked.ask("Object.assign(tmca.desk.solid, { turn: [0, 0], relief: 0.05 }), tmca.desk.draw()")
    looked.page.mouse.move(*surface(looked))
    np.testing.assert_allclose(looked.until("tmca.desk.cursor"), (10, 15), atol=1)


def test_points_are_saved_in_metres(looked, tmp_path):
    with looked.page.expect_download() as saved:
        looked.page.click("text=Points (PLY)")
    saved.value.save_as(tmp_path / "points.ply")
    lines = (tmp_path / "points.ply").read_text().splitlines()
    assert lines[0] == "ply"
    assert f"element vertex {DEPTH.size - 1}" in lines
    points = np.array([line.split() for line in lines[lines.index("end_header") + 1 :]], float)
    np.testing.assert_allclose(-points[:, 2], DEPTH[np.isfinite(DEPTH)], rtol=1e-4)
    np.testing.assert_allclose(points[0, :2], [-14.5 / 30 * DEPTH[0, 0], 9.5 / 30 * DEPTH[0, 0]], rtol=1e-4)
