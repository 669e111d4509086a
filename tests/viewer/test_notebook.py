"""The page in a notebook: what it asks is answered as the server answers, in a browser too; without widgets a frame."""

import base64
import json

import numpy as np
import pytest

import tmca
from tests.viewer.test_server import CUBE, asked, labelled
from tmca.viewer.gallery import Gallery
from tmca.viewer.page import body, script, style
from tmca.viewer.questions import answer

PLANE = {"item": 0, "layer": "values", "index": 2, "step": 1, "y0": 0, "y1": 6, "x0": 0, "x1": 9}


@pytest.fixture
def gallery():
    opened = Gallery([labelled()])
    yield opened
    opened.close()


def test_answers_are_those_of_the_server(gallery):
    _, [sent] = answer(gallery, {"path": "plane", "given": PLANE})
    np.testing.assert_array_equal(np.frombuffer(sent, np.float32).reshape(6, 9), CUBE[2])
    profile = {"item": 0, "layer": "values", "y0": 1, "y1": 3, "x0": 2, "x1": 5}
    with tmca.view(labelled()) as viewer:
        for path, given in (("about", {}), ("profile", profile)):
            query = "&".join(f"{name}={value}" for name, value in given.items())
            served = json.loads(asked(viewer, f"{path}?{query}&token={{token}}")[1])
            assert json.loads(json.dumps(answer(gallery, {"path": path, "given": given})[0]["said"])) == served


@pytest.mark.parametrize(
    "question",
    [
        {"path": "../x", "given": PLANE}, {"path": "plane", "given": {}}, {"path": "plane"}, "plane", None,
        {"path": "plane", "given": PLANE | {"index": 99}}, {"path": "plane", "given": PLANE | {"y1": "x"}},
        {"path": "plane", "given": PLANE | {"item": -1}}, {"path": "profile", "given": PLANE | {"layer": "none"}},
    ],
)  # fmt: skip
def test_there_is_nothing_else(gallery, question):
    assert answer(gallery, question) == ({"error": "there is no such thing"}, [])


def test_a_file_that_vanishes_is_told(tmp_path):
    np.save(tmp_path / "cube.npy", np.zeros((31, 8, 8), np.float32))
    gallery = Gallery([tmp_path / "cube.npy"])
    (tmp_path / "cube.npy").unlink()
    given = PLANE | {"x1": 8}
    assert "it is gone" in answer(gallery, {"path": "plane", "given": given})[0]["error"]
    gallery.close()


def test_without_widgets_a_cell_shows_a_frame_and_a_link(monkeypatch):
    monkeypatch.setattr("tmca.viewer.viewing.find_spec", lambda name: None if name == "anywidget" else name)
    with tmca.view(labelled()) as viewer:
        shown = viewer._repr_mimebundle_()
        assert shown["text/plain"] == f"<Viewer of scene at {viewer.address}>"
        assert "<iframe" in shown["text/html"]
        assert "<a href" in shown["text/html"]


_CELL = """
const blob = new Blob([SCRIPT], { type: "text/javascript" });
const { default: widget } = await import(URL.createObjectURL(blob));
let heard;
const model = {
  get: (name) => ({ _style: STYLE, _body: BODY })[name], on: (name, hear) => (heard = hear), off() {},
  async send({ id, path, given }) {
    const { said, sent } = JSON.parse(await ask(JSON.stringify({ path, given })));
    const bytes = sent.map((text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)));
    heard({ id, ...said }, bytes.map(({ buffer }) => new DataView(buffer)));
  },
};
await widget.render({ model, el: document.body });
window.tmca = document.querySelector("div").tmca;
"""


def test_the_cell_shows_the_page_and_keeps_its_keys(browser, gallery):
    def ask(question):
        said, sent = answer(gallery, json.loads(question))
        return json.dumps({"said": said, "sent": [base64.b64encode(one).decode() for one in sent]})

    errors, keys = [], []

    def pressed(key):
        keys.append(key)

    page = browser.new_page(viewport={"width": 900, "height": 700})
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.expose_function("ask", ask)
    page.expose_function("pressed", pressed)
    page.evaluate("document.addEventListener('keydown', (event) => pressed(event.key))")
    words = {"SCRIPT": script("widget"), "STYLE": style(), "BODY": body()}
    cell = "".join(f"const {name} = {json.dumps(text)};\n" for name, text in words.items()) + _CELL
    page.evaluate(f"(async () => {{ {cell} }})()")
    page.wait_for_function("tmca.desk && tmca.planes.whole(0, tmca.desk.items[0].layers[0])")
    page.mouse.click(250, 300)
    page.keyboard.press("b")
    page.keyboard.press(".")
    page.wait_for_function("tmca.desk.places.length && !tmca.desk.coloured")
    row, column = page.evaluate("tmca.desk.places[0]")
    page.wait_for_function(f"tmca.desk.lines?.[0]?.name.endsWith('row {row}, column {column}')")
    np.testing.assert_allclose(page.evaluate("tmca.desk.lines[0].y"), CUBE[:, row, column], rtol=1e-6)
    assert (errors, keys) == ([], [])
    page.close()
