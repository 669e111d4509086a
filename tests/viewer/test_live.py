"""The page of a loop: to this machine alone, of the newest estimate, in a browser too; a loop without one goes on."""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest
import torch

from tests.lab.live.test_recording import CAMERA, shown
from tests.viewer.test_server import asked
from tmca.cameras import LightFieldCamera
from tmca.decoders import Estimate
from tmca.errors import SettingError
from tmca.lab.live import Shown
from tmca.viewer import LivePage
from tmca.viewer.live import live_items

END = "token={token}"


@pytest.fixture
def page(monkeypatch):
    monkeypatch.setattr("tmca.viewer.live._MOMENT", 0.0)  # no browser is here that would ask again
    with LivePage() as page:
        page.show(shown(3))
        yield page


def of(estimate, residual=0.0, number=0):
    values = torch.zeros(len(estimate.values), *estimate.camera.snapshot_shape)
    return Shown(number, values, estimate, 0.0, residual, 0, {"decode": 0.01}, 0.0)


def said(page, path):
    code, body = asked(page, path + END)
    assert code == 200
    return json.loads(body)


@pytest.mark.parametrize("path", ["?", "about?", "newest?", "plane?item=0&layer=values&index=0&y1=2&x1=2&"])
def test_others_are_refused(page, path):
    port = urlsplit(page.address).port
    assert asked(page, path + END)[0] == 200
    assert asked(page, path + "token=wrong") == (403, b"refused\n")
    assert asked(page, path + END, f"evil.example:{port}") == (403, b"refused\n")
    assert asked(page, path + END, method="POST")[0] == 405


def test_what_is_told_is_of_the_newest_exposure(page):
    assert said(page, "newest?")["exposure"] == 3
    page.show(shown(5))
    newest = said(page, "newest?after=3&")
    assert (newest["exposure"], newest["dropped"], newest["ms"]["decode"]) == (5, 2, 30)
    assert sum(newest["histogram"]) == CAMERA.snapshot_shape[1] * CAMERA.snapshot_shape[2]
    assert said(page, "profile?item=0&layer=values&y0=1&y1=2&x0=2&x1=3&")["mean"] == [2.5] * CAMERA.bands


def test_planes_are_those_of_the_newest_exposure(page):
    items = said(page, "about?")["items"]
    assert [item["kind"] for item in items] == ["live", "snapshot"]
    rows, columns = items[1]["layers"][0]["size"]
    for number in (3, 8):
        page.show(shown(number))
        body = asked(page, f"plane?item=1&layer=values&index=0&y1={rows}&x1={columns}&{END}")[1]
        assert set(np.frombuffer(body, np.float32)) == {float(number)}


def test_before_the_first_exposure_there_is_nothing_and_the_end_is_heard():
    with LivePage() as silent:
        assert said(silent, "about?") == {"items": [], "live": True}
        waiting = ThreadPoolExecutor().submit(said, silent, "newest?")
        time.sleep(0.2)
    assert waiting.result(10) == {"ended": True, "exposure": -1}


def test_of_a_scene_that_moves_the_frame_in_the_middle_is_shown():
    values, deviation = torch.rand(2, 1, 4, *CAMERA.scene_shape)
    layers = live_items(lambda: of(Estimate(values, CAMERA, "space-time-lmmse", deviation)))[0].layers
    assert [layer.name for layer in layers] == ["values", "colour", "deviation"]
    np.testing.assert_array_equal(layers[0].plane(1), values[0, 2, 1])
    np.testing.assert_allclose(layers[2].profile((1, 2), (2, 3))[0], deviation[0, 2, :, 1, 2])
    assert layers[1].plane(0).shape == (*CAMERA.size, 3)


def test_a_light_field_has_views_and_in_colour_the_one_in_the_middle():
    camera = LightFieldCamera(views=3, size=(9, 11), slots=2)
    for colours, names in ((1, ["values"]), (3, ["values", "colour"])):
        values = torch.rand(colours, *camera.scene_shape)
        layers = live_items(lambda values=values: of(Estimate(values, camera, "dagger")))[0].layers
        assert [layer.name for layer in layers] == names
        np.testing.assert_allclose(layers[0].plane(5), values[:, 1, 2].mean(0).numpy(), rtol=1e-6)
        np.testing.assert_allclose(layers[0].profile((1, 2), (2, 3))[0], values[..., 1, 2].mean(0).ravel(), rtol=1e-6)
    white = float(np.quantile(values[:, 1, 1].numpy(), 0.995))
    expected = 255 * np.clip(values[:, 1, 1].movedim(0, -1).numpy() / white, 0, 1)
    np.testing.assert_allclose(layers[1].plane(0), expected, atol=2)


def test_numbers_that_are_not_finite_are_null(page):
    page.show(of(Estimate(torch.full((1, *CAMERA.scene_shape), float("nan")), CAMERA, "dagger"), float("inf"), 4))
    assert said(page, "newest?")["residual"] is None
    assert said(page, "profile?item=0&layer=values&y0=1&y1=2&x0=1&x1=2&")["mean"] == [None] * CAMERA.bands


def test_a_snapshot_that_is_not_finite_has_an_empty_histogram(page):
    page.show(replace(shown(4), values=torch.full((1, *CAMERA.snapshot_shape), float("nan"))))
    assert sum(said(page, "newest?")["histogram"]) == 0


@pytest.mark.parametrize("port", [-1, 70000, "taken"])
def test_a_port_that_cannot_be_is_refused(page, port):
    with pytest.raises(SettingError, match="port"):
        LivePage(urlsplit(page.address).port if port == "taken" else port)


def test_a_browser_shows_exposure_after_exposure_and_the_end(look):
    page = LivePage()
    page.show(shown(1))
    looked = look(address=page.address, hash="#colour=0")
    for number in (2, 4):
        page.show(shown(number))
        looked.until(f"tmca.newest?.exposure === {number}")
        looked.until(f"tmca.desk.lines[0]?.y[0] === {0.5 * number}")
        looked.until(f"tmca.desk.specs()[0].paint.plane.data[0] === {0.5 * number}")
    assert "exposures dropped" in looked.page.inner_text("#side")
    looked.page.keyboard.press("2")
    looked.until("tmca.desk.specs()[0].paint.plane?.data[0] === 4")
    page.close()
    looked.until("document.querySelector('h1').textContent === 'tmca live: ended'")
    assert looked.errors == []
