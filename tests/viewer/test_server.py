"""Who is answered, and what; how a viewer begins and ends."""

import json
import socket
import urllib.error
import urllib.request
from urllib.parse import urlsplit

import numpy as np
import pytest

import tmca
from tmca.errors import DataError, SettingError
from tmca.viewer import viewing

CUBE = np.random.default_rng(1).random((4, 6, 9)).astype(np.float32)
PLANE = "plane?item=0&layer=values&index=2&y1=6&x1=9&token={token}"


def labelled():
    return tmca.data.label(CUBE, np.linspace(450e-9, 650e-9, 4))


@pytest.fixture(scope="module")
def viewer():
    with tmca.view(labelled()) as served:
        yield served


def asked(viewer, path, host=None, method="GET"):
    """Status and body of an answer."""
    base, _, token = viewer.address.partition("?token=")
    request = urllib.request.Request(base + path.format(token=token), method=method)
    if host is not None:
        request.add_header("Host", host)
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as refused:
        return refused.code, refused.read()


def test_planes_come_as_they_are(viewer):
    code, body = asked(viewer, PLANE)
    assert code == 200
    np.testing.assert_array_equal(np.frombuffer(body, np.float32).reshape(6, 9), CUBE[2])
    part = asked(viewer, "plane?item=0&layer=values&index=0&y0=1&y1=6&x0=3&x1=99&step=2&token={token}")[1]
    np.testing.assert_array_equal(np.frombuffer(part, np.float32).reshape(3, 3), CUBE[0, 1::2, 3::2])


def test_profiles_are_means_of_regions(viewer):
    code, body = asked(viewer, "profile?item=0&layer=values&y0=1&y1=3&x0=2&x1=5&token={token}")
    assert code == 200
    np.testing.assert_allclose(json.loads(body)["mean"], CUBE[:, 1:3, 2:5].mean((1, 2)), rtol=1e-5)


def test_what_is_shown_is_told(viewer):
    about = json.loads(asked(viewer, "about?token={token}")[1])
    [item] = about["items"]
    assert item["kind"] == "cube"
    assert [layer["name"] for layer in item["layers"]] == ["values", "colour"]
    np.testing.assert_allclose(item["layers"][0]["axis"]["values"], np.linspace(450, 650, 4))


@pytest.mark.parametrize("path", ["", "about", PLANE, "nothing"])
def test_others_are_refused(viewer, path):
    port = urlsplit(viewer.address).port
    for token in ("", "?token=", "?token=abc", "?token=é"):
        bare = path.partition("?")[0] + urllib.request.quote(token, safe="?=")
        assert asked(viewer, bare) == (403, b"refused\n")
    whole = path if "token" in path else f"{path}?token={{token}}"
    for host in (f"evil.example:{port}", f"127.0.0.1:{port + 1}", "127.0.0.1"):
        assert asked(viewer, whole, host) == (403, b"refused\n")
    assert asked(viewer, whole, f"localhost:{port}")[0] == (404 if path == "nothing" else 200)


@pytest.mark.parametrize(
    "path",
    [
        "../../etc/passwd?token={token}",
        "plane?item=5&layer=values&index=0&y1=6&x1=9&token={token}",
        "plane?item=0&layer=none&index=0&y1=6&x1=9&token={token}",
        "plane?item=0&layer=values&index=4&y1=6&x1=9&token={token}",
        "plane?item=0&layer=values&index=0&y0=7&y1=6&x1=9&token={token}",
    ],
)
def test_what_is_not_there_is_not_found(viewer, path):
    assert asked(viewer, path)[0] == 404


@pytest.mark.parametrize("change", ["item=-1", "index=x", "y1=1e9", "step=0", "x0=99999999999999"])
def test_places_are_whole_numbers(viewer, change):
    name = change.partition("=")[0]
    path = "&".join(change if part.startswith(f"{name}=") else part for part in f"{PLANE}&x0=0&step=1".split("&"))
    path = path.replace("plane?item=0", f"plane?{change}") if name == "item" else path
    code, body = asked(viewer, path)
    assert code == 422
    assert b"Traceback" not in body


def test_it_takes_no_orders(viewer):
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert asked(viewer, "about?token={token}", method=method)[0] == 405


def test_the_page_is_one_file_that_loads_nothing(viewer):
    code, body = asked(viewer, "?token={token}")
    page = body.decode()
    assert code == 200
    assert "{{" not in page.replace("${{", "")
    for outside in ('src="', "http://", "https://", "@import", "import "):
        assert outside not in page, outside


def test_a_file_that_changes_or_vanishes_is_told(tmp_path):
    path = tmp_path / "cube.npy"
    np.save(path, np.repeat(CUBE[:1], 31, 0))
    with tmca.view(path) as viewer:
        assert asked(viewer, PLANE)[0] == 200
        path.write_bytes(path.read_bytes()[:200])
        code, body = asked(viewer, PLANE)
        assert code == 409
        assert "written again" in json.loads(body)["error"]
        path.unlink()
        code, body = asked(viewer, PLANE)
        assert code == 409
        assert json.loads(body)["error"].startswith(f"{path}: found it is gone")


def test_two_viewers_on_one_port(viewer):
    port = urlsplit(viewer.address).port
    with pytest.raises(SettingError) as refused:
        tmca.view(labelled(), port=port)
    assert refused.value.where == "port"
    assert asked(viewer, "about?token={token}")[0] == 200


@pytest.mark.parametrize("port", [-1, 65536, 1.5])
def test_ports_that_there_are_not(port):
    with pytest.raises(SettingError):
        tmca.view(labelled(), port=port)


def test_a_viewer_that_is_closed_listens_no_more():
    with tmca.view(labelled()) as viewer:
        port = urlsplit(viewer.address).port
        assert "cube" in repr(viewer) or "scene" in repr(viewer)
        assert "<iframe" in viewer._repr_html_()
    with socket.socket() as free:
        free.bind(("127.0.0.1", port))


def test_it_listens_to_this_machine_alone(viewer):
    assert viewer._socket.getsockname()[0] == "127.0.0.1"


def test_nothing_to_show_and_nothing_to_show_it_with(monkeypatch):
    with pytest.raises(SettingError):
        tmca.view()
    with pytest.raises(DataError):
        tmca.view("nothing.nc")
    monkeypatch.setattr(viewing, "find_spec", lambda name: None)
    with pytest.raises(SettingError) as refused:
        tmca.view(labelled())
    assert "tmca[view]" in refused.value.remedy
