"""A page as one file: it needs no server and no network, and shows what the served one does."""

import re

import numpy as np
import pytest

import tmca
from tmca.errors import OutputError, SettingError
from tmca.viewer.gallery import Gallery
from tmca.viewer.static import write_page

CUBE = np.random.default_rng(4).random((5, 40, 50)).astype(np.float32)
CUBE[:, 3, 4] = np.nan


def cube():
    return tmca.data.label(CUBE, np.linspace(450e-9, 650e-9, 5), {"name": "noise </script>"})


def test_a_file_asks_nobody_and_a_name_ends_no_script(tmp_path):
    text = tmca.viewer.write_static(tmp_path / "page.html", cube()).read_text()
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import""", text)
    assert "noise </script>" not in text
    assert text.count("<script") == text.count("</script>")


def test_a_long_page_is_thinned_out_and_one_that_stays_too_long_refused(tmp_path):
    gallery, most = Gallery([cube()]), len(tmca.viewer.page.whole_page().encode()) + 12_000
    assert write_page(gallery, tmp_path / "small.html", most=most).stat().st_size <= most
    with pytest.raises(SettingError) as refused:
        write_page(gallery, tmp_path / "none.html", most=2000)
    assert refused.value.where == "static"
    assert not (tmp_path / "none.html").exists()


def test_a_file_shows_the_cube_without_a_server(tmp_path, look):
    page = tmca.viewer.write_static(tmp_path / "page.html", cube())
    looked = look(address=page.as_uri(), hash="#points=9,21&colour=0")
    looked.until("tmca.desk.lines?.length === 1")
    shown = np.array(looked.ask("Array.from(tmca.desk.lines[0].y)"))
    np.testing.assert_allclose(shown, CUBE[:, 9, 21], atol=0.5 / 254)
    looked.until("[...tmca.desk.panels.values()][0].spec.paint.plane")
    assert looked.ask("Number.isNaN([...tmca.desk.panels.values()][0].spec.paint.plane.data[3 * 50 + 4])")
    assert looked.errors == []


def test_a_page_that_was_thinned_out_shows_every_second_pixel(tmp_path, look):
    gallery = Gallery([cube()])
    page = write_page(gallery, tmp_path / "small.html", most=len(tmca.viewer.page.whole_page().encode()) + 12_000)
    looked = look(address=page.as_uri(), hash="#points=9,21&colour=0")
    assert looked.ask("tmca.desk.items[0].layers[0].step") == 2
    looked.until("tmca.desk.lines?.length === 1")
    shown = np.array(looked.ask("Array.from(tmca.desk.lines[0].y)"))
    np.testing.assert_allclose(shown, CUBE[:, 8, 20], atol=0.5 / 254)


def test_pages_are_not_written_over(tmp_path):
    (tmp_path / "page.html").write_text("mine")
    with pytest.raises(OutputError):
        tmca.viewer.write_static(tmp_path / "page.html", cube())
    with pytest.raises(OutputError):
        tmca.viewer.write_static(tmp_path / "page.pdf", cube())
    assert (tmp_path / "page.html").read_text() == "mine"
