"""Pictures of cubes and of scenes with depth: what they show, in which panel, under which words."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgb

from tmca.errors import SettingError
from tmca.plots import cube as cubes
from tmca.plots import depth as depths
from tmca.plots import linear_srgb, srgb_picture
from tmca.plots.codes import phase_codes_figure
from tmca.plots.estimates import estimate_figure

WAVELENGTHS = np.linspace(450e-9, 650e-9, 7)
METRES = np.linspace(0.5, 2.0, 4)


def scene(seed=0, size=(24, 30)):
    """(7, 24, 30) of two materials, and a depth map with one unknown pixel."""
    random = np.random.default_rng(seed)
    left = np.linspace(0.2, 0.8, 7)[:, None, None] * np.ones(size)
    left[:, :, size[1] // 2 :] = left[::-1, :, size[1] // 2 :]
    depth = np.tile(np.linspace(0.5, 2.0, size[1]), (size[0], 1))
    depth[3, 4] = np.nan
    return left + 0.02 * random.random(left.shape), depth


def titles(figure):
    return [axis.get_title() for axis in figure.axes if axis.get_title()]


def curves(figure):
    """Spectra: wavelengths in nanometres and values of every line of several points."""
    return [line for axis in figure.axes for line in axis.lines if len(line.get_xdata()) == len(WAVELENGTHS)]


def test_a_cube_shows_its_colours_spectra_and_bands():
    cube, _ = scene()
    figure = cubes.cube_figure(cube, WAVELENGTHS, "paper")
    assert titles(figure)[0] == "paper"
    assert "7 of 7 bands" in titles(figure)
    assert [text.get_text() for text in figure.axes[2].texts][:2] == ["450 nm", "483 nm"]
    points = cubes.sample_points(cube)
    for line, (row, column) in zip(curves(figure), points, strict=True):
        np.testing.assert_allclose(line.get_xdata(), WAVELENGTHS * 1e9)
        np.testing.assert_array_equal(line.get_ydata(), cube[:, row, column])


def test_composites_tell_the_error_of_every_estimate():
    cube, _ = scene()
    figure = cubes.composites(cube, {"half a per cent off": cube + 0.005, "exact": cube}, WAVELENGTHS, "K = 8")
    assert titles(figure)[:2] == ["truth\nK = 8", "half a per cent off: 46.02 dB"]
    assert titles(figure)[2].startswith("exact: ")


def test_signatures_are_those_of_the_points_named_above_them():
    cube, _ = scene()
    estimates = {f"row {number}": cube + number / 100 for number in range(7)}
    figure = cubes.signatures(cube, estimates, WAVELENGTHS)
    for axis, (row, column) in zip(figure.axes[1:], cubes.sample_points(cube, 3), strict=True):
        assert axis.get_title() == f"row {row}, column {column}"
        lines = {line.get_label(): line.get_ydata() for line in axis.lines}
        assert list(lines) == ["truth", "row 0", "row 2", "row 3", "row 4", "row 6"]
        np.testing.assert_array_equal(lines["row 6"], cube[:, row, column] + 0.06)


def test_bands_have_a_row_for_the_truth_and_every_estimate():
    cube, _ = scene()
    figure = cubes.bands(cube, {"one": cube + 0.1, "two": cube - 0.1}, WAVELENGTHS)
    assert titles(figure) == [f"{WAVELENGTHS[band] * 1e9:.0f} nm" for band in (0, 1, 2, 4, 5, 6)]
    assert [axis.get_ylabel() for axis in figure.axes if axis.get_ylabel()] == ["truth", "one", "two"]
    np.testing.assert_allclose(figure.axes[6].images[0].get_array(), (cube[0] + 0.1).clip(0))


@pytest.mark.parametrize("metric", [True, False])
def test_a_depth_map_says_its_unit_and_what_is_unknown(metric):
    cube, depth = scene()
    figure = depths.rgbd_figure(np.moveaxis(cube[[6, 3, 0]], 0, -1), depth, "a room", metric)
    labels = [bar.get_ylabel() for axis in figure.axes for bar in axis.child_axes]
    unit = "depth (m)" if metric else "depth (m up to an affine map of 1/depth)"
    assert labels == [f"{unit}, grey: unknown"]


def test_an_estimate_of_depth_shows_colours_depth_confidence_and_spectra():
    cube, depth = scene()
    figure = depths.depth_figure("map", (cube, depth), np.ones(depth.shape), WAVELENGTHS, (0.5, 2.0), (cube, depth))
    assert {"truth", "map", "depth, truth", "depth, map", "confidence"} <= set(titles(figure))
    assert len(curves(figure)) == 2 * 3


@pytest.mark.parametrize("known", [True, False])
def test_the_predicted_error_of_a_depth_stands_below_the_actual_one(known):
    cube, depth = scene()
    spread, truth = np.full(depth.shape, 0.1), (cube, depth) if known else None
    spread[0, 0] = depth[0, 0] = np.inf
    figure = depths.depth_figure(
        "map", (cube, depth + 0.2), np.ones(depth.shape), WAVELENGTHS, (0.5, 2.0), truth, deviation=spread
    )
    drawn = {axis.get_title(): axis.images[0] for axis in figure.axes if "error" in axis.get_title()}
    assert len(drawn) == 1 + known
    for image in drawn.values():
        assert image.norm.vmax == pytest.approx(0.2 if known else 0.1)
    predicted = np.ma.filled(drawn["predicted error of the depth (1 σ)"].get_array(), np.nan)
    assert np.isnan(predicted[0, 0])
    np.testing.assert_allclose(predicted[1:], 0.1)


def test_what_codes_tell_about_depth_leaves_out_a_plane_as_its_own_rival():
    distances = np.array([[0, 3, 5, 9], [3, 0, 2, 5], [5, 2, 0, 4], [9, 5, 4, 0]], dtype=float)
    part = {"fisher": [1.0, 2.0, 3.0, 4.0], "kullback_leibler": distances.tolist()}
    fewer = {"fisher": [1.0, 2.0], "kullback_leibler": [[0.0, 7.0], [8.0, 0.0]]}
    predicted = {name: {"optimised": one, "random": one} for name, one in (("one slot", part), ("few planes", fewer))}
    figure = depths.predicted_depth_figure(predicted, {"one slot": METRES, "few planes": METRES[:2]})
    solid, dotted, other, _ = figure.axes[1].lines
    np.testing.assert_array_equal(other.get_xydata(), np.stack([METRES[:2], [7, 8]], axis=1))
    np.testing.assert_array_equal(solid.get_ydata(), [3, 2, 2, 4])
    np.testing.assert_array_equal(solid.get_xdata(), METRES)
    assert (solid.get_label(), dotted.get_linestyle()) == ("one slot", ":")


def test_estimates_stand_beside_the_truth_with_their_errors():
    cube, depth = scene()
    known = np.nan_to_num(depth, nan=1.0)
    figure = depths.before_after({"fitted": (cube + 0.01, known + 0.25)}, (cube, known), WAVELENGTHS, (0.5, 2.0))
    assert titles(figure)[:2] == ["truth", "fitted\n40.00 dB"]
    assert "0.250 m off" in titles(figure)


def test_every_code_has_a_row_and_every_decoder_its_columns():
    cube, depth = scene()
    rows = {"learned": {"lmmse": (cube, depth), "net": (cube + 0.1, depth)}, "random": {"net": (cube, depth)}}
    figure = depths.rows_figure(rows, ["lmmse", "net"], (cube, depth), WAVELENGTHS, (0.5, 2.0))
    assert {"truth", "learned\nlmmse", "learned\nnet", "random\nnet"} <= set(titles(figure))
    assert "random\nlmmse" not in titles(figure)


def test_an_even_spectrum_is_white_and_a_long_one_red():
    cube = np.zeros((28, 2, 2))
    nm = np.linspace(450, 650, 28)
    cube[:, 0, 0], cube[nm > 600, 0, 1], cube[(nm > 510) & (nm < 560), 1, 0], cube[nm < 480, 1, 1] = 1, 1, 1, 1
    linear = linear_srgb(cube, nm * 1e-9)
    np.testing.assert_allclose(linear[:, 0, 0], 1, atol=1e-9)
    assert [int(linear[:, y, x].argmax()) for y, x in ((0, 1), (1, 0), (1, 1))] == [0, 1, 2]
    lamp = np.linspace(0.2, 1, 28)
    np.testing.assert_allclose(linear_srgb(lamp[:, None, None], nm * 1e-9, lamp)[:, 0, 0], 1)
    picture = srgb_picture(cube, nm * 1e-9)
    assert picture.shape == (2, 2, 3)
    assert picture.min() >= 0
    assert picture.max() <= 1


def test_spectra_of_an_estimate_have_a_band_of_one_deviation_at_the_pixels_that_are_asked_for():
    cube, _ = scene()
    spread = 0.01 + 0.02 * cube
    figure = cubes.reconstruction_figure({"lmmse": cube + 0.01}, WAVELENGTHS, cube, {"lmmse": spread}, at=[(3, 20)])
    panel = next(axis for axis in figure.axes if axis.get_title().startswith("spectra"))
    assert panel.get_title().endswith("(3, 20)")
    true, _ = panel.lines
    np.testing.assert_array_equal(true.get_ydata(), cube[:, 3, 20])
    (band,) = panel.collections
    low, high = band.get_paths()[0].get_extents().get_points()[:, 1]
    spectrum = cube[:, 3, 20] + 0.01
    assert low == pytest.approx((spectrum - spread[:, 3, 20]).min())
    assert high == pytest.approx((spectrum + spread[:, 3, 20]).max())
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["truth", "lmmse", "lmmse ±1 σ"]
    figure.draw_without_rendering()
    assert panel.bbox.width >= panel.bbox.height


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("size", [(24, 30), (60, 20)])
def test_a_panel_of_spectra_is_at_least_as_wide_as_tall(count, size):
    cube, _ = scene(size=size)
    estimates = {f"estimate {number}": cube for number in range(count)}
    figure = cubes.reconstruction_figure(estimates, WAVELENGTHS, cube + 0.1, dict.fromkeys(estimates, cube))
    figure.draw_without_rendering()
    panels = [axis for axis in figure.axes if axis.get_title().startswith("spectra")]
    assert len(panels) == (1 if count < 3 else 3)
    assert all(axis.bbox.width >= 0.999 * axis.bbox.height for axis in panels if count < 3)


@pytest.mark.parametrize("at", [[], [(24, 0)], [(0, -1)], [(1, 1)] * 7, 5, [(1.5, 2)], [3]])
def test_pixels_that_an_estimate_has_not_are_refused(at):
    cube, _ = scene()
    with pytest.raises(SettingError, match=r"at: found .*expected 1 to 6 pixels \(row, column\) within 24 × 30"):
        cubes.reconstruction_figure({"lmmse": cube}, WAVELENGTHS, at=at)


def test_pixels_are_asked_for_of_scenes_with_depth_too_and_refused_of_views():
    cube, depth = scene()
    figure = depths.depth_figure("map", (cube, depth), depth, WAVELENGTHS, (0.5, 2.0), (cube, depth), at=[(5, 6)])
    np.testing.assert_array_equal(curves(figure)[0].get_ydata(), cube[:, 5, 6])
    views = xr.Dataset({"estimate": (("view_v", "view_u", "y", "x"), np.ones((3, 3, 8, 9)))})
    with pytest.raises(SettingError, match="this estimate has no spectra"):
        estimate_figure(views, at=[(1, 2)])


def test_a_deviation_of_every_slot_is_drawn_around_their_mean():
    axes = ("slot", "wavelength", "y", "x")
    values = np.random.default_rng(0).random((3, len(WAVELENGTHS), 14, 15))
    known = {"estimate": (axes, values), "deviation": (axes, np.full_like(values, 0.1))}
    figure = estimate_figure(xr.Dataset(known, {"wavelength": WAVELENGTHS}, {"decoder": "lmmse"}), at=[(3, 13)])
    panel = next(axis for axis in figure.axes if "wavelength" in axis.get_xlabel())
    np.testing.assert_allclose(panel.lines[0].get_ydata(), values.mean(0)[:, 3, 13])
    assert len(panel.collections) == 1


def test_filters_have_the_colours_of_their_light():
    centres, metres = np.array([460e-9, 530e-9, 620e-9]), np.linspace(420e-9, 680e-9, 27)
    filters = np.exp(-(((metres - centres[:, None]) / 20e-9) ** 2))
    cells = np.array([[0, 1], [2, 3]])
    parts = (np.zeros((2, 4, 4)), np.ones((1, 2, 4, 4)), cells, np.vstack([filters, np.ones(27)]), np.ones((1, 27)))
    figure = phase_codes_figure(*parts, metres)
    axes = [axis for axis in figure.axes if axis.lines]
    looks = np.array([to_rgb(line.get_color()) for line in axes[0].lines[:4]])
    assert looks[:3].argmax(axis=1).tolist() == [2, 1, 0]
    np.testing.assert_allclose(looks[3], 0.85, atol=0.01)
    titles = [axis.get_title() for axis in figure.axes]
    assert "heights, slot 1 of 2" in titles
    tile = next(axis for axis in figure.axes if axis.get_title().startswith("filters of a tile"))
    np.testing.assert_allclose(tile.images[0].get_array()[1, 0], looks[2])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_legend_of_spectra_covers_none_of_them(count):
    cube, _ = scene()
    estimates = {f"row {number}": cube + number / 100 for number in range(count)}
    figure = cubes.reconstruction_figure(estimates, WAVELENGTHS, cube, {"row 1": 0.1 * cube})
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert not any(axis.legend_ for axis in figure.axes)
    assert not any(legend.get_window_extent().overlaps(axis.get_tightbbox()) for axis in figure.axes if axis.axison)
    assert any("±1 σ" in text.get_text() for text in legend.get_texts()) == (count > 1)


def test_points_at_an_edge_are_whole():
    cube, _ = scene()
    figure = cubes.reconstruction_figure({"lmmse": cube}, WAVELENGTHS, cube, at=[(0, 0)])
    assert not figure.axes[0].lines[0].get_clip_on()
