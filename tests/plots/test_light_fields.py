"""Pictures of light fields: slices, refocusing, codes at the mask, files."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg

import tmca
from tmca.applications.light_field import LightFieldApplication
from tmca.data import label_light_field
from tmca.data.light_field_scenes import load_light_field, true_disparity
from tmca.errors import OutputError, ShapeError
from tmca.metrics.refocusing import colour_views, refocus
from tmca.plots.codes import sub_images_figure
from tmca.plots.estimates import estimate_figure
from tmca.plots.light_field import disparity_figure, light_field_figure, view_psnr_figure
from tmca.plots.views import (
    border_walk,
    focus_steps,
    horizontal_slice,
    liveliest,
    refocus_strip,
    vertical_slice,
    views_gif,
    zoom_window,
)


def dot_field(views=(3, 5), size=(15, 21), disparity=1, place=(7, 10)):
    """A white dot at ``place`` of the centre view, whole pixels of disparity."""
    field = np.zeros((*views, *size), dtype=np.float32)
    for v, u in np.ndindex(*views):
        field[v, u, place[0] - (v - views[0] // 2) * disparity, place[1] - (u - views[1] // 2) * disparity] = 1
    return field


def test_a_dot_draws_a_line_in_both_slices():
    field = dot_field(disparity=2)
    row, column = liveliest(field)
    assert abs(row - 7) <= 2
    assert abs(column - 10) <= 2
    views = colour_views(field)
    np.testing.assert_array_equal(horizontal_slice(views, 7)[..., 0].argmax(axis=1), [14, 12, 10, 8, 6])
    np.testing.assert_array_equal(vertical_slice(views, 10)[..., 0].argmax(axis=0), [9, 7, 5])


@pytest.mark.parametrize("disparity", [-3, 4])
def test_the_strip_is_focused_where_the_light_field_has_something(disparity):
    wide = np.random.default_rng(0).random((90, 98)).astype(np.float32)
    views = [[wide[9 - v * disparity :, 9 - u * disparity :][:64, :72] for u in (-1, 0, 1)] for v in (-1, 0, 1)]
    steps = focus_steps(label_light_field(np.array(views)))
    assert len(steps) == 5
    assert min(steps) <= -disparity <= max(steps)
    assert max(steps) - min(steps) == pytest.approx(1, abs=0.3)


@pytest.mark.parametrize("views", [np.zeros((3, 3, 20, 20)), np.eye(20)[None, None], np.ones((3, 3, 2, 2))])
def test_without_texture_or_parallax_the_strip_goes_from_far_to_near(views):
    assert focus_steps(label_light_field(views)) == [-2, -1, 0, 1, 2]


@pytest.mark.parametrize(
    ("scene", "size", "colour"),
    [
        ("coffee:1", (64, 80), False),
        pytest.param("astronaut:2", (75, 91), True, marks=pytest.mark.slow),
        pytest.param("coffee:1", (96, 120), False, marks=pytest.mark.slow),
    ],
)
def test_the_strip_covers_the_disparity_of_small_frames(scene, size, colour):
    views = load_light_field(scene, views=5, size=size, colour=colour)
    low, high = np.quantile(true_disparity(scene, views).values, (0.05, 0.95))
    steps = focus_steps(views)
    assert steps == sorted(steps)
    assert min(high, steps[-1]) - max(low, steps[0]) > 0.8 * (high - low)
    assert steps[-1] - steps[0] < 1.3 * (high - low)


def test_refocusing_on_a_dot_brings_it_together():
    field = dot_field()
    np.testing.assert_allclose(refocus(field, 1), field[1, 2], atol=1e-6)
    assert refocus(field, 0).max() == pytest.approx(1 / 15)
    ramp = np.broadcast_to(np.arange(21.0), (1, 3, 15, 21)) + 0.5 * np.arange(-1, 2)[None, :, None, None]
    np.testing.assert_allclose(refocus(ramp, 0.5)[:, 3:-3], ramp[0, 1, :, 3:-3], atol=1e-5)
    coloured = np.stack([field, 2 * field, 3 * field])
    np.testing.assert_allclose(refocus(coloured, 0.3), np.multiply.outer([1, 2, 3], refocus(field, 0.3)), rtol=1e-5)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 5), (3, 1), (3, 3), (5, 9)])
def test_the_walk_is_closed_and_goes_by_single_steps(rows, columns):
    walk = border_walk(rows, columns)
    steps = [abs(a - c) + abs(b - d) for (a, b), (c, d) in zip(walk, walk[1:] + walk[:1], strict=True)]
    assert set(steps) <= ({0} if rows * columns == 1 else {1})
    border = {(v, u) for v in range(rows) for u in range(columns) if v in (0, rows - 1) or u in (0, columns - 1)}
    assert set(walk) == border


@pytest.mark.parametrize("shape", [(1, 1, 11, 40), (3, 3, 5, 41, 17)])
def test_a_gif_has_a_frame_for_each_view_of_the_walk(tmp_path, shape):
    from PIL import Image

    field = np.random.default_rng(0).random(shape)
    path = views_gif(field, tmp_path / "views.gif")
    with Image.open(path) as stored:
        assert stored.n_frames == len(border_walk(*shape[-4:-2]))
        times = stored.size[0] // shape[-1]
        assert stored.size == (times * shape[-1], times * shape[-2])
        assert max(stored.size) >= 360
    with pytest.raises(OutputError, match="existing"):
        views_gif(field, path)
    with pytest.raises(OutputError, match=r"\.gif"):
        views_gif(field, tmp_path / "views.png")


@pytest.mark.parametrize("size", [(64, 80), (97, 121), (270, 480), (300, 200), (12, 31)])
def test_what_is_enlarged_is_where_the_views_differ(size):
    place = (size[0] // 3, 2 * size[1] // 3)
    rows, columns = zoom_window(dot_field(size=size, place=place))
    assert rows.start <= place[0] < rows.stop <= size[0]
    assert columns.start <= place[1] < columns.stop <= size[1]
    assert rows.stop - rows.start == min(size[0], max(round(size[0] / 4), round(48 * size[0] / min(size))))
    assert min(rows.start, columns.start) >= 0


@pytest.mark.parametrize("size", [(24, 40), (41, 33)])
@pytest.mark.parametrize("snapshot", [None, 0.5])
def test_views_enlargements_and_errors_are_of_one_size_and_in_line(size, snapshot):
    truth = np.random.default_rng(0).random((3, 3, *size))
    taken = None if snapshot is None else np.full(size, snapshot)
    figure = light_field_figure({"a": 0.9 * truth, "b": 0.5 * truth}, truth, taken)
    FigureCanvasAgg(figure).draw()
    boxes = np.array([axis.get_window_extent().bounds for axis in figure.axes]).reshape(3, 3, 4)
    np.testing.assert_allclose(boxes[..., 2:], np.broadcast_to(boxes[0, 0, 2:], (3, 3, 2)), atol=1)
    np.testing.assert_allclose(boxes[..., 0], np.broadcast_to(boxes[0, :, 0], (3, 3)), atol=1)
    np.testing.assert_allclose(boxes[..., 1], np.broadcast_to(boxes[:, :1, 1], (3, 3)), atol=1)
    errors = [axis.images[0] for axis in np.reshape(figure.axes, (3, 3))[1:, 2]]
    assert errors[0].norm.vmax == errors[1].norm.vmax


@pytest.mark.parametrize("known", [True, False])
def test_the_error_that_is_predicted_stands_beside_the_actual_one_on_its_scale(known):
    truth = np.random.default_rng(0).random((3, 3, 24, 40))
    estimates, spread = {"a": 0.9 * truth, "b": 0.5 * truth}, {"b": np.full(truth.shape, 0.25)}
    rows = np.reshape(
        light_field_figure(estimates, truth if known else None, deviations=spread).axes, (2 + known, 3 + known)
    )
    np.testing.assert_allclose(rows[-1, -1].images[0].get_array(), 0.25)
    assert not rows[-2, -1].images
    if known:
        assert rows[-1, -1].images[0].norm.vmax == rows[-1, 2].images[0].norm.vmax
    unsure = np.full(truth.shape, np.inf)
    other = light_field_figure({"a": truth}, truth, deviations={"a": unsure, "none": unsure})
    assert np.isfinite(other.axes[-1].images[0].norm.vmax)


@pytest.mark.parametrize("drawn", [True, False])
def test_an_estimate_is_drawn_with_the_error_that_it_predicts(drawn):
    camera = tmca.LightFieldCamera(3, (24, 30), slots=2)
    values, axes = np.random.default_rng(0).random((3, 3, 24, 30)), ("view_v", "view_u", "y", "x")
    estimate = xr.Dataset({"estimate": (axes, values)}, attrs={"decoder": "lmmse"})
    estimate = estimate.assign(deviation=(axes, 0.1 * values)) if drawn else estimate
    for figure in (estimate_figure(estimate), LightFieldApplication().figure(estimate, camera)):
        assert any("predicted error" in axis.get_title() for axis in figure.axes) == drawn


def test_the_slices_of_the_enlarged_part_are_those_of_its_marked_row_and_column():
    field = dot_field(size=(60, 90), place=(20, 50), disparity=2)
    axis = light_field_figure({"a": field}).axes[1]
    part, below, beside = (np.asarray(shown.get_array())[..., 0] for shown in axis.images)
    (row, _), (column, _) = axis.lines[0].get_ydata(), axis.lines[1].get_xdata()
    window = zoom_window(field)
    np.testing.assert_array_equal(part, field[1, 2][window])
    np.testing.assert_array_equal(below, field[1, :, row, window[1]])
    np.testing.assert_array_equal(beside, field[:, 2, window[0], column].T)


def test_all_errors_of_disparity_share_a_scale_that_the_bar_explains():
    truth = np.zeros((10, 20))
    figure = disparity_figure({"good": truth + 0.1, "fair": truth + 1.2, "bad": truth + 1.4}, truth, truth)
    errors = [axis.images[0] for axis in figure.axes if axis.get_title().startswith("MAE")]
    assert [shown.norm.vmax for shown in errors] == [1.5, 1.5, 1.5]
    assert "0.0% above 1.5" in figure.axes[3].child_axes[0].get_ylabel()


@pytest.mark.parametrize("shape", [(1, 1, 12, 31), (3, 3, 3, 33, 14)])
def test_figures_are_drawn_for_grey_and_colour_tall_and_wide(shape):
    truth = np.random.default_rng(0).random(shape)
    estimate, flat = truth * 0.9, np.zeros(shape[-2:])
    figures = [
        light_field_figure({"a": estimate, "b": truth}, truth, flat),
        light_field_figure({"a": estimate}),
        refocus_strip(truth, (1, 0), "strip"),
        view_psnr_figure({"a": np.full(shape[-4:-2], 30.0), "exact": np.full(shape[-4:-2], np.inf)}),
        disparity_figure({"a": flat}, np.where(np.eye(*shape[-2:]), np.nan, 0.2), flat),
        sub_images_figure(np.random.default_rng(0).random((3, 3, 4, 5)), "code"),
    ]
    for figure in figures:
        FigureCanvasAgg(figure).draw()
        assert all(np.isfinite(axis.get_position().bounds).all() for axis in figure.axes)
    assert "30.00 dB" in figures[3].axes[0].get_title()
    assert "MAE 0.200 px, 100.0% above 0.07 px" in [axis.get_title() for axis in figures[4].axes]


def test_shapes_that_differ_are_refused():
    truth = np.random.default_rng(0).random((3, 3, 20, 30))
    with pytest.raises(ShapeError):
        light_field_figure({"a": truth[..., :10]}, truth)
    with pytest.raises(ShapeError):
        disparity_figure({"a": truth[0, 0, :, :10]}, truth[0, 0], truth[0, 0])
