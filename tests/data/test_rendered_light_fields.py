"""Rendered light fields: exact geometry, true occlusion, true texture behind edges, the same again from a seed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from tmca.cli import main
from tmca.data import (
    read,
    read_disparity,
    read_light_field,
    rendered_light_field,
    rendered_names,
    split_rendered,
    split_rendered_light_fields,
)
from tmca.data.rendering.surfaces import STEEPEST, Outline, Relief, Surface, Texture, render_view
from tmca.errors import DataError, SettingError


def texture(seed=0, size=(90, 100), smooth=0.0):
    picture = gaussian_filter(np.random.default_rng(seed).random(size), smooth)
    planes = spline_filter(picture.astype(np.float32), order=3, mode="mirror", output=np.float32)[None]
    return Texture(planes, np.eye(2), (30.0, 30.0))


def square(top, left, side):
    """An outline that covers a square of the centre view."""
    field = np.full((side + 2, side + 2), -1.0, dtype=np.float32)
    field[1:-1, 1:-1] = 1.0
    return Outline(field, np.eye(2), (1.0 - top, 1.0 - left))


@pytest.fixture(scope="module")
def scenes():
    return {name: rendered_light_field(name, views=3, size=(64, 72), seed=2) for name in rendered_names()}


def test_a_pixel_is_the_mean_over_its_area():
    scene = [Surface(Relief(0.0), texture(smooth=2.0))]
    coarse, _ = render_view(scene, 0, 0, (10, 10), 3)
    fine, _ = render_view(scene, 0, 0, (10, 10), 15)
    np.testing.assert_allclose(coarse, fine, atol=2e-3)


@pytest.mark.parametrize(("v", "u"), [(0, 1), (-2, 2), (4, 4), (8, -8)])
def test_every_surface_is_met_where_its_disparity_says(v, u):
    waves = np.array([[0.1, 0.06, 0.05, 0.3], [0.1, -0.05, 0.08, 1.0]])
    assert (waves[:, 0] * np.hypot(*waves[:, 1:3].T)).sum() < 0.5 * STEEPEST
    for relief in (
        Relief(1.3),
        Relief(1.3, (0.01, -0.015), None, (20.0, 30.0)),
        Relief(-0.7, (0.01, -0.015), waves, (20.0, 30.0)),
    ):
        y, x = np.random.default_rng(0).uniform(0, 60, (2, 200))
        at_y, at_x = relief.seen_from(v, u, y, x)
        tolerance = 1e-9 if relief.waves is None else 3e-3 if abs(v) == 8 else 1e-4
        np.testing.assert_allclose(at_y - v * relief(at_y, at_x), y, atol=tolerance)
        np.testing.assert_allclose(at_x - u * relief(at_y, at_x), x, atol=tolerance)


def test_near_hides_far_and_beside_it_the_true_background_is_seen():
    far, near = texture(1), texture(2)
    scene = [Surface(Relief(-1.0), far), Surface(Relief(2.0), near, square(10, 12, 9))]
    alone = scene[:1]
    for v, u in ((0, 0), (1, 0), (0, 2), (-2, -1)):
        view, disparity = render_view(scene, v, u, (36, 40), 3)
        background, _ = render_view(alone, v, u, (36, 40), 3)
        rows, columns = slice(11 - 2 * v, 18 - 2 * v), slice(13 - 2 * u, 20 - 2 * u)
        assert (disparity[rows, columns] == 2).all()
        beyond = np.ones((36, 40), dtype=bool)
        beyond[9 - 2 * v : 20 - 2 * v, 11 - 2 * u : 22 - 2 * u] = False
        assert (disparity[beyond] == -1).all()
        np.testing.assert_array_equal(view[0][beyond], background[0][beyond])
        plane, _ = render_view([Surface(Relief(2.0), near)], v, u, (36, 40), 3)
        np.testing.assert_array_equal(view[0][rows, columns], plane[0][rows, columns])


@pytest.mark.slow
def test_every_light_field_is_complete_and_spans_its_disparity(scenes):
    for name, scene in scenes.items():
        assert scene.light_field.dims == ("view_v", "view_u", "y", "x")
        assert scene.light_field.shape == (3, 3, 64, 72)
        assert scene.light_field.dtype == scene.disparity.dtype == np.float32
        assert 0 <= float(scene.light_field.min()) < float(scene.light_field.max()) <= 1
        assert -2.001 <= float(scene.disparity.min()) < -1
        assert float(scene.disparity.max()) == pytest.approx(2, abs=1e-3)
        assert scene.attrs["split"] in ("train", "validation", "test")
        assert scene.attrs["credit"], name


def test_both_ends_of_another_range_are_respected():
    scene = rendered_light_field("coffee", views=1, size=(64, 64), disparity=(0.5, 1.0))
    assert float(scene.disparity.min()) >= 0.5 - 1e-6
    assert float(scene.disparity.max()) == pytest.approx(1.0, abs=1e-6)
    flat = rendered_light_field("coffee", views=1, size=(64, 64), disparity=(1.0, 1.0)).disparity
    np.testing.assert_allclose(flat, 1, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["astronaut", "coffee"])
def test_true_disparity_brings_every_view_onto_the_centre_view_where_nothing_hides(scenes, name):
    """Hidden pixels are few and thin; beside them what remains is the blur of resampling once more."""
    scene = scenes[name]
    views, truth = scene.light_field.values, scene.disparity.values.astype(float)
    y, x = np.mgrid[:64, :72]
    for v, u in ((-1, 0), (0, 1), (1, 1)):
        at = [y - v * truth, x - u * truth]
        view = map_coordinates(views[1 + v, 1 + u], at, order=3)
        far = map_coordinates(views[1 + v, 1 + u], [y + v * truth, x + u * truth], order=3)
        inside = (slice(4, -4), slice(4, -4))
        right, wrong = (np.median(abs(w - views[1, 1])[inside]) for w in (view, far))
        assert right < 0.006
        assert right < 0.35 * wrong


@pytest.mark.usefixtures("rendered_anew")
def test_the_same_seed_gives_the_same_scene_and_another_seed_another():
    first, again, other = (rendered_light_field("chelsea", views=3, size=(32, 40), seed=seed) for seed in (5, 5, 6))
    assert first.identical(again)
    assert float(abs(first.disparity - other.disparity).max()) > 0.1


def test_grey_is_the_luminance_of_the_colours_in_linear_light():
    colour, grey = (
        rendered_light_field("coffee", views=1, size=(32, 40), colour=c, linear=True) for c in (True, False)
    )
    assert colour.light_field.dims[0] == "colour"
    luminance = np.tensordot([0.2126, 0.7152, 0.0722], colour.light_field.values, axes=1)
    np.testing.assert_allclose(grey.light_field, luminance, atol=0.02)
    assert float(abs(grey.light_field - luminance).mean()) < 1e-4
    encoded = rendered_light_field("coffee", views=1, size=(32, 40)).light_field
    assert (encoded.values >= grey.light_field.values - 1e-6).all()


def test_no_photograph_is_in_two_splits():
    split = split_rendered_light_fields()
    names = [name for part in split.values() for name in part]
    assert sorted(names) == sorted(rendered_names())
    assert set(split["test"]) == set(split_rendered()["test"])
    assert split["train"]
    assert split["validation"]


def test_the_command_line_writes_and_inspects_one(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["render", "coffee", "--views", "3", "--size", "64x64", "--disparity=-1,1", "--figure", "c.png"])
    assert "64×64 pixels, 3×3 views" in capsys.readouterr().out
    main(["inspect", "coffee.nc", "--figure", "again.png"])
    said = capsys.readouterr().out
    assert "light field (NetCDF)" in said
    assert "views: 3 × 3 of 64 × 64 pixels, grey" in said
    assert "true disparity: -1 to 1 px per view" in said
    assert read("coffee.nc").shape == (3, 3, 64, 64)
    assert read_disparity("coffee.nc").shape == (64, 64)
    assert (tmp_path / "c.png").stat().st_size > 10_000
    assert (tmp_path / "again.png").stat().st_size > 10_000
    with pytest.raises(DataError, match="no light field 'disparity'"):
        read_light_field("coffee.nc", variable="disparity")


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"name": "nobody"}, "name"), *(({"views": views}, "views") for views in (4, 19)),
        *(({"disparity": ends}, "disparity") for ends in ((2.0, -2.0), (0.0, np.nan), (0.0, 50.0))),
        ({"size": (8, 64)}, "size"), ({"seed": -1}, "seed"),
    ],
)  # fmt: skip
def test_impossible_wishes(options, where):
    with pytest.raises(SettingError) as caught:
        rendered_light_field(**{"name": "coffee", "size": (32, 32), **options})
    assert caught.value.where == where


@pytest.mark.slow
def test_the_disparity_of_the_centre_view_is_the_same_however_many_views_there_are(scenes):
    one = rendered_light_field("coffee", views=1, size=(64, 72)).disparity
    np.testing.assert_array_equal(one, rendered_light_field("coffee", views=3, size=(64, 72)).disparity)


@pytest.mark.parametrize("waves", [None, np.array([[0.3, 0.05, 0.02, 1.0]])])
def test_points_far_from_a_surface_need_not_be_looked_at(waves, monkeypatch):
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    tilted = Outline(square(10, 12, 9).samples, turn, (2.0, -7.0))
    near = Relief(2.0, (0.01, -0.02), waves, (15.0, 20.0))
    scene = [Surface(Relief(-1.0, (0.005, 0.0)), texture(1)), Surface(near, texture(2), tilted)]
    steps = [(0, 0), (1, -2), (-2, 2)]
    few = [render_view(scene, v, u, (37, 42), 3) for v, u in steps]
    assert all((disparity > 0).any() for _, disparity in few)
    monkeypatch.setattr(Surface, "near", lambda self, v, u, rows, columns: (slice(None), slice(None)))
    for (view, disparity), (v, u) in zip(few, steps, strict=True):
        every = render_view(scene, v, u, (37, 42), 3)
        np.testing.assert_array_equal(view, every[0])
        np.testing.assert_array_equal(disparity, every[1])
