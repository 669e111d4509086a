"""Light fields: views, refocused pictures and epipolar lines on the page are those of the package."""

from contextlib import ExitStack

import numpy as np
import pytest
import xarray as xr

import tmca
from tmca.data.light_field_scenes import true_disparity
from tmca.metrics import refocus
from tmca.plots.views import brightest
from tmca.viewer.opening import open_items
from tmca.viewer.truths import beside_truth

READY = "tmca.planes.whole(0, tmca.desk.items[0].layers[0])"


def smooth(colour=False):
    """A light field of soft waves at two disparities, (3,) 5×5 views of 20×24 pixels."""
    y, x = np.mgrid[:20, :24]
    views = np.empty((5, 5, 20, 24), np.float32)
    for v in range(5):
        for u in range(5):
            wave = np.sin((y + (v - 2) * 0.5) / 3) + np.cos((x + (u - 2) * 0.5) / 4)
            views[v, u] = 0.5 + 0.2 * wave
    return tmca.data.label_light_field(np.stack([views, 0.5 * views, 0.2 * views]) if colour else views)


@pytest.mark.parametrize("colour", [False, True])
def test_views_are_pictures_of_one_brightness(tmp_path, colour):
    field = smooth(colour)
    tmca.data.write_dataset(field, tmp_path / "f.nc")
    with ExitStack() as stack:
        [item] = open_items(tmp_path / "f.nc", stack)
        assert (item.kind, item.view["grid"]) == ("light field", [5, 5])
        layer = item.layers[0]
        assert (layer.planes, layer.size, layer.axis.names[1]) == (25, (20, 24), "view -2, -1")
        values = np.moveaxis(field.values[:, 1, 3], 0, -1) if colour else field.values[1, 3][..., None]
        expected = np.round(255 * np.clip(values / brightest(field.values), 0, 1))
        np.testing.assert_allclose(layer.plane(8), np.broadcast_to(expected, (20, 24, 3)), atol=1)


def test_the_disparity_of_a_file_is_a_layer():
    map_ = xr.DataArray(np.linspace(-1, 3, 480, dtype=np.float32).reshape(20, 24), dims=("y", "x"))
    with ExitStack() as stack:
        [item] = open_items(xr.Dataset({"light_field": smooth(), "disparity": map_}), stack)
    np.testing.assert_array_equal(item.layer("disparity").plane(0), map_)
    assert item.view["reach"] == (-1.0, 3.0)


def test_the_confidence_of_an_estimate_is_a_layer_and_its_metrics_are_said_once():
    field = smooth()
    estimate = tmca.reconstruct(tmca.simulate(field, tmca.LightFieldCamera(slots=1, shutter="open")), "dagger")
    estimate.notes["metric_psnr"] = 1.0
    with ExitStack() as stack:
        item, _ = beside_truth(estimate, field, stack)
    assert [layer.name for layer in item.layers] == ["values", "disparity", "confidence"]
    np.testing.assert_array_equal(item.layers[2].plane(0), estimate.maps["confidence"])
    assert [name for name in item.facts if name.lower() == "psnr"] == ["PSNR"]
    low, high = item.view["reach"]
    shown = item.layers[1].shown_span()
    assert low <= shown[0] < low + 0.5
    assert high - 0.5 <= shown[1] <= high or high == low + 0.5


@pytest.mark.filterwarnings("ignore:estimate")
def test_the_true_disparity_and_its_error_stand_beside_that_of_an_estimate():
    field = tmca.read("coffee:1", "light-field", views=3, size=(24, 28))
    views = np.random.default_rng(2).random((24, 28)).astype(np.float32)
    estimate = field.to_dataset(name="estimate").assign(disparity=(("y", "x"), views))
    with ExitStack() as stack:
        seen, truth = beside_truth(estimate, field, stack)
    real = true_disparity("coffee:1", field).values
    np.testing.assert_array_equal(truth.layer("disparity").plane(0), real)
    np.testing.assert_allclose(seen.layer("error").plane(0), np.abs(views - real), atol=1e-6)
    assert truth.facts["disparity"] == "in the file"


def test_a_truth_does_not_hide_epipolar_lines(look):
    field = smooth()
    estimate = tmca.reconstruct(tmca.simulate(field, tmca.LightFieldCamera(slots=1, shutter="open")), "dagger")
    looked = look(estimate, truth=field, hash="#cursor=7,9")
    looked.until(READY)
    keys = looked.until("[...tmca.desk.panels.keys()]")
    assert [key for key in keys if key.endswith(("/across", "/down"))] == ["0/across", "0/down", "1/across", "1/down"]
    assert "0/confidence" in keys
    looked.until("tmca.desk.panels.get('1/across').spec.paint.plane")
    lines = np.array(looked.ask("Array.from(tmca.desk.panels.get('1/across').spec.paint.plane.data)"))
    expected = 255 * np.clip(field.values[2, :, 7] / brightest(field.values), 0, 1)
    np.testing.assert_allclose(lines.reshape(5, 24, 3)[..., 1], expected, atol=1)
    assert looked.errors == []


def test_the_page_refocuses_as_the_package_does(look):
    field = smooth()
    looked = look(field, hash="#mode=focus&focus=0.5&cursor=7,9")
    looked.until(READY)
    looked.until("tmca.desk.refocused.get(0)?.made.endsWith('/25')")
    shown = np.array(looked.ask("Array.from(tmca.desk.refocused.get(0).plane.data)")).reshape(20, 24, 3)
    focus = looked.ask("tmca.desk.focus")
    expected = 255 * np.clip(refocus(field.values, focus) / brightest(field.values), 0, 1)
    np.testing.assert_allclose(shown[3:-3, 3:-3, 0], expected[3:-3, 3:-3], atol=2)
    assert looked.errors == []


def test_epipolar_lines_are_rows_of_the_views(look):
    field = smooth()
    looked = look(field, hash="#cursor=7,9")
    looked.until(READY)
    looked.until("[...tmca.desk.panels.values()].at(-1).spec.paint.plane")
    lines = np.array(looked.ask("Array.from([...tmca.desk.panels.values()].at(-2).spec.paint.plane.data)"))
    expected = 255 * np.clip(field.values[2, :, 7] / brightest(field.values), 0, 1)
    np.testing.assert_allclose(lines.reshape(5, 24, 3)[..., 1], expected, atol=1)


def test_a_hand_walks_through_the_views(look):
    looked = look(smooth())
    looked.until(READY)
    looked.page.mouse.move(250, 200)
    looked.page.mouse.down()
    looked.page.mouse.move(285, 140, steps=4)
    looked.page.mouse.up()
    assert looked.ask("[tmca.desk.v, tmca.desk.u]") == [0, 3]
    looked.page.keyboard.press("ArrowLeft")
    assert looked.ask("[tmca.desk.v, tmca.desk.u]") == [0, 2]
