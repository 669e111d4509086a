"""Snapshots, codes and exported patterns are shown as they are."""

import shlex
from contextlib import ExitStack

import numpy as np
import pytest

import tmca
from tests.cli.calls import said
from tmca.errors import DataError
from tmca.viewer.opening import open_items

SENSOR = tmca.Sensor(read_noise=0.01)


@pytest.fixture
def opened():
    """``opened(thing)`` gives its items; its file is closed after the test."""
    with ExitStack() as stack:
        yield lambda thing: open_items(thing, stack)


@pytest.mark.parametrize("buckets", [1, 2])
def test_a_snapshot_and_its_codes(opened, tmp_path, buckets):
    camera = tmca.SpectralCamera(slots=3, shutter="one-hot", buckets=buckets, sensor=SENSOR)
    snapshot = tmca.simulate(tmca.read("coffee", bands=4, size=(16, 20)), camera)
    file = snapshot.save(tmp_path / "s.nc")
    for thing in (file, snapshot):
        recorded, codes = opened(thing)
        assert (recorded.kind, codes.kind) == ("snapshot", "codes")
        for number in range(buckets):
            np.testing.assert_allclose(recorded.layers[0].plane(number), snapshot.values[0, number], rtol=1e-6)
        assert recorded.layers[0].axis.names == (("bucket 1", "bucket 2") if buckets == 2 else ("all",))
        aperture, *shutters, effective = codes.layers
        assert len(shutters) == buckets
        shown, closed = snapshot.camera.bucket_codes()
        np.testing.assert_array_equal(aperture.plane(2), shown[2])
        for layer, expected in zip(shutters, closed, strict=True):
            np.testing.assert_array_equal(layer.plane(1), expected[1])
        cube = snapshot.camera.code_cube()
        assert effective.planes == 4 * buckets
        last = cube.flatten(0, -3)[-1]
        np.testing.assert_allclose(effective.plane(4 * buckets - 1), last, rtol=1e-6)


def test_codes_of_the_other_cameras(opened):
    light_field = tmca.LightFieldCamera(slots=2, sensor=SENSOR)
    _, codes = opened(tmca.simulate(tmca.read("coffee:1", "light-field", views=3, size=(16, 16)), light_field))
    assert [layer.name for layer in codes.layers] == ["aperture", "shutter1", "code"]
    assert codes.layer("code").axis.names[0] == "view -1, -1"
    depth = tmca.SpectralDepthCamera(sensor=SENSOR)
    recorded, codes = opened(tmca.simulate(tmca.read("coffee", "spectral-depth", size=(32, 32)), depth))
    assert recorded.layers[0].size == (32, 32)
    assert [layer.name for layer in codes.layers] == ["heights", "shutter1"]
    assert codes.layer("heights").unit == "µm"


def test_patterns_of_an_export_have_the_size_of_the_device(opened, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    said(capsys, *shlex.split("simulate spectral coffee --crop 16x16 --slots 2 --out s.nc --no-figures"))
    said(capsys, *shlex.split("export s.nc --device dli4120 --no-figures --out e"))
    [codes] = opened("e")
    [aperture] = codes.layers
    assert (aperture.size, aperture.planes) == ((768, 1024), 2)
    shown = aperture.plane(1)
    expected = tmca.data.read_array("e/aperture/aperture_001.png")
    np.testing.assert_array_equal(shown, np.asarray(expected, np.float32).reshape(shown.shape))
    next((tmp_path / "e" / "aperture").glob("*_000.png")).unlink()
    with pytest.raises(DataError):
        opened("e")


def test_slots_are_walked_through_on_the_page(look):
    camera = tmca.SpectralCamera(slots=3, shutter="one-hot", sensor=SENSOR)
    snapshot = tmca.simulate(tmca.read("coffee", bands=4, size=(16, 20)), camera)
    looked = look(snapshot, hash="#page=2&plane=1")
    looked.until("[...tmca.desk.panels.values()].every((panel) => panel.spec.paint.plane)")
    looked.page.keyboard.press(".")
    slots = "[...tmca.desk.panels.values()].slice(0, 2).map((panel) => panel.spec.paint.plane.key)"
    looked.until(f"{slots}.every((key) => key.endsWith('/2'))")
    shown = looked.ask("Array.from([...tmca.desk.panels.values()][1].spec.paint.plane.data)")
    np.testing.assert_array_equal(shown, snapshot.camera.bucket_codes()[1][0, 2].ravel())
    assert "slot 3 of 3" in looked.page.inner_text("#sliders")
    assert looked.errors == []
