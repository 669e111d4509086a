"""What the page is told of a cube is what the file holds, whatever the order of its axes."""

from contextlib import ExitStack

import numpy as np
import pytest
import xarray as xr

import tmca
from tmca.errors import DataError, SettingError
from tmca.plots.cube import rgb_bands
from tmca.viewer import items
from tmca.viewer.items import Axis, Layer, thinning, usual_span
from tmca.viewer.opening import open_items

CUBE = np.random.default_rng(0).random((31, 12, 17)).astype(np.float32)
NM = np.linspace(400, 700, 31)


@pytest.fixture
def opened():
    """``opened(thing)`` gives its items; its file is closed after the test."""
    with ExitStack() as stack:
        yield lambda thing: open_items(thing, stack)


@pytest.fixture
def files(tmp_path):
    np.save(tmp_path / "pages.npy", CUBE)
    np.save(tmp_path / "pixels.npy", np.moveaxis(CUBE, 0, -1))
    labelled = tmca.data.label(CUBE, NM * 1e-9)
    tmca.data.write_dataset(labelled, tmp_path / "cube.nc")
    tmca.data.write_dataset(labelled.transpose("x", "wavelength", "y"), tmp_path / "turned.nc")
    return tmp_path


@pytest.mark.parametrize("name", ["pages.npy", "pixels.npy", "cube.nc", "turned.nc"])
def test_bands_and_spectra_of_any_order_of_axes(opened, files, name):
    [item] = opened(files / name)
    layer = item.layers[0]
    assert (layer.size, layer.planes) == ((12, 17), 31)
    np.testing.assert_allclose(layer.axis.values, NM, rtol=1e-6)
    np.testing.assert_allclose(layer.plane(3), CUBE[3], rtol=1e-6)
    mean, deviation = layer.profile((2, 7), (4, 5))
    np.testing.assert_allclose(mean, CUBE[:, 2:7, 4:5].mean((1, 2)), rtol=1e-5)
    np.testing.assert_allclose(deviation, CUBE[:, 2:7, 4:5].std((1, 2)), rtol=1e-4)


def test_integers_are_shares_of_their_type(opened, tmp_path):
    np.save(tmp_path / "counts.npy", np.round(255 * CUBE).astype(np.uint8))
    [item] = opened(tmp_path / "counts.npy")
    np.testing.assert_allclose(item.layers[0].plane(0), np.round(255 * CUBE[0]) / 255, rtol=1e-6)
    assert item.facts["divided by"] == "255 (from: integer type)"


@pytest.mark.parametrize("size", [(50, 70), (51, 33), (1, 9)])
def test_a_thinned_plane_is_every_nth_pixel_of_it(monkeypatch, size):
    monkeypatch.setattr(items, "_BLOCK", 2048)
    values = np.arange(np.prod(size), dtype=np.float64).reshape(1, *size)
    layer = Layer("values", "", size, Axis("", "", (0.0,)), items.in_memory(values))
    for step in (1, 2, 3, 7):
        np.testing.assert_array_equal(layer.plane(0, step), values[0, ::step, ::step])
    rows, columns = (0, size[0]), (2, 8)
    np.testing.assert_array_equal(layer.plane(0, 3, rows, columns), values[0, ::3, 2:8:3])


def test_a_plane_of_as_many_pixels_as_may_be_is_sent_whole():
    assert thinning((2048, 2048), 2**22) == 1
    assert thinning((2048, 2049), 2**22) == 2
    for size in ((9000, 12), (6001, 7003)):
        step = thinning(size, 2**20)
        assert -(-size[0] // step) * -(-size[1] // step) <= 2**20 * 1.01


def test_what_is_not_finite_counts_neither_for_spans_nor_for_spectra(opened):
    values = CUBE.copy()
    values[:, 0, 0] = np.nan
    values[5, 1, 1] = np.inf
    [item] = opened(tmca.data.label(values, NM * 1e-9))
    low, high = item.layers[0].shown_span()
    assert low == 0
    assert 0.9 < high <= 1
    mean, _ = item.layers[0].profile((0, 2), (0, 1))
    np.testing.assert_allclose(mean, values[:, 1, 0], rtol=1e-6)
    assert usual_span(np.full(3, np.nan)) == (0.0, 1.0)


def test_a_span_is_never_empty():
    for value in (0.0, 0.25, -3.0):
        low, high = usual_span(np.full((4, 4), value))
        assert high > low


def test_the_deviation_of_an_estimate_is_a_layer(opened):
    parts = {name: (("wavelength", "y", "x"), CUBE * scale) for name, scale in (("estimate", 1), ("deviation", 0.1))}
    [item] = opened(xr.Dataset(parts, {"wavelength": NM * 1e-9}, {"decoder": "lmmse", "metric_psnr": 31.7}))
    assert item.facts["PSNR"] == "31.7 dB"
    np.testing.assert_allclose(item.layer("deviation").plane(4), 0.1 * CUBE[4], rtol=1e-6)


def test_colours_are_of_the_bands_that_an_eye_sees_or_spread_over_others(opened):
    assert rgb_bands(NM * 1e-9) == (25, 15, 8)
    assert rgb_bands(np.linspace(1e-6, 2.5e-6, 13)) == (10, 6, 2)
    assert len(rgb_bands(np.array([5e-7]))) == 3
    [item] = opened(tmca.data.label(CUBE, NM * 1e-9))
    picture = item.layer("colour").plane(0)
    assert (picture.shape, picture.dtype) == ((12, 17, 3), np.uint8)
    np.testing.assert_array_equal(item.layer("colour").plane(0, 5), picture[::5, ::5])


def test_bad_files_are_named(opened, tmp_path):
    (tmp_path / "cut.npy").write_bytes(b"\x93NUMPY\x01\x00")
    for name in ("none.nc", "cut.npy"):
        with pytest.raises(DataError) as refused:
            opened(tmp_path / name)
        assert refused.value.where == str(tmp_path / name)
    with pytest.raises(SettingError):
        opened(3.5)


def test_arrays_that_are_no_cube_are_planes(opened, tmp_path):
    from PIL import Image

    values = np.random.default_rng(0).random((5, 40, 50))
    np.savez(tmp_path / "many.npz", stack=values, mask=values[0] > 0.5)
    items = opened(tmp_path / "many.npz")
    assert [(item.kind, item.title) for item in items] == [("array", "many.npz: stack"), ("array", "many.npz: mask")]
    np.testing.assert_allclose(items[0].layers[0].plane(3), values[3], rtol=1e-6)
    np.testing.assert_array_equal(items[1].layers[0].plane(0), values[0] > 0.5)
    Image.fromarray(np.uint8(255 * np.moveaxis(values[:3], 0, -1))).save(tmp_path / "rgb.png")
    [picture] = opened(tmp_path / "rgb.png")
    np.testing.assert_array_equal(picture.layers[0].plane(0), np.uint8(255 * np.moveaxis(values[:3], 0, -1)))
    np.savez(tmp_path / "flat.npz", numbers=np.arange(4.0))
    with pytest.raises(DataError):
        opened(tmp_path / "flat.npz")
