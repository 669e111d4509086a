"""Pictures of what a bench measures show its numbers, and what is unknown as such."""

import numpy as np
import pytest
import xarray as xr

from tmca.plots.lab import (
    compared_spectra_figure,
    frames_figure,
    measured_depth_figure,
    reflectance_figure,
    shown_figure,
)

SIZE = (6, 9)


def pictures(figure):
    """Title → the values that are drawn."""
    return {axis.get_title(): np.ma.getdata(axis.images[0].get_array()) for axis in figure.axes if axis.images}


def test_a_depth_map_has_its_deviation_in_millimetres_and_why_pixels_have_none():
    depth = np.linspace(0.5, 1.5, 54).reshape(SIZE)
    why = np.zeros(SIZE, dtype=np.uint8)
    why[0, :3], why[5, 8] = 2, 1
    depth[why > 0] = np.nan
    variables = {"depth": depth, "depth_std": 1e-3 * depth, "confidence": why}
    measured = xr.Dataset({name: (("y", "x"), values) for name, values in variables.items()})
    figure = measured_depth_figure(measured, ("known", "saturated", "dark"), "table")
    drawn = pictures(figure)
    np.testing.assert_allclose(drawn["table"][why == 0], depth[why == 0])
    np.testing.assert_allclose(drawn["standard deviation"][why == 0], depth[why == 0])
    np.testing.assert_array_equal(drawn["92.6% known"], why)
    assert [label.get_text() for label in figure.axes[-1].get_yticklabels()] == ["known", "saturated", "dark"]


def test_reflectance_has_spectra_within_two_deviations_and_the_share_of_bands_that_are_left_out():
    cube = np.random.default_rng(0).random((4, *SIZE))
    quality = np.zeros(cube.shape, dtype=np.uint8)
    quality[:3, 2, 2] = 1
    dims = ("wavelength", "y", "x")
    measured = xr.Dataset(
        {"reflectance": (dims, cube), "reflectance_std": (dims, 0.1 * cube), "quality": (dims, quality)},
        coords={"wavelength_nm": ("wavelength", [450.0, 500.0, 550.0, 600.0])},
    )
    figure = reflectance_figure(measured, "spectra.nc")
    drawn = pictures(figure)
    np.testing.assert_allclose(drawn["spectra.nc"], cube.mean(0))
    assert drawn["saturated or dark"][2, 2] == 0.75
    assert np.count_nonzero(drawn["saturated or dark"]) == 1
    marks = [tuple(int(line.get_data()[place][0]) for place in (1, 0)) for line in figure.axes[0].lines]
    assert len(marks) == 3
    for (row, column), curve, band in zip(marks, figure.axes[1].lines, figure.axes[1].collections, strict=True):
        np.testing.assert_allclose(curve.get_ydata(), cube[:, row, column])
        edges = band.get_paths()[0].vertices[:, 1]
        assert edges.max() == pytest.approx((1.2 * cube[:, row, column]).max())
        assert edges.min() == pytest.approx((0.8 * cube[:, row, column]).min())


def test_a_compared_spectrum_stands_beside_its_reference():
    nm, spectrum, spread, reference = np.array([450.0, 500, 550]), np.array([0.2, 0.4, 0.3]), 0.01, np.full(3, 0.5)
    figure = compared_spectra_figure({"P1": (nm, spectrum, np.full(3, spread), reference)})
    (axis,) = figure.axes
    drawn = {line.get_label(): line.get_xydata() for line in axis.lines}
    np.testing.assert_array_equal(drawn["scan"], np.stack([nm, spectrum], axis=1))
    np.testing.assert_array_equal(drawn["spectrometer"], np.stack([nm, reference], axis=1))
    assert axis.get_ylim() == (0, pytest.approx(0.575))


def test_a_movie_shows_its_capture_and_frames_from_the_first_to_the_last():
    frames = np.random.default_rng(1).uniform(-0.2, 1.2, (7, *SIZE))
    figure = frames_figure({"disc": frames}, {"disc": frames.mean(0)}, shown=3)
    drawn = pictures(figure)
    assert [*drawn] == ["capture", "disc: 1", "frame 4", "frame 7"]
    np.testing.assert_allclose(drawn["capture"], frames.mean(0))
    np.testing.assert_allclose(drawn["frame 4"], frames[3].clip(0, 1))


def test_devices_show_frames_as_pictures_and_zernike_terms_as_bars_in_nanometres():
    frame, terms = np.eye(6), np.array([1e-8, -3e-8])
    figure = shown_figure({
        "mask, dmd": [("slot 0", frame, None), ("slot 1", 1 - frame, None)],
        "pupil, mirror": [("slot 0", terms, (4, 11)), ("slot 1", -terms, (4, 11))],
    })  # fmt: skip
    first, second, _, fourth = figure.axes
    np.testing.assert_array_equal(first.images[0].get_array(), frame)
    np.testing.assert_array_equal(second.images[0].get_array(), 1 - frame)
    assert [bar.get_height() for bar in fourth.patches] == pytest.approx([-10, 30])
    assert [label.get_text() for label in fourth.get_xticklabels()] == ["4", "11"]
    assert (first.get_ylabel(), figure.axes[2].get_ylabel()) == ("mask, dmd", "pupil, mirror")
