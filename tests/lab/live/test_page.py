"""The page: to this machine alone, to who knows the token, and of the newest estimate."""

import http.client
import io
import json
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import pytest
import torch
from PIL import Image

from tests.lab.live.test_recording import CAMERA, shown
from tmca.cameras import LightFieldCamera
from tmca.decoders import Estimate
from tmca.errors import SettingError
from tmca.lab.live import Shown
from tmca.lab.live.page import LivePage, picture, spectrum


@pytest.fixture
def page():
    with LivePage() as page:
        page.show(shown(3))
        yield page


def get(page, path, token=None, host=None, method="GET"):
    address = urlsplit(page.address)
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=10)
    query = f"{'&' if '?' in path else '?'}token={page.token if token is None else token}"
    connection.request(method, path + query, headers={} if host is None else {"Host": host})
    return connection.getresponse()


def test_the_page_is_there_and_asks_for_nothing_from_elsewhere(page):
    answer = get(page, "/")
    text = answer.read().decode()
    assert answer.status == 200
    assert page.token in text
    assert "http://" not in text
    assert "https://" not in text
    assert "default-src 'self'" in answer.headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    ("token", "host"), [("", None), ("wrong", None), ("ü", None), (None, "evil.example"), (None, "127.0.0.1:1")]
)
def test_others_are_refused(page, token, host):
    for path in ("/", "/stream", "/status", "/spectrum?y=1&x=1"):
        try:
            answer = get(page, path, token, host)
        except UnicodeEncodeError:
            return
        assert answer.status == 403
        assert page.token.encode() not in answer.read()


def test_there_is_nothing_else(page):
    assert get(page, "/../../etc/passwd").status == 404
    assert get(page, "/page.html").status == 404
    assert get(page, "/", method="POST").status == 501


def test_status_and_spectrum_are_those_of_the_newest_estimate(page):
    page.show(shown(5))
    status = json.loads(get(page, "/status").read())
    assert (status["exposure"], status["dropped"], status["ms"]["decode"]) == (5, 2, 30)
    assert sum(status["histogram"]) == CAMERA.snapshot_shape[1] * CAMERA.snapshot_shape[2]
    spectrum = json.loads(get(page, "/spectrum?y=1&x=2").read())
    assert spectrum["values"] == [2.5] * CAMERA.bands
    assert spectrum["nm"][0] == pytest.approx(1e9 * CAMERA.wavelengths[0])
    for beside in ("y=-1&x=0", "y=9999&x=0", "y=a&x=0", "x=0", "y=1.5&x=0", "y=²&x=0", f"y={'1' * 5000}&x=0"):
        assert json.loads(get(page, f"/spectrum?{beside}".replace("²", "%C2%B2")).read()) == {}


def test_the_stream_shows_pictures_of_the_size_of_the_estimate(page):
    answer = get(page, "/stream")
    assert answer.status == 200
    assert answer.readline() == b"--frame\r\n"
    assert answer.readline() == b"Content-Type: image/jpeg\r\n"
    length = int(answer.readline().split()[1])
    answer.readline()
    assert Image.open(io.BytesIO(answer.read(length))).size == CAMERA.size[::-1]
    assert answer.read(11) == b"\r\n--frame\r\n"  # what a browser waits for before it shows the picture
    answer.close()


def test_every_camera_has_a_picture():
    camera = LightFieldCamera(views=3, size=(9, 11), slots=2)
    for colours in (1, 3):
        estimate = Estimate(torch.rand(colours, *camera.scene_shape), camera, "dagger")
        seen = Shown(0, torch.zeros(colours, *camera.snapshot_shape), estimate, 0.0, 0.0, 0, {}, 0.0)
        assert picture(seen).shape == (9, 11, 3)
    assert picture(shown(1)).shape == (*CAMERA.size, 3)
    for moved in (CAMERA, camera):
        moving = Estimate(torch.rand(1, 4, *moved.scene_shape), moved, "space-time-lmmse")
        assert picture(of(moving)).shape == (*moved.size, 3)


def of(estimate, residual=0.0):
    return Shown(0, torch.zeros(1, *estimate.camera.snapshot_shape), estimate, 0.0, residual, 0, {}, 0.0)


def test_of_a_scene_that_moves_the_spectrum_is_that_of_the_frame_in_the_middle():
    values, deviation = torch.rand(2, 1, 4, *CAMERA.scene_shape)
    there = spectrum(of(Estimate(values, CAMERA, "space-time-lmmse", deviation)), "1", "2")
    assert there["values"] == values[0, 2, :, 1, 2].tolist()
    assert there["deviation"] == deviation[0, 2, :, 1, 2].tolist()
    assert len(there["nm"]) == CAMERA.bands
    assert there["heading"] == "Spectrum"


def test_a_light_field_has_views():
    camera = LightFieldCamera(views=3, size=(9, 11), slots=2)
    there = spectrum(of(Estimate(torch.rand(1, *camera.scene_shape), camera, "dagger")), "1", "2")
    assert (there["heading"], len(there["values"])) == ("Views", 9)


def test_numbers_that_are_not_finite_are_null(page):
    page.show(of(Estimate(torch.full((1, *CAMERA.scene_shape), float("nan")), CAMERA, "dagger"), float("inf")))
    assert b'"residual": null' in get(page, "/status").read()
    assert json.loads(get(page, "/spectrum?y=1&x=1").read())["values"] == [None] * CAMERA.bands


def test_a_browser_that_waits_hears_of_the_end():
    with LivePage() as silent:
        asked = ThreadPoolExecutor().submit(get, silent, "/status")
        time.sleep(0.2)
    assert json.loads(asked.result(10).read()) == {"ended": True}


@pytest.mark.parametrize("port", [-1, 70000])
def test_a_port_that_cannot_be_is_refused(port):
    with pytest.raises(SettingError, match="port"):
        LivePage(port)


def test_a_port_in_use_is_refused(page):
    with pytest.raises(SettingError, match="free port"):
        LivePage(urlsplit(page.address).port)
